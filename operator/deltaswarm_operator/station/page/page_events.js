/** Tells the console what happens to the page: hidden, resized, what is selected, which tab, how far it is zoomed. */

/** @typedef {import("./types.js").App} App */
/** @typedef {{now: () => string, settle_ms: number, before?: string, since_ms: number, seen?: string}} Watched */

const LOOK_EVERY_MS = 50;
const SETTLE_MS = 300;

/**
 * What is selected, and whether the page chose it, not the person.
 * @param {App} app
 */
const selected = ({ selection }) => (selection ? `${selection.kind} ${selection.id}${selection.byItself ? " by itself" : ""}` : "");

export class PageEvents {
  /**
   * @param {App} app
   * @param {() => string} tab
   * @param {() => number} zoom pixels per metre
   */
  constructor(app, tab, zoom) {
    this.app = app;
    /** @type {Record<string, Watched>} */
    this.watched = {
      selected: { now: () => selected(app), settle_ms: 0, since_ms: 0 },
      tab: { now: tab, settle_ms: 0, since_ms: 0 },
      size: { now: () => `${window.innerWidth}x${window.innerHeight}`, settle_ms: SETTLE_MS, since_ms: 0 },
      zoom: { now: () => `${zoom().toFixed(2)} px/m`, settle_ms: SETTLE_MS, since_ms: 0 },
    };
    document.addEventListener("visibilitychange", () => this.send(document.hidden ? "hidden" : "visible"));
    window.setInterval(() => this.look(), LOOK_EVERY_MS);
  }

  /** Begin with a run: how the page came here, and its state. */
  begin() {
    const [how] = performance.getEntriesByType("navigation");
    this.send("loaded", how instanceof PerformanceNavigationTiming ? how.type : "");
    if (document.hidden) this.send("hidden");
    for (const one of Object.values(this.watched)) one.before = undefined;
  }

  look() {
    const now_ms = performance.now();
    for (const [name, one] of Object.entries(this.watched)) {
      const value = one.now();
      if (value !== one.seen) [one.seen, one.since_ms] = [value, now_ms];
      if (value === one.before || now_ms - one.since_ms < one.settle_ms) continue;
      if (this.send(name, value)) one.before = value;
    }
  }

  /**
   * @param {string} event
   * @param {string} [text]
   */
  send(event, text = "") {
    if (this.app.model.hello?.kind !== "live") return false;
    this.app.send({ type: "page", event, text });
    return true;
  }
}
