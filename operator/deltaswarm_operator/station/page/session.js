/** The sheet that a session asks for before it begins, and notes at any time. */

import { button, byId, element, input, make, setText } from "./dom.js";
import { t } from "./language.js";
import { Question } from "./question.js";
import { check } from "./screen.js";
import { clock } from "./words.js";

/** @typedef {import("./types.js").App} App */

/**
 * A draft belongs to its run: the next participant must not find it.
 * @param {string} run
 */
const draftOf = (run) => `deltaswarm-note/${run}`;
const NOTES = "deltaswarm-notes";

/** @typedef {{run: string, lines: [number, string][]}} Notes time [s] and text of each */

export class SessionPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.question = new Question(app, "sheet", () => this.open(), "sheet-answer");
    this.text = byId("note-text", HTMLTextAreaElement);
    this.draftOf = "";
    this.text.addEventListener("input", () => sessionStorage.setItem(draftOf(this.run), this.text.value));
    this.text.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) this.note();
    });
    button("note-send").addEventListener("click", () => this.note());
    this.question.dialog.addEventListener("input", () => this.check());
    byId("sheet-form", HTMLFormElement).addEventListener("submit", (event) => {
      event.preventDefault();
      this.begin();
    });
  }

  note() {
    const text = this.text.value.trim();
    if (!text || this.isNoting) return;
    this.app.send({ type: "note", text });
    this.look();
  }

  /** Whether a note is on the way. */
  get isNoting() {
    return this.app.waiting((intent) => intent.type === "note") !== null;
  }

  /** Keep a note that is on the way as it is. */
  look() {
    this.text.readOnly = button("note-send").disabled = this.isNoting;
  }

  /**
   * A note is noted: its draft goes.
   * @param {string} text
   */
  noted(text) {
    const { lines } = this.notes;
    lines.push([this.app.model.now_s, text]);
    sessionStorage.setItem(NOTES, JSON.stringify({ run: this.run, lines }));
    this.list();
    this.look();
    if (this.text.value.trim() !== text) return;
    this.text.value = "";
    sessionStorage.removeItem(draftOf(this.run));
    this.app.say(t("Noted."));
  }

  get run() {
    return this.app.model.hello?.run ?? "";
  }

  /** @returns {Notes} the notes of this run, including those from before a reload of the page */
  get notes() {
    const notes = JSON.parse(sessionStorage.getItem(NOTES) ?? "null");
    return notes?.run === this.run ? notes : { run: this.run, lines: [] };
  }

  /** Take a new hello: what was half written for another run stays there. */
  start() {
    if (this.draftOf !== this.run) {
      this.draftOf = this.run;
      this.text.value = sessionStorage.getItem(draftOf(this.run)) ?? "";
      for (const field of [input("sheet-participant"), input("sheet-condition")]) field.value = "";
      input("sheet-agree").checked = false;
    }
    this.list();
  }

  list() {
    const rows = this.notes.lines.map(([time_s, text]) =>
      make("li", {}, make("time", {}, clock(time_s)), make("span", { class: "what" }, text)),
    );
    element("notes-list").replaceChildren(...rows.reverse());
  }

  update() {
    this.question.update();
    this.look();
  }

  open() {
    const sheet = this.app.model.hello?.session?.sheet;
    setText(element("sheet-consent"), t(sheet?.consent ?? ""));
    element("sheet-agreement").hidden = !sheet?.consent;
    const [participant, condition] = [input("sheet-participant"), input("sheet-condition")];
    for (const [field, planned] of /** @type {const} */ ([
      [participant, sheet?.participant],
      [condition, sheet?.condition],
    ])) {
      field.value ||= planned ?? "";
      field.readOnly = Boolean(planned);
    }
    this.check();
    check();
  }

  get hasConsent() {
    return element("sheet-agreement").hidden || input("sheet-agree").checked;
  }

  check() {
    button("sheet-begin").disabled = !this.hasConsent || !input("sheet-participant").value.trim();
  }

  begin() {
    if (!this.hasConsent) return;
    const [participant, condition] = [input("sheet-participant").value.trim(), input("sheet-condition").value.trim()];
    this.question.send({ type: "sheet", participant, condition, consent: true });
  }
}
