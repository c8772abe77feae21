/** The part of the arena on the map: metres with y upwards, pixels with y downwards. */

const MARGIN_PX = 14;
export const LEAST_MARKER_PX = 6;
const MOST_PX_PER_M = 400;

export class View {
  constructor() {
    this.width = 1;
    this.height = 1;
    this.scale = 1;
    this.left = 0;
    this.top = 0;
    this.isFitted = false;
  }

  /** Size of an agent's marker: larger on a large screen [px]. */
  get marker_px() {
    return Math.min(9, Math.max(LEAST_MARKER_PX, Math.min(this.width, this.height) / 100));
  }

  /**
   * @param {number} x_m
   * @param {number} y_m
   * @returns {[number, number]} pixels
   */
  toScreen(x_m, y_m) {
    return [this.left + x_m * this.scale, this.top - y_m * this.scale];
  }

  /**
   * @param {number} x
   * @param {number} y
   * @returns {[number, number]} metres
   */
  toArena(x, y) {
    return [(x - this.left) / this.scale, (this.top - y) / this.scale];
  }

  /**
   * Show the whole arena, and the base even if it lies outside.
   * @param {[number, number]} arena_m
   * @param {[number, number] | null} base_m
   */
  fit(arena_m, base_m) {
    const [low_x, low_y] = [Math.min(0, base_m?.[0] ?? 0), Math.min(0, base_m?.[1] ?? 0)];
    const [high_x, high_y] = [Math.max(arena_m[0], base_m?.[0] ?? 0), Math.max(arena_m[1], base_m?.[1] ?? 0)];
    const [wide, tall] = [Math.max(this.width - 2 * MARGIN_PX, 50), Math.max(this.height - 2 * MARGIN_PX, 50)];
    this.scale = Math.min(wide / (high_x - low_x || 1), tall / (high_y - low_y || 1));
    this.left = (this.width - (high_x + low_x) * this.scale) / 2;
    this.top = (this.height + (high_y + low_y) * this.scale) / 2;
    this.isFitted = true;
  }

  /**
   * Show a place in the middle.
   * @param {number} x_m
   * @param {number} y_m
   * @param {number} scale [px/m]
   */
  centre(x_m, y_m, scale) {
    this.scale = scale;
    this.left = this.width / 2 - x_m * scale;
    this.top = this.height / 2 + y_m * scale;
  }

  /**
   * @param {number} factor
   * @param {number} x pixel that stays where it is
   * @param {number} y
   */
  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const [x_m, y_m] = this.toArena(x, y);
    this.scale = Math.min(MOST_PX_PER_M, Math.max(0.05, this.scale * factor));
    this.left = x - x_m * this.scale;
    this.top = y + y_m * this.scale;
    this.isFitted = false;
  }

  /**
   * @param {number} x pixels
   * @param {number} y
   */
  pan(x, y) {
    this.left += x;
    this.top += y;
    this.isFitted = false;
  }

  /**
   * Centre a place unless it is well inside the map.
   * @param {number} x_m
   * @param {number} y_m
   */
  reveal(x_m, y_m) {
    const [x, y] = this.toScreen(x_m, y_m);
    const inside = x > MARGIN_PX && x < this.width - MARGIN_PX && y > MARGIN_PX && y < this.height - MARGIN_PX;
    if (!inside) this.pan(this.width / 2 - x, this.height / 2 - y);
  }
}
