/** What the map shows, as lists for screen readers: reported agents and events, and nothing else. */

import { choice, element, keepRows, make, setText } from "./dom.js";
import { t } from "./language.js";
import { aboutAgent, aboutEvent, eventName, place } from "./words.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./types.js").Selection} Selection */
/** @typedef {{key: string, name: string, words: string, old: boolean}} Line */

const OLD_S = 30;

/**
 * @param {number} event
 * @param {import("./model.js").Model} model
 */
function judged(event, model) {
  const answer = model.judged.get(event);
  return answer ? `. ${t("Judged: {answer}", { answer: t(answer) })}` : "";
}

export class KnowledgePanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.agents = element("agents-list");
    this.events = element("events-list");
    this.order = choice("agents-order");
    this.order.addEventListener("change", () => this.update());
    this.listen(this.agents, "agent");
    this.listen(this.events, "event");
  }

  /**
   * @param {HTMLElement} list
   * @param {"agent" | "event"} kind
   */
  listen(list, kind) {
    list.addEventListener("click", (event) => {
      const row = event.target instanceof Element ? event.target.closest("li") : null;
      if (row) this.app.select({ kind, id: Number(row.dataset["key"]) }, true);
    });
  }

  update() {
    const { model } = this.app;
    const { agents, events, now_s } = model;
    const rows = [...agents].sort((a, b) =>
      this.order.value === "longest"
        ? a[6] - b[6]
        : this.order.value === "role"
          ? a[3].localeCompare(b[3]) || a[0] - b[0]
          : a[0] - b[0],
    );
    this.fill(
      this.agents,
      "agent",
      rows.map((agent) => ({
        key: String(agent[0]),
        name: String(agent[0]),
        old: now_s - agent[6] > OLD_S,
        words: aboutAgent(agent, model),
      })),
    );
    const sorted = [...events].sort((a, b) => a[3] - b[3] || a[0] - b[0]);
    this.fill(
      this.events,
      "event",
      sorted.map((event) => ({
        key: String(event[0]),
        name: eventName(event[0]),
        old: now_s - event[4] > OLD_S,
        words: t("at {place}, {about}", { place: place(event[1], event[2]), about: aboutEvent(event, model) }) + judged(event[0], model),
      })),
    );
    const total = model.hello?.agents ?? 0;
    setText(
      element("agents-count"),
      model.shownTruth
        ? `${agents.length} agents`
        : total
          ? t("{count} of {total} heard of", { count: agents.length, total })
          : t("{count} heard of", { count: agents.length }),
    );
    setText(element("events-count"), String(events.length));
  }

  /**
   * @param {HTMLElement} list
   * @param {"agent" | "event"} kind
   * @param {Line[]} lines
   */
  fill(list, kind, lines) {
    const { selection } = this.app;
    /** @param {Line} line */
    const create = ({ key, name }) => {
      const words = kind === "agent" ? t("agent {number}", { number: name }) : t("event {number}", { number: name });
      const link = make("button", { type: "button", class: "link" }, words);
      return make("li", { [`data-${kind}`]: key }, link, make("span", { class: "what" }));
    };
    keepRows(
      list,
      lines,
      (line) => line.key,
      create,
      (row, { key, words, old }) => {
        const what = row.querySelector(".what");
        if (what) setText(what, words);
        row.classList.toggle("old", old);
        const isSelected = selection?.kind === kind && String(selection.id) === key;
        if (row.classList.contains("selected") !== isSelected) {
          row.classList.toggle("selected", isSelected);
          row.querySelector("button")?.setAttribute("aria-pressed", String(isSelected));
          if (isSelected) row.scrollIntoView({ block: "nearest" });
        }
      },
    );
  }
}
