/** The sheet that a session asks for before it begins, and notes at any time. */

import { button, byId, element, input, make, setText } from "./dom.js";
import { retell, t } from "./language.js";
import { Question } from "./question.js";
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
    this.question = new Question(app, "sheet", () => this.open());
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
    if (!text) return;
    if (!this.app.send({ type: "note", text })) return this.app.say(t("The note is not sent: there is no connection."));
    const { lines } = this.notes;
    lines.push([this.app.model.now_s, text]);
    sessionStorage.setItem(NOTES, JSON.stringify({ run: this.run, lines }));
    this.list();
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
    const isSent = this.app.send({ type: "sheet", participant, condition, consent: true });
    setText(element("sheet-answer"), isSent ? "" : t("Not sent: there is no connection. Try again in a moment."));
    this.question.answer(isSent);
  }

  /**
   * Ask for the sheet again, since it was not accepted.
   * @param {string} why
   */
  reopen(why) {
    if (!this.question.isSent) return;
    this.question.answer(false);
    setText(element("sheet-answer"), t("Not accepted: {why}.", { why: retell(why) }));
  }
}
