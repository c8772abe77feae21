/** The conductor's page: what the participant has selected, does and answers, and the truth beside the knowledge. */

import { button, element, input, keepRows, make, setText } from "./dom.js";
import { clock } from "./words.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./types.js").Act} Act */

const MAX_ACTS = 200;
const SURE_MS = 5000;
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
    this.endAt_ms = -Infinity;
    /** @type {Record<string, string>} how the participant's page looks now */
    this.looks = {};
    button("run-end").addEventListener("click", () => this.end());
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

  /** Whose session this is, which of its runs, and its condition: the heading of the conductor's page. */
  get title() {
    const { hello } = this.app.model;
    if (hello?.kind !== "conductor") return "";
    const [number, count] = hello.place ?? [];
    const place = count === undefined ? "" : number ? `run ${number} of ${count}` : "training";
    const { participant, condition } = hello.session ?? {};
    return [participant, place, condition && `condition ${condition.replace(/^\d+ /, "")}`, hello.run].filter(Boolean).join(" · ");
  }

  /** End the run at the second press: it is not complete then. */
  end() {
    const isSure = performance.now() - this.endAt_ms < SURE_MS;
    this.endAt_ms = performance.now();
    if (isSure) this.app.send({ type: "end" });
    else this.app.say("Press again to end the run, which is then not complete; the session stops.");
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
    const next = this.app.model.picture?.next;
    setText(element("next-question"), next ? `Next question: ${next.what} at ${clock(next.at_s)}` : "No more questions while the run goes on");
    element("conduct").hidden = this.app.model.hello?.kind !== "conductor";
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
