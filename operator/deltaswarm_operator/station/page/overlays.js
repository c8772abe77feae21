/** What is drawn over the map: trails, rings, targets of orders, the ruler. */

import { label } from "./labels.js";
import { t } from "./language.js";
import { inks } from "./looks.js";
import { number } from "./words.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./view.js").View} View */
/** @typedef {CanvasRenderingContext2D} Canvas */

const EDGE_PX = 10;

/**
 * Round a length up to the next of 1, 2, 5, 10, ... m.
 * @param {number} length_m
 */
export function roundLength(length_m) {
  const power = 10 ** Math.floor(Math.log10(length_m));
  return power * ([1, 2, 5].find((digit) => digit * power >= length_m) ?? 10);
}

/**
 * Draw where an event was reported, oldest first and faintest.
 * @param {Canvas} on
 * @param {View} view
 * @param {import("./types.js").Point[]} places_m
 */
export function trail(on, view, places_m) {
  const places = places_m.map((place) => view.toScreen(...place));
  const { accent, halo } = inks();
  for (const [colour, width] of /** @type {[string, number][]} */ ([[halo, 4], [accent, 1.5]])) {
    on.strokeStyle = colour;
    on.lineWidth = width;
    on.beginPath();
    for (const place of places) on.lineTo(...place);
    on.stroke();
  }
  for (const [colour, radius] of /** @type {[string, number][]} */ ([[halo, 5], [accent, 3.5]])) {
    on.fillStyle = colour;
    for (const [at, [x, y]] of places.slice(0, -1).entries()) {
      on.globalAlpha = colour === halo ? 1 : 0.5 + (0.5 * (at + 1)) / places.length;
      on.beginPath();
      on.arc(x, y, radius, 0, 2 * Math.PI);
      on.fill();
    }
  }
  on.globalAlpha = 1;
}

/**
 * Draw the targets of orders that may still be carried out.
 * @param {Canvas} on
 * @param {View} view
 * @param {App} app
 */
export function ordered(on, view, { model }) {
  for (const [order, name, [kind, x_m = 0, y_m = 0, radius_m = 0], , , , , , expires_s] of model.picture?.commands ??
    []) {
    if (expires_s < model.now_s || (kind !== "place" && kind !== "circle")) continue;
    const [x, y] = view.toScreen(x_m, y_m);
    on.strokeStyle = inks().accent;
    on.lineWidth = 1.5;
    cross(on, x, y, 6);
    on.setLineDash([4, 4]);
    on.beginPath();
    on.arc(x, y, kind === "circle" ? radius_m * view.scale : 9, 0, 2 * Math.PI);
    on.stroke();
    on.setLineDash([]);
    label(on, `${order} · ${t(name)}`, x, y - 12);
  }
}

/**
 * @param {Canvas} on
 * @param {number} x
 * @param {number} y
 * @param {number} size
 */
export function cross(on, x, y, size) {
  on.beginPath();
  on.moveTo(x - size, y);
  on.lineTo(x + size, y);
  on.moveTo(x, y - size);
  on.lineTo(x, y + size);
  on.stroke();
}

/**
 * @param {Canvas} on
 * @param {View} view
 */
export function ruler(on, view) {
  const length_m = roundLength(60 / view.scale);
  const [corner_x, corner_y] = view.toScreen(0, 0);
  const left = corner_x >= 0 && corner_x < view.width / 2 ? corner_x + EDGE_PX : EDGE_PX;
  const bottom = corner_y <= view.height && corner_y > view.height / 2 ? corner_y - EDGE_PX : view.height - EDGE_PX;
  on.strokeStyle = inks().ink;
  on.lineWidth = 2;
  on.beginPath();
  on.moveTo(left, bottom);
  on.lineTo(left + length_m * view.scale, bottom);
  on.stroke();
  label(on, `${number(length_m, 2)} m`, left + (length_m * view.scale) / 2, bottom - 5);
}

/**
 * @param {Canvas} on
 * @param {number} x
 * @param {number} y
 * @param {number} size of the marker [px]
 */
export function ring(on, x, y, size) {
  on.globalAlpha = 1;
  on.beginPath();
  on.arc(x, y, size + 7, 0, 2 * Math.PI);
  on.strokeStyle = inks().accent;
  on.lineWidth = 3;
  on.stroke();
}
