/** Inputs that the operator's process has not noted yet: kept, over a reload too, and sent in order until they are. */

import { questionComes, questionIsSeen } from "./held_keys.js";

/** @typedef {import("./types.js").Intent} Intent */
/** @typedef {import("./messages.js").Input} Input */
/** @typedef {{id: string, run: string, page_s: number, intent: Intent, sentAt_ms?: number | undefined}} Kept */

const STORED = "deltaswarm-outbox";
const LOOK_EVERY_MS = 100;
/** The station takes 60 messages a second. */
const MAX_PER_LOOK = 4;
/** Inputs that wait for their answer at a time. */
const MAX_ON_THE_WAY = 20;
/** What has no answer after this time is sent again. */
const AGAIN_MS = 2000;
/** Share of the round trip by which the time until then, or until the person is told, is longer. */
const PER_ROUND_TRIP = 2;
/** The station refuses what is longer, and the page would send it for ever. */
const MAX_BYTES = 128 * 1024 - 200;
/** After this time, and two round trips, the person is told that an input is not noted yet. */
const SLOW_S = 1.5;

/** The page's clock [s]: it begins with the wall clock and is not corrected afterwards. */
export const pageClock_s = () => (performance.timeOrigin + performance.now()) / 1000;

/**
 * Tell when a question was first painted, by the page's clock [s]; a page that is loaded again knows it still.
 * @param {string} question
 * @param {(shown_s: number) => void} then
 */
export function whenPainted(question, then) {
  const stored = `deltaswarm-shown/${question}`;
  questionComes();
  window.requestAnimationFrame(() =>
    window.requestAnimationFrame(() => {
      const shown_s = Number(sessionStorage.getItem(stored) ?? pageClock_s());
      sessionStorage.setItem(stored, String(shown_s));
      questionIsSeen();
      then(shown_s);
    }),
  );
}

export class Outbox {
  /** @param {(message: Intent & Input) => boolean} send sends a message if there is a connection */
  constructor(send) {
    this.send = send;
    /** how long an answer takes on this connection [s] */
    this.rtt_s = 0;
    this.run = "";
    this.isOpen = false;
    this.budget = MAX_PER_LOOK;
    this.count = 0;
    this.page = [...crypto.getRandomValues(new Uint8Array(8))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
    /** @type {Kept[]} in the order in which they were made */
    this.kept = JSON.parse(sessionStorage.getItem(STORED) ?? "[]");
    window.setInterval(() => {
      this.budget = MAX_PER_LOOK;
      this.look();
    }, LOOK_EVERY_MS);
  }

  /**
   * Begin with a connection to a run; return the inputs of another run, which is over.
   * @param {string} run
   */
  begin(run) {
    this.run = run;
    this.isOpen = true;
    const lost = this.kept.filter((one) => one.run !== run);
    this.kept = this.kept.filter((one) => one.run === run).map((one) => ({ ...one, sentAt_ms: undefined }));
    this.store();
    this.look();
    return lost.map((one) => one.intent);
  }

  end() {
    this.isOpen = false;
  }

  /**
   * Keep an input and send it; return whether it is short enough for that.
   * @param {Intent} intent
   */
  add(intent) {
    if (new TextEncoder().encode(JSON.stringify(intent)).length > MAX_BYTES) return false;
    this.count += 1;
    this.kept.push({ id: `${this.page}-${this.count}`, run: this.run, page_s: pageClock_s(), intent });
    this.store();
    this.look();
    return true;
  }

  /**
   * Forget an input that was answered; return it.
   * @param {string | null} id
   */
  settle(id) {
    const found = this.kept.find((one) => one.id === id);
    if (!found) return null;
    this.kept = this.kept.filter((one) => one !== found);
    this.store();
    this.look();
    return found.intent;
  }

  /**
   * The oldest input of this run that is not noted yet and fits.
   * @param {(intent: Intent) => boolean} fits
   */
  waiting(fits) {
    return this.kept.find((one) => one.run === this.run && fits(one.intent)) ?? null;
  }

  /** Whether everything is noted. */
  get isEmpty() {
    return this.kept.length === 0;
  }

  /**
   * Whether an input should have been noted by now.
   * @param {number} page_s when it was made
   */
  isLate(page_s) {
    return pageClock_s() - page_s > SLOW_S + PER_ROUND_TRIP * this.rtt_s;
  }

  /** Number of inputs that should have been noted by now; what the page notes by itself does not count. */
  get late() {
    return this.kept.filter((one) => one.intent.type !== "page" && this.isLate(one.page_s)).length;
  }

  store() {
    const stored = this.kept.map(({ id, run, page_s, intent }) => ({ id, run, page_s, intent }));
    try {
      sessionStorage.setItem(STORED, JSON.stringify(stored));
    } catch {
      // there is no room: what is kept is lost if the page is loaded again, and only then
    }
  }

  /** Send what is due, oldest first. */
  look() {
    const now_ms = performance.now();
    for (const one of this.isOpen ? this.kept.slice(0, MAX_ON_THE_WAY) : []) {
      if (one.sentAt_ms !== undefined && now_ms - one.sentAt_ms < AGAIN_MS + 1000 * PER_ROUND_TRIP * this.rtt_s) continue;
      if (this.budget <= 0) return;
      this.budget -= 1;
      if (!this.send({ ...one.intent, id: one.id, page_s: one.page_s, sent_s: pageClock_s() })) return;
      one.sentAt_ms = now_ms;
    }
  }
}
