/** What the participant has selected, does and answers: for the conductor as it happens, in a replay by its time. */

import { button, element, input, keepRows, make, setText } from "./dom.js";
import { showMarks } from "./marks.js";
import { clock } from "./words.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./types.js").Act} Act */

const MAX_ACTS = { conductor: 200, replay: 10000 };
/** Rows of a list longer than this are slow. */
const MAX_SHOWN = 500;
const SURE_MS = 5000;
/** Acts that only say how the page looks. */
const LOOKS = ["selected", "tab", "zoom", "size"];

export class ConductPanel {
  /**
   * @param {App} app
   * @param {(time_s: number) => void} seek
   * @param {() => void} onTruth
   */
  constructor(app, seek, onTruth) {
    this.app = app;
    /** @type {[number, Act][]} with their number on this page */
    this.acts = [];
    this.count = 0;
    this.endAt_ms = -Infinity;
    /** @type {[number, string][]} when the participant selected something in a replayed run, and what */
    this.selections = [];
    element("acts-list").addEventListener("click", (event) => {
      const row = event.target instanceof Element ? event.target.closest("li") : null;
      if (row && app.model.hello?.kind === "replay") seek(Number(row.dataset["time"]));
    });
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
    [this.acts, this.looks, this.selections] = [[], {}, []];
  }

  /** @param {Act[]} acts */
  take(acts) {
    const { kind } = this.app.model.hello ?? {};
    for (const act of acts) {
      const isLook = act.kind === "page" && LOOKS.includes(act.name ?? "");
      if (isLook && act.name === "selected") this.selections.push([act.time_s, act.text ?? ""]);
      if (isLook) this.looks[act.name ?? ""] = act.text ?? "";
      else this.acts.push([this.count++, act]);
    }
    for (const kept of [this.acts, this.selections]) kept.splice(0, kept.length - MAX_ACTS[kind === "replay" ? "replay" : "conductor"]);
    if (kind === "replay") showMarks(this.app.model, [...this.acts.map(([, act]) => act), ...this.selections.map(([time_s, text]) => ({ time_s, kind: "selected", text }))]);
    this.follow();
  }

  /** Ring what the participant has selected: now, or at the time of the replay. */
  follow() {
    const { model } = this.app;
    const selected = model.hello?.kind === "replay" ? this.selections.filter(([time_s]) => time_s <= model.now_s).at(-1)?.[1] : this.looks["selected"];
    const [kind, id] = (selected ?? "").split(" ");
    model.theirs = kind === "agent" || kind === "event" ? { kind, id: Number(id) } : null;
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
    const { model } = this.app;
    const next = model.picture?.next;
    const when = next && (next.at_s < model.now_s ? `due since ${clock(next.at_s)}` : `at ${clock(next.at_s)}`);
    setText(element("next-question"), next ? `Next question: ${next.what} ${when}` : "No more questions while the run goes on");
    element("conduct").hidden = model.hello?.kind !== "conductor";
    const isReplay = model.hello?.kind === "replay";
    const create = () => make("li", {}, isReplay ? make("button", { type: "button", class: "link" }) : make("time"), make("b"), make("span", { class: "what" }));
    keepRows(
      element("acts-list"),
      [...this.acts].reverse().slice(0, MAX_SHOWN),
      ([number]) => String(number),
      create,
      (row, [, act]) => {
        const [time, kind, what] = row.children;
        if (!time || !kind || !what || time.textContent) return;
        setText(time, clock(act.time_s));
        row.dataset["time"] = String(act.time_s);
        setText(kind, act.by && act.by !== "person" ? `${act.kind} (${act.by})` : act.kind);
        const { name, target, value, items, event, text } = act;
        setText(what, [name, value, target && `to ${target}`, items && `items ${items}`, event && `event ${event}`, text].filter((part) => part !== undefined && part !== "").join(" "));
      },
    );
  }
}
