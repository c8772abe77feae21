/** The conductor's page: what the participant has selected, does and answers, and the truth beside the knowledge. */

import { element, input, keepRows, make, setText } from "./dom.js";
import { clock } from "./words.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./types.js").Act} Act */

const MAX_ACTS = 200;
/** Acts that only say how the page looks. */
const LOOKS = ["selected", "tab", "zoom", "size"];

export class ConductPanel {
  /**
   * @param {App} app
   * @param {() => void} onTruth
   */
  constructor(app, onTruth) {
    this.app = app;
    /** @type {[number, Act][]} with their number on this page */
    this.acts = [];
    this.count = 0;
    /** @type {Record<string, string>} how the participant's page looks now */
    this.looks = {};
    const truth = input("layer-truth");
    truth.addEventListener("change", () => {
      app.model.showsTruth = truth.checked;
      onTruth();
    });
  }

  /** Take a new hello. */
  start() {
    const isOffered = this.app.model.hello?.kind === "conductor";
    for (const label of input("layer-truth").labels ?? []) label.hidden = !isOffered;
  }

  /** Forget another run's acts. */
  forget() {
    [this.acts, this.looks] = [[], {}];
  }

  /** @param {Act[]} acts */
  take(acts) {
    for (const act of acts) {
      if (act.kind === "page" && LOOKS.includes(act.name ?? "")) this.looks[act.name ?? ""] = act.text ?? "";
      else this.acts.push([this.count++, act]);
    }
    this.acts.splice(0, this.acts.length - MAX_ACTS);
    const [kind, id] = (this.looks["selected"] ?? "").split(" ");
    this.app.model.theirs = kind === "agent" || kind === "event" ? { kind, id: Number(id) } : null;
    this.app.redraw();
  }

  /** How the participant's page looks, in words. */
  get words() {
    const { selected, tab } = this.looks;
    const parts = [selected ? `selected ${selected}` : "nothing selected"];
    if (tab) parts.push(`tab ${tab.replace("tab-", "").replace("commands", "orders")}`);
    return parts.join(", ");
  }

  update() {
    const create = () => make("li", {}, make("time"), make("b"), make("span", { class: "what" }));
    keepRows(
      element("acts-list"),
      [...this.acts].reverse(),
      ([number]) => String(number),
      create,
      (row, [, act]) => {
        const [time, kind, what] = row.children;
        if (!time || !kind || !what || time.textContent) return;
        setText(time, clock(act.time_s));
        setText(kind, act.by && act.by !== "person" ? `${act.kind} (${act.by})` : act.kind);
        const { name, target, value, items, event, text } = act;
        setText(what, [name, value, target && `to ${target}`, items && `items ${items}`, event && `event ${event}`, text].filter((part) => part !== undefined && part !== "").join(" "));
      },
    );
  }
}
