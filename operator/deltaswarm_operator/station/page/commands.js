/** Orders: a form for each command that the run offers, its target, and the outcomes of sent orders. */

import { field, read } from "./arguments.js";
import { button, byId, choice, element, input, keepRows, make, setOptions, setText } from "./dom.js";
import { later, retell, t } from "./language.js";
import { aim, clock, fate, order } from "./words.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./types.js").Form} Form */
/** @typedef {import("./types.js").Target} Target */
/** @typedef {import("./types.js").TargetKind} TargetKind */

/** @type {Record<TargetKind, string>} */
const KINDS = { all: later("all agents"), circle: later("a circle"), tree: later("a tree"), agent: later("one agent"), place: later("a place") };
/** A second click within this time is ignored. */
const TWICE_MS = 500;
const FIELDS = { x: "command-x", y: "command-y", radius: "command-radius" };

export class CommandPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.form = byId("command-form", HTMLFormElement);
    this.name = choice("command-name");
    this.tree = choice("command-tree");
    this.agent = choice("command-agent");
    this.formsOf = "";
    /** @type {Map<string, Record<string, string | number>>} arguments last given to each command */
    this.given = new Map();
    this.tookEvent = -1;
    this.sentAt_ms = -Infinity;
    this.name.addEventListener("change", () => {
      this.answer("");
      this.show();
    });
    this.form.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" || !(event.ctrlKey || event.metaKey)) return;
      event.preventDefault();
      this.form.requestSubmit();
    });
    this.form.addEventListener("input", () => this.app.redraw());
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.submit();
    });
  }

  /** @returns {Form | undefined} */
  get command() {
    return this.app.model.hello?.commands.find((form) => form.name === this.name.value);
  }

  /** @returns {TargetKind} */
  get kind() {
    const chosen = this.form.querySelector('input[name="target"]:checked');
    return chosen instanceof HTMLInputElement ? /** @type {TargetKind} */ (chosen.value) : "all";
  }

  /** Take a new hello's forms, if they differ from the previous ones. */
  start() {
    const { hello } = this.app.model;
    const forms = hello?.kind === "live" ? hello.commands : [];
    if (hello && hello.kind !== "live")
      setText(
        element("command-none"),
        hello.kind === "replay"
          ? t("A replay takes no orders; those of the run are listed as they were sent.")
          : t("Orders are given on the participant's page."),
      );
    element("command-none").hidden = forms.length > 0;
    this.form.hidden = forms.length === 0;
    const key = JSON.stringify(forms);
    if (key === this.formsOf) return;
    this.formsOf = key;
    setOptions(
      this.name,
      forms.map(({ name, refused }) => [name, refused ? t("{order} (nobody carries it out in this run)", { order: t(name) }) : t(name)]),
    );
    for (const [at, form] of forms.entries()) {
      const option = this.name.options[at];
      if (option) option.disabled = Boolean(form.refused);
    }
    if (this.command?.refused) this.name.selectedIndex = forms.findIndex((form) => !form.refused);
    this.show();
  }

  /** Show the chosen command's form. */
  show() {
    const { command } = this;
    setText(element("command-help"), t(command?.help ?? ""));
    const targets = command?.targets ?? [];
    element("command-targets").replaceChildren(
      ...targets.map((kind, at) => {
        const radio = make("input", {
          type: "radio",
          name: "target",
          value: kind,
          ...(at === 0 ? { checked: "" } : {}),
        });
        radio.addEventListener("change", () => this.aim());
        return make("label", {}, radio, t(KINDS[kind] ?? kind));
      }),
    );
    element("command-target").hidden = targets.length === 1 && targets[0] === "all";
    const given = this.given.get(command?.name ?? "") ?? {};
    element("command-arguments").replaceChildren(
      ...(command?.arguments ?? []).map((argument, at) => field(argument, at, given[argument.name])),
    );
    this.tree.value = this.agent.value = "";
    this.aim();
  }

  /** Show the fields of the chosen kind of target; the map helps to fill them in. */
  aim() {
    const { kind } = this;
    element("command-place").hidden = kind !== "place" && kind !== "circle";
    element("command-circle").hidden = kind !== "circle";
    element("command-trees").hidden = kind !== "tree";
    element("command-agents").hidden = kind !== "agent";
    const hasFields = this.command !== undefined && kind !== "all" && !element("panel-commands").hidden;
    this.app.pick = !hasFields
      ? null
      : {
          kind,
          target: () => this.half(),
          place: (x_m, y_m) => this.put({ x: x_m, y: y_m }),
          radius: (radius_m) => this.put({ radius: radius_m }),
          agent: (id) => this.take(id),
          event: (id) => this.takeEvent(id),
        };
    const { selection } = this.app;
    if (selection?.kind === "agent") this.take(selection.id);
    if (selection?.kind === "event" && selection.id !== this.tookEvent) this.takeEvent(selection.id);
    this.app.redraw();
  }

  /** @param {Partial<Record<keyof typeof FIELDS, number>>} values */
  put(values) {
    for (const [name, value] of Object.entries(values))
      input(FIELDS[/** @type {keyof typeof FIELDS} */ (name)]).value = value.toFixed(1);
    this.app.redraw();
  }

  /**
   * Take an agent that was chosen on the map or in a list.
   * @param {number} id
   */
  take(id) {
    const found = this.app.model.agents.find((agent) => agent[0] === id);
    const root = found && (found[5] >= 0 ? found[5] : found[3] === "root" ? id : -1);
    this.lists();
    if (this.kind === "agent") this.agent.value = String(id);
    if (this.kind === "tree" && root !== undefined && root >= 0) this.tree.value = String(root);
    this.app.redraw();
  }

  /**
   * Take a chosen event: its place becomes the order's target.
   * @param {number} id
   */
  takeEvent(id) {
    const found = this.app.model.events.find((event) => event[0] === id);
    if (!found || (this.kind !== "place" && this.kind !== "circle")) return;
    this.tookEvent = id;
    this.put({ x: found[1], y: found[2] });
  }

  /** Return the target as far as it is filled in. */
  half() {
    const number = (/** @type {string} */ id) => (input(id).value === "" ? undefined : input(id).valueAsNumber);
    const chosen = (/** @type {HTMLSelectElement} */ list) => (list.value === "" ? undefined : Number(list.value));
    const { kind } = this;
    if (kind === "tree") return { root: chosen(this.tree) };
    if (kind === "agent") return { agent: chosen(this.agent) };
    const place = { x_m: number(FIELDS.x), y_m: number(FIELDS.y) };
    return kind === "circle" ? { ...place, radius_m: number(FIELDS.radius) } : kind === "place" ? place : {};
  }

  /** @param {ReturnType<import("./types.js").Pick["target"]>} target */
  checkPlace({ x_m, y_m, radius_m }) {
    const [width_m = Infinity, height_m = Infinity] = this.app.model.hello?.arena_m ?? [];
    for (const [name, value, high] of /** @type {const} */ ([
      ["x", x_m, width_m],
      ["y", y_m, height_m],
    ]))
      if (value !== undefined && !(value >= 0 && value <= high))
        throw new Error(t("{name} must be from 0 to {high} m (got {value})", { name, high, value }));
    if (radius_m !== undefined && !(radius_m > 0)) throw new Error(t("the radius must be above 0 m (got {value})", { value: radius_m }));
  }

  submit() {
    const { command, kind } = this;
    if (!command || performance.now() - this.sentAt_ms < TWICE_MS) return;
    try {
      const target = this.half();
      if (Object.values(target).some((value) => value === undefined || Number.isNaN(value)))
        throw new Error(
          kind === "tree" || kind === "agent"
            ? t("choose {target} first", { target: t(KINDS[kind]) })
            : t("fill in the place, or click on the map"),
        );
      this.checkPlace(target);
      const values = Object.fromEntries(command.arguments.map((argument, at) => [argument.name, read(argument, at)]));
      this.given.set(command.name, values);
      this.sentAt_ms = performance.now();
      const aim = /** @type {import("./types.js").Target} */ ({ kind, ...target });
      this.app.send({ type: "command", name: command.name, target: aim, arguments: values });
      this.answer(t("Sending …"));
    } catch (error) {
      this.answer(t("Not sent: {why}.", { why: error instanceof Error ? error.message : String(error) }), true);
    }
  }

  /**
   * @param {string} text
   * @param {boolean} isBad
   */
  answer(text, isBad = false) {
    const where = element("command-answer");
    setText(where, text);
    where.classList.toggle("bad", isBad);
  }

  /** @param {number} number */
  accepted(number) {
    this.answer(t("Sent as order {number}.", { number }));
  }

  /** @param {string} why */
  refused(why) {
    this.answer(t("Not sent: {why}.", { why: retell(why) }), true);
  }

  lists() {
    const { roots, agents } = this.app.model;
    const ids = agents.map((agent) => agent[0]).sort((a, b) => a - b);
    setOptions(this.tree, [
      ["", roots.length ? t("choose a tree") : t("no tree is known")],
      ...roots.map((root) => /** @type {[string, string]} */ ([String(root), t("tree of agent {number}", { number: root })])),
    ]);
    setOptions(this.agent, [
      ["", t("choose an agent")],
      ...ids.map((id) => /** @type {[string, string]} */ ([String(id), t("agent {number}", { number: id })])),
    ]);
  }

  update() {
    const { hello, picture, now_s } = this.app.model;
    button("command-send").disabled = Boolean(picture?.over);
    if (picture?.over && !this.form.hidden) this.answer(t("The run is over: it takes no more orders."));
    this.lists();
    const rows = [...(picture?.commands ?? [])].sort((a, b) => b[0] - a[0]);
    const create = () => make("li", {}, make("b"), make("span", { class: "what" }), make("span", { class: "state" }), make("span", { class: "worth" }));
    keepRows(
      element("fates"),
      rows,
      (row) => String(row[0]),
      create,
      (line, row) => {
        line.dataset["state"] = row[9];
        const [title, what, state, worth] = line.children;
        if (!title || !what || !state || !worth) return;
        setText(worth, hello?.worth?.[String(row[0])] ?? "");
        setText(title, `${row[0]} · ${order(row)}`);
        const told = { target: aim(row[2]), time: clock(row[4]), outcome: fate(row, now_s) };
        const bySystem = row[12] === "system";
        setText(what, bySystem ? t("to {target}, sent by the system {time}: {outcome}", told) : t("to {target}, sent {time}: {outcome}", told));
        const done = { count: row[6], total: hello?.agents ?? 0 };
        const ofAll = row[2][0] === "all" && done.total ? t("done by {count} of {total}", done) : t("done by {count}", done);
        setText(state, row[9] === "done" ? ofAll : t(row[9]));
      },
    );
    element("fates-none").hidden = rows.length > 0;
  }
}
