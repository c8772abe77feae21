/** The participant's task: the next event to judge, and its judgement, beside the event on the map. */

import { CloseUp } from "./closeup.js";
import { button, byId, element, setText } from "./dom.js";
import { later, t } from "./language.js";
import { eventName } from "./words.js";

/** @typedef {import("./types.js").App} App */

const CLASSES = [later("target"), later("decoy")];
/** Distance from the event to its judgement [px]. */
const BESIDE_PX = 28;
/** How far the event may move before its judgement follows [px]. */
const NEAR_PX = 30;
const EDGE_PX = 4;

/**
 * @param {number} at
 * @param {number} most
 */
const within = (at, most) => Math.max(EDGE_PX, Math.min(at, most - EDGE_PX));

export class TaskPanel {
  /**
   * @param {App} app
   * @param {import("./view.js").View} view
   */
  constructor(app, view) {
    this.app = app;
    this.view = view;
    this.where = element("judge");
    this.closeUp = new CloseUp(byId("closeup", HTMLCanvasElement));
    /** @type {[number, number, number]} the event beside which the judgement is, and where that was [px] */
    this.placedAt = [-1, 0, 0];
    /** @type {Set<number>} events that were to be judged when the person selected nothing: they are left alone */
    this.left = new Set();
    for (const answer of CLASSES) button(`judge-${answer}`).addEventListener("click", () => this.judge(answer));
    button("judge-next").addEventListener("click", () => this.next());
  }

  /** Whether this page judges now. */
  get isOn() {
    const { hello, picture } = this.app.model;
    return Boolean(hello?.goal) && hello?.kind === "live" && !picture?.over;
  }

  /** The reported event that is selected. */
  get event() {
    const { selection, model } = this.app;
    return (selection?.kind === "event" && model.picture?.events.find((row) => row[0] === selection.id)) || null;
  }

  /** Events without a judgement, that which was reported first at the front. */
  get open() {
    const { picture, judged } = this.app.model;
    return (picture?.events ?? []).filter((row) => !judged.has(row[0])).sort((a, b) => a[3] - b[3] || a[0] - b[0]);
  }

  start() {
    const { goal, kind } = this.app.model.hello ?? {};
    element("task").hidden = !goal;
    setText(element("goal"), t(goal ?? ""));
    element("steps").hidden = kind !== "live";
    element("closeup").hidden = kind === "researcher";
    this.update();
  }

  /** Take the selection that the person made; who selects nothing is left alone until another event is reported. */
  selected() {
    this.left = new Set(this.app.selection ? [] : this.open.map((row) => row[0]));
    this.update();
  }

  /** Select the oldest event without a judgement, or the one after that which is selected. */
  next() {
    if (!this.isOn) return;
    const { open } = this;
    const found = open[(open.findIndex((row) => row[0] === this.event?.[0]) + 1) % open.length];
    if (found) this.app.select({ kind: "event", id: found[0] }, true, false);
    else this.app.say(t("All events are judged."));
  }

  /** @param {string} answer */
  judge(answer) {
    if (!this.isOn) return;
    if (!this.event) this.app.say(t("Select a reported event to judge it."));
    else this.app.send({ type: "judge", event: this.event[0], answer });
  }

  update() {
    const { app, isOn, open } = this;
    const isFree = !app.selection || (app.selection.kind === "event" && !this.event);
    const oldest = open.find((row) => !this.left.has(row[0]));
    if (isOn && isFree && oldest) app.select({ kind: "event", id: oldest[0], byItself: true }, false, false);
    const event = this.event?.[0];
    const given = event === undefined ? undefined : app.model.judged.get(event);
    setText(element("judge-event"), event === undefined ? "" : t("Event {number} is", { number: eventName(event) }));
    for (const answer of CLASSES) {
      button(`judge-${answer}`).disabled = event === undefined || !isOn;
      button(`judge-${answer}`).setAttribute("aria-pressed", String(given === answer));
    }
    element("steps").classList.toggle("unneeded", app.model.judged.size > 0);
    const isNone = !app.model.picture?.events.length;
    const none = isNone ? t("None is reported yet.") : t("All are judged.");
    setText(element("judge-count"), open.length ? t("{count} to judge", { count: open.length }) : none);
    button("judge-next").disabled = !isOn || open.length === 0;
    button("judge-next").classList.toggle("first", given !== undefined && open.length > 0);
    this.place();
  }

  /** Put the judgement beside its event on the map, where it covers least, and leave it there while the event is near. */
  place() {
    const { app, event, where, view } = this;
    this.closeUp.draw(event);
    where.hidden = !this.isOn || !event;
    if (where.hidden) app.covered = null;
    if (!event || where.hidden) return;
    const [x, y] = view.toScreen(event[1], event[2]);
    const [of, at_x, at_y] = this.placedAt;
    const isNear = of === event[0] && Math.hypot(at_x - x, at_y - y) < NEAR_PX;
    if (isNear || (of === event[0] && where.matches(":hover"))) return;
    this.placedAt = [event[0], x, y];
    const [width, height] = [where.offsetWidth, where.offsetHeight];
    const marks = [...event[7], ...(app.model.picture?.events ?? []).map((row) => [row[1], row[2]])].map(([x_m = 0, y_m = 0]) => view.toScreen(x_m, y_m));
    const corners = [
      [x + BESIDE_PX, y - height / 2],
      [x - BESIDE_PX - width, y - height / 2],
      [x - width / 2, y - BESIDE_PX - height],
      [x - width / 2, y + BESIDE_PX],
    ].map(([left = 0, top = 0]) => /** @type {const} */ ([within(left, view.width - width), within(top, view.height - height)]));
    const covered = corners.map(([left, top]) => marks.filter(([at_x, at_y]) => at_x > left && at_x < left + width && at_y > top && at_y < top + height).length);
    const [left, top] = corners[covered.indexOf(Math.min(...covered))] ?? [0, 0];
    where.style.left = `${left}px`;
    where.style.top = `${top}px`;
    app.covered = { left, top, right: left + width, bottom: top + height };
  }
}
