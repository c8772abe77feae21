/** Labels of the map: each where it lies on no other and on no mark, or nowhere; the more important are placed first. */

import { inks } from "./looks.js";

const FONT = "11px system-ui, sans-serif";
const HEIGHT_PX = 12;
const LEAST_STRENGTH = 0.75;

/** @typedef {{text: string, x: number, y: number, size: number, strength: number, rank: number}} Label of a mark [px] */
/** @typedef {{left: number, right: number, top: number, bottom: number}} Box */

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

/**
 * @param {Box} one
 * @param {Box} other
 */
const meet = (one, other) => one.left < other.right && one.right > other.left && one.top < other.bottom && one.bottom > other.top;

export class Labels {
  constructor() {
    /** @type {Label[]} */
    this.wanted = [];
    /** @type {Box[]} what no label may lie on: marks, and the labels that are placed */
    this.taken = [];
  }

  /** @param {Label} wanted a lower rank is more important */
  add(wanted) {
    this.wanted.push(wanted);
    this.keep(wanted.x, wanted.y, wanted.size - 1);
  }

  /**
   * Keep a place free of labels.
   * @param {number} x
   * @param {number} y
   * @param {number} size
   */
  keep(x, y, size) {
    this.taken.push({ left: x - size, right: x + size, top: y - size, bottom: y + size });
  }

  /** @param {CanvasRenderingContext2D} on */
  draw(on) {
    on.font = FONT;
    for (const { text, x, y, size, strength } of this.wanted.sort((a, b) => a.rank - b.rank)) {
      const half = on.measureText(text).width / 2;
      const places = [
        [x, y - size - 4],
        [x, y + size + HEIGHT_PX],
        [x + size + half + 3, y + 4],
        [x - size - half - 3, y + 4],
      ];
      for (const [at_x = 0, at_y = 0] of places) {
        const box = { left: at_x - half - 1, right: at_x + half + 1, top: at_y - HEIGHT_PX + 2, bottom: at_y + 2 };
        if (this.taken.some((other) => meet(box, other))) continue;
        this.taken.push(box);
        on.globalAlpha = Math.max(strength, LEAST_STRENGTH);
        label(on, text, at_x, at_y);
        break;
      }
    }
    on.globalAlpha = 1;
  }
}
