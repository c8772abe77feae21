/** Labels of the map: if two would overlap, the less important is left out. */

import { inks } from "./looks.js";

const FONT = "11px system-ui, sans-serif";
const HEIGHT_PX = 12;
const LEAST_STRENGTH = 0.75;

/** @typedef {{text: string, x: number, y: number, strength: number, rank: number}} Label */
/** @typedef {{left: number, right: number, y: number}} Box */

/**
 * @param {CanvasRenderingContext2D} on
 * @param {string} text
 * @param {number} x
 * @param {number} y
 */
export function label(on, text, x, y) {
  const { ink, halo } = inks();
  on.font = FONT;
  on.textAlign = "center";
  on.lineJoin = "round";
  on.strokeStyle = halo;
  on.lineWidth = 3;
  on.strokeText(text, x, y);
  on.fillStyle = ink;
  on.fillText(text, x, y);
}

export class Labels {
  constructor() {
    /** @type {Label[]} */
    this.wanted = [];
  }

  /** @param {Label} wanted a lower rank is more important */
  add(wanted) {
    this.wanted.push(wanted);
  }

  /** @param {CanvasRenderingContext2D} on */
  draw(on) {
    on.font = FONT;
    /** @type {Box[]} */
    const taken = [];
    for (const { text, x, y, strength } of this.wanted.sort((a, b) => a.rank - b.rank)) {
      const half = on.measureText(text).width / 2;
      const [left, right] = [x - half, x + half];
      if (taken.some((box) => left < box.right && right > box.left && Math.abs(y - box.y) < HEIGHT_PX)) continue;
      taken.push({ left, right, y });
      on.globalAlpha = Math.max(strength, LEAST_STRENGTH);
      label(on, text, x, y);
    }
    on.globalAlpha = 1;
  }
}
