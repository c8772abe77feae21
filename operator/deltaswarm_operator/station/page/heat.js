/** Heat maps: how old what is known of each part of the arena is, and how many agents were heard there lately. */

const CELLS = 48;
const RADIUS_CELLS = 2;
/** Over this time activity fades to a third [s]; for why such a map, see Soorati et al. 2021. */
const ACTIVE_S = 60;
/** The time for which an agent's word stands at most [s]. */
const WORD_S = 10;
const STORED = "deltaswarm-heat";

export class Heat {
  constructor() {
    this.run = "";
    this.cell_m = 1;
    this.columns = 1;
    this.rows = 1;
    /** @type {Float64Array} newest report from each cell [s]; NaN if none */
    this.heard_s = new Float64Array(0);
    /** @type {Float64Array} agents per cell, an exponential average over ACTIVE_S */
    this.active = new Float64Array(0);
    /** @type {Map<number, number>} time of each agent's newest word [s] */
    this.said_s = new Map();
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
    this.active = new Float64Array(this.heard_s.length);
    this.said_s.clear();
    this.restore();
  }

  /**
   * @param {import("./types.js").AgentRow[]} agents
   * @param {number} now_s
   */
  take(agents, now_s) {
    if (now_s < this.newest_s) {
      this.heard_s.forEach((heard_s, cell, all) => {
        if (heard_s > now_s) all[cell] = NaN;
      });
      this.active.fill(0);
      this.said_s.clear();
    }
    const fading = Math.exp(-Math.max(0, now_s - this.newest_s) / ACTIVE_S);
    this.active.forEach((active, cell, all) => (all[cell] = active * fading));
    this.newest_s = now_s;
    for (const [id, x_m, y_m, , , , said_s] of agents) {
      const stood_s = Math.min(WORD_S, said_s - (this.said_s.get(id) ?? said_s - 1));
      this.said_s.set(id, said_s);
      const [column, row] = [Math.floor(x_m / this.cell_m), Math.floor(y_m / this.cell_m)];
      for (let down = -RADIUS_CELLS; down <= RADIUS_CELLS; down += 1)
        for (let right = -RADIUS_CELLS; right <= RADIUS_CELLS; right += 1)
          if (Math.hypot(down, right) < RADIUS_CELLS + 0.5) this.touch(column + right, row + down, said_s, Math.max(0, stood_s) / ACTIVE_S);
    }
  }

  /**
   * @param {number} column
   * @param {number} row
   * @param {number} said_s
   * @param {number} activity
   */
  touch(column, row, said_s, activity) {
    if (column < 0 || row < 0 || column >= this.columns || row >= this.rows) return;
    const cell = row * this.columns + column;
    if (!((this.heard_s[cell] ?? NaN) >= said_s)) this.heard_s[cell] = said_s;
    this.active[cell] = (this.active[cell] ?? 0) + activity;
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
