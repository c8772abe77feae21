/** What the page knows: the newest picture, the inbox, the read messages, and the rates so far. */

/** @typedef {import("./types.js").Hello} Hello */
/** @typedef {import("./types.js").Picture} Picture */
/** @typedef {import("./types.js").CatchUp} CatchUp */
/** @typedef {import("./types.js").AgentRow} AgentRow */
/** @typedef {import("./types.js").EventRow} EventRow */
/** @typedef {import("./types.js").InboxRow} InboxRow */
/** @typedef {import("./types.js").HistoryRow} HistoryRow */
/** @typedef {import("./types.js").Selection} Selection */

const MAX_INBOX = 1000;
const MAX_HISTORY = 1200;
/** A longer advance of a replay's time is a jump [s]. */
const JUMP_S = 60;

export class Model {
  constructor() {
    /** @type {Hello | null} */
    this.hello = null;
    /** Whether this page's address is one that only watches. */
    this.isWatching = false;
    /** @type {import("./types.js").Truth | null} */
    this.truth = null;
    /** Whether the page shows the truth if it has it, or else what the participant knows. */
    this.showsTruth = true;
    /** @type {Selection | null} what the participant has selected, for the conductor */
    this.theirs = null;
    /** @type {Picture | null} */
    this.picture = null;
    /** @type {Map<number, InboxRow>} in the order of their numbers */
    this.inbox = new Map();
    /** @type {Map<number, number>} how many items each line only counts */
    this.counts = new Map();
    /** @type {InboxRow[]} items that the inbox holds back, as they were when the page asked */
    this.held = [];
    /** @type {Set<number>} */
    this.read = new Set();
    /** @type {HistoryRow[]} */
    this.history = [];
    /** @type {Map<number, string>} the class that the participant judged each reported event to be of */
    this.judged = new Map();
    /** Whether no message is missing; if false, ask for the missing ones. */
    this.isCaughtUp = false;
    this.newest = -1;
    /** @type {Map<number, number>} numbers of the truth's events, whose ids are too long to read; below 0: unreported */
    this.eventNumbers = new Map();
  }

  /** The question that is open on the participant's page. */
  get asked() {
    return this.picture?.probe ?? null;
  }

  /** The question that this page asks: only the participant answers. */
  get question() {
    return this.hello?.kind === "live" ? this.asked : null;
  }

  get now_s() {
    return this.picture?.time_s ?? 0;
  }

  get shownTruth() {
    return this.showsTruth ? this.truth : null;
  }

  /** Agents as they were heard of; where nobody hears of them, as they are. */
  get heard() {
    return this.hello?.kind === "researcher" ? this.agents : (this.picture?.agents ?? []);
  }

  /** @returns {AgentRow[]} the truth's are of the present */
  get agents() {
    const { picture, now_s, shownTruth } = this;
    if (shownTruth)
      return shownTruth.agents.map(([id, x_m, y_m, role, parent, root, delta]) => [
        id,
        x_m,
        y_m,
        role,
        parent,
        root,
        now_s,
        1,
        delta,
      ]);
    return picture?.agents ?? [];
  }

  /** @returns {EventRow[]} */
  get events() {
    const { picture, now_s, shownTruth } = this;
    if (shownTruth)
      return shownTruth.events.map(([id, ...row]) => [this.eventNumbers.get(id) ?? id, ...row, now_s, -1, [], []]);
    return picture?.events ?? [];
  }

  /** Roots of the reported trees, whether or not the root itself reported. */
  get roots() {
    const roots = new Set(
      this.agents.flatMap((agent) => (agent[5] >= 0 ? [agent[5]] : agent[3] === "root" ? [agent[0]] : [])),
    );
    return [...roots].sort((a, b) => a - b);
  }

  /**
   * Take a hello; return whether it is of another run, so that nothing known before applies.
   * @param {Hello} hello
   */
  takeHello(hello) {
    const isOther = this.hello !== null && this.hello.run !== hello.run;
    this.hello = this.isWatching ? { ...hello, kind: "watch", speeds: [] } : hello;
    if (isOther) this.forget();
    for (const [id, number] of hello.event_numbers ?? []) this.eventNumbers.set(id, number);
    return isOther;
  }

  /** @param {Picture} picture */
  takePicture(picture) {
    if (this.picture && picture.time_s < this.picture.time_s) {
      if (picture.replay) this.rewind(picture.time_s);
      else this.forget();
    }
    this.picture = this.picture ? { ...this.picture, ...picture } : picture;
    this.judged = new Map(picture.judged ?? []);
    if (picture.truth) this.takeTruth(picture.truth);
    const { workload, time_s } = this.picture;
    const last = this.history[this.history.length - 1];
    if (picture.replay && last && time_s - last[0] > JUMP_S) {
      this.history = [];
      this.isCaughtUp = false;
    }
    if (workload && (!last || last[0] < time_s)) this.history.push([time_s, workload.rate_1s_hz, workload.rate_60s_hz]);
    if (this.history.length > MAX_HISTORY) this.history.splice(0, this.history.length - MAX_HISTORY);
    const items = picture.inbox ?? [];
    const oldest = items.reduce((least, item) => Math.min(least, placeOf(item)), Infinity);
    if (oldest !== Infinity && oldest > this.newest + 1) this.isCaughtUp = false;
    this.addItems(items);
    for (const [line, count] of picture.counts ?? []) this.counts.set(line, count);
  }

  /** @param {import("./types.js").Truth} truth */
  takeTruth(truth) {
    this.truth = truth;
    const sign = this.hello?.kind === "conductor" ? -1 : 1;
    for (const [id] of [...truth.events].sort((a, b) => a[3] - b[3] || a[0] - b[0]))
      if (!this.eventNumbers.has(id)) this.eventNumbers.set(id, sign * (this.eventNumbers.size + 1));
  }

  /** @param {CatchUp} answer */
  takeCatchUp(answer) {
    this.isCaughtUp = true;
    this.addItems(answer.inbox);
    this.counts = new Map(answer.counts);
    this.inbox = new Map([...this.inbox].sort((a, b) => placeOf(a[1]) - placeOf(b[1])));
    this.read = new Set(answer.read); // a replay that went back knows of fewer
    const known = new Map([...answer.history, ...this.history].map((row) => [row[0], row]));
    this.history = [...known.values()].sort((a, b) => a[0] - b[0]).slice(-MAX_HISTORY);
  }

  /** @param {InboxRow[]} items */
  addItems(items) {
    for (const item of [...items].sort((a, b) => placeOf(a) - placeOf(b))) {
      if (!this.inbox.has(item[0])) this.inbox.set(item[0], item);
      this.newest = Math.max(this.newest, placeOf(item));
    }
    for (const number of this.inbox.keys()) {
      if (this.inbox.size <= MAX_INBOX) break;
      this.counts.delete(this.inbox.get(number)?.[8] ?? number);
      this.inbox.delete(number);
      this.read.delete(number);
    }
  }

  /**
   * Forget what came after this time, since a replay went back.
   * @param {number} time_s
   */
  rewind(time_s) {
    const numbers = [...this.inbox].filter(([, item]) => item[1] > time_s).map(([number]) => number);
    for (const number of numbers) {
      this.inbox.delete(number);
      this.read.delete(number);
    }
    const last = [...this.inbox.values()].at(-1);
    this.newest = last ? placeOf(last) : -1;
    this.history = this.history.filter((row) => row[0] <= time_s);
    this.isCaughtUp = false; // a jump forward may have dropped what came before
  }

  /** Forget everything, since time went back or another run began. */
  forget() {
    this.picture = this.truth = this.theirs = null;
    this.inbox.clear();
    this.held = [];
    this.counts.clear();
    this.read.clear();
    this.eventNumbers.clear();
    this.history = [];
    this.isCaughtUp = false;
    this.newest = -1;
  }
}

/**
 * The place of an item in the order in which items were shown.
 * @param {InboxRow} item
 */
function placeOf(item) {
  return item[9] ?? item[0];
}
