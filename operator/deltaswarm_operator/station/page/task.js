/** The participant's task: what it is, and the judgement of the selected event. */

import { button, element, setText } from "./dom.js";
import { later, t } from "./language.js";
import { eventName } from "./words.js";

/** @typedef {import("./types.js").App} App */

const CLASSES = [later("target"), later("decoy")];

export class TaskPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    for (const answer of CLASSES) button(`judge-${answer}`).addEventListener("click", () => this.judge(answer));
  }

  /** The reported event that is selected. */
  get event() {
    const { selection, model } = this.app;
    return selection?.kind === "event" ? (model.picture?.events.find((row) => row[0] === selection.id)?.[0] ?? null) : null;
  }

  start() {
    const { goal, kind } = this.app.model.hello ?? {};
    element("task").hidden = !goal;
    setText(element("goal"), t(goal ?? ""));
    element("judge").hidden = kind !== "live";
    this.update();
  }

  /** @param {string} answer */
  judge(answer) {
    const { event } = this;
    if (element("task").hidden || element("judge").hidden || this.app.model.picture?.over) return;
    if (event === null) this.app.say(t("Select a reported event to judge it."));
    else this.app.send({ type: "judge", event, answer });
  }

  update() {
    const { event } = this;
    const given = event === null ? undefined : this.app.model.judged.get(event);
    setText(element("judge-event"), event === null ? t("No event is selected.") : t("Event {number} is", { number: eventName(event) }));
    for (const answer of CLASSES) {
      button(`judge-${answer}`).disabled = event === null || Boolean(this.app.model.picture?.over);
      button(`judge-${answer}`).setAttribute("aria-pressed", String(given === answer));
    }
  }
}
