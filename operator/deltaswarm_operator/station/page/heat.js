/** The time of the last report from each part of the arena: where something is known, and how old it is. */

const CELLS = 48;
const RADIUS_CELLS = 2;
const STORED = "deltaswarm-heat";

export class Heat {
  constructor() {
    this.run = "";
    this.cell_m = 1;
    this.columns = 1;
    this.rows = 1;
    /** @type {Float64Array} newest report from each cell [s]; NaN if none */
    this.heard_s = new Float64Array(0);
    this.newest_s = -Infinity;
    window.addEventListener("pagehide", () => this.store());
  }

  /**
   * @param {string} run
   * @param {[number, number]} arena_m
   */
  start(run, arena_m) {
    if (run === this.run) return;
    this.run = run;
    this.cell_m = Math.max(...arena_m) / CELLS;
    this.columns = Math.ceil(arena_m[0] / this.cell_m);
    this.rows = Math.ceil(arena_m[1] / this.cell_m);
    this.heard_s = new Float64Array(this.columns * this.rows).fill(NaN);
    this.restore();
  }

  /**
   * @param {import("./types.js").AgentRow[]} agents
   * @param {number} now_s
   */
  take(agents, now_s) {
    if (now_s < this.newest_s)
      this.heard_s.forEach((heard_s, cell, all) => {
        if (heard_s > now_s) all[cell] = NaN;
      });
    this.newest_s = now_s;
    for (const [, x_m, y_m, , , , said_s] of agents) {
      const [column, row] = [Math.floor(x_m / this.cell_m), Math.floor(y_m / this.cell_m)];
      for (let down = -RADIUS_CELLS; down <= RADIUS_CELLS; down += 1)
        for (let right = -RADIUS_CELLS; right <= RADIUS_CELLS; right += 1)
          if (Math.hypot(down, right) < RADIUS_CELLS + 0.5) this.touch(column + right, row + down, said_s);
    }
  }

  /**
   * @param {number} column
   * @param {number} row
   * @param {number} said_s
   */
  touch(column, row, said_s) {
    if (column < 0 || row < 0 || column >= this.columns || row >= this.rows) return;
    const cell = row * this.columns + column;
    if (!((this.heard_s[cell] ?? NaN) >= said_s)) this.heard_s[cell] = said_s;
  }

  /** Share of the arena from which anything was reported. */
  share() {
    let known = 0;
    for (const heard_s of this.heard_s) if (!Number.isNaN(heard_s)) known += 1;
    return known / Math.max(1, this.heard_s.length);
  }

  store() {
    const cells = Array.from(this.heard_s, (heard_s) => (Number.isNaN(heard_s) ? null : Math.round(heard_s * 10) / 10));
    sessionStorage.setItem(STORED, JSON.stringify({ run: this.run, newest_s: this.newest_s, cells }));
  }

  restore() {
    const stored = JSON.parse(sessionStorage.getItem(STORED) ?? "null");
    if (stored?.run !== this.run || stored.cells.length !== this.heard_s.length) return;
    this.newest_s = stored.newest_s ?? -Infinity;
    this.heard_s.set(stored.cells.map((/** @type {number | null} */ heard_s) => heard_s ?? NaN));
  }
}
