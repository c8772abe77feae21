/** The selected event enlarged: where it was reported, and nothing that could cover that. */

import { label } from "./labels.js";
import { inks, markEvent } from "./looks.js";
import { ruler, trail } from "./overlays.js";
import { View } from "./view.js";
import { eventName } from "./words.js";

/** @typedef {import("./types.js").EventRow} EventRow */

/** From the middle to the upper edge; the same for all events, so that jumps can be compared [m]. */
const REACH_M = 6;

export class CloseUp {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    this.on = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    this.view = new View();
  }

  /** @param {EventRow | null} event */
  draw(event) {
    const { canvas, on, view } = this;
    const dots = window.devicePixelRatio || 1;
    [view.width, view.height] = [canvas.clientWidth, canvas.clientHeight];
    if (!view.width) return;
    [canvas.width, canvas.height] = [Math.round(view.width * dots), Math.round(view.height * dots)];
    on.setTransform(dots, 0, 0, dots, 0, 0);
    on.fillStyle = inks().arena;
    on.fillRect(0, 0, view.width, view.height);
    if (!event) return;
    const [id, x_m, y_m, , , , , before] = event;
    const places = [...before, /** @type {import("./types.js").Point} */ ([x_m, y_m])];
    const [mid_x_m, mid_y_m] = [0, 1].map((at) => places.reduce((sum, place) => sum + (place[at] ?? 0), 0) / places.length);
    view.centre(mid_x_m ?? 0, mid_y_m ?? 0, view.height / 2 / REACH_M);
    this.grid();
    markEvent(on, ...view.toScreen(x_m, y_m), 9);
    trail(on, view, places);
    ruler(on, view);
    label(on, `${id < 0 ? "" : "e"}${eventName(id)}`, 18, 16);
  }

  /** A line each metre. */
  grid() {
    const { on, view } = this;
    on.strokeStyle = inks().faint;
    on.lineWidth = 1;
    on.beginPath();
    const [left_m, top_m] = view.toArena(0, 0);
    const [right_m, bottom_m] = view.toArena(view.width, view.height);
    for (let x_m = Math.ceil(left_m); x_m <= right_m; x_m += 1) {
      const [x] = view.toScreen(x_m, 0);
      on.moveTo(x, 0);
      on.lineTo(x, view.height);
    }
    for (let y_m = Math.ceil(bottom_m); y_m <= top_m; y_m += 1) {
      const [, y] = view.toScreen(0, y_m);
      on.moveTo(0, y);
      on.lineTo(view.width, y);
    }
    on.stroke();
  }
}
