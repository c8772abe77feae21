/** Forms: Likert scales, numbers, texts and choices. One about the situation hides what is known, or has a time limit. */

import { byId, element, make, setText } from "./dom.js";
import { retell, t } from "./language.js";
import { Question } from "./question.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./types.js").FormQuestion} FormQuestion */
/** @typedef {string | number | null} Answer */

export class FormPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.question = new Question(app, "form", () => this.open(), "form-missing");
    this.form = byId("form-form", HTMLFormElement);
    this.form.addEventListener("input", () => sessionStorage.setItem(this.stored, JSON.stringify(this.answers())));
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.send();
    });
  }

  get asked() {
    const probe = this.app.model.question;
    return probe?.kind === "form" ? probe : null;
  }

  /** Half-given answers belong to their run and form. */
  get stored() {
    return this.storedFor(this.asked?.form.name, this.asked?.number);
  }

  /**
   * @param {string | undefined} form
   * @param {number | null | undefined} number
   */
  storedFor(form, number) {
    return `deltaswarm-form/${this.app.model.hello?.run}/${form}/${number}`;
  }

  update() {
    const { asked, hello } = this.app.model;
    document.documentElement.toggleAttribute("data-hides", asked?.kind === "form" && asked.hides && hello?.kind !== "conductor");
    this.question.update();
    const left_s = this.asked?.left_s ?? null;
    setText(element("form-left"), left_s === null ? "" : t("{seconds} s left", { seconds: Math.ceil(left_s) }));
  }

  /** Build the form, with the answers from before a reload of the page. */
  open() {
    if (!this.asked) return;
    /** @type {Record<string, Answer>} */
    const before = JSON.parse(sessionStorage.getItem(this.stored) ?? "{}");
    const { form } = this.asked;
    setText(element("form-title"), t(form.title || form.name));
    setText(element("form-text"), retell(form.text));
    element("form-text").hidden = !form.text;
    setText(element("form-send"), this.asked.prompt ? t("Ready") : form.question.length ? t("Send answers") : t("Continue"));
    element("form-questions").replaceChildren(
      ...form.question.map((question, at) => field(question, at, before[question.name] ?? null)),
    );
    setText(element("form-missing"), "");
  }

  answers() {
    const given = new FormData(this.form);
    /** @type {Record<string, Answer>} */
    const answers = {};
    for (const [at, { name, kind }] of (this.asked?.form.question ?? []).entries()) {
      const value = given.get(`question-${at}`);
      if (typeof value !== "string" || value.trim() === "") continue;
      answers[name] = kind === "number" || kind === "likert" ? Number(value) : value;
    }
    return answers;
  }

  send() {
    if (!this.asked) return;
    const answers = this.answers();
    const { form, number } = this.asked;
    if (this.asked.prompt) return this.question.send({ type: "ready", form: form.name, number });
    const missing = form.question.filter(({ name, required }) => required && answers[name] === undefined);
    if (missing.length) return setText(element("form-missing"), t("Still to answer: {questions}", { questions: missing.map(({ text }) => t(text)).join(" ") }));
    this.question.send({ type: "form", form: form.name, number, answers });
  }

  /** Move to the question that is asked beside the map. */
  enter() {
    if (this.question.dialog.open) this.question.enter();
    else this.app.say(t("No question is asked."));
  }

  /**
   * Answers are noted: their draft goes, and the question, unless the next one is asked already.
   * @param {Extract<import("./types.js").Intent, { type: "form" | "ready" }>} intent
   */
  noted({ type, form, number }) {
    if (type === "form") sessionStorage.removeItem(this.storedFor(form, number));
    const { asked } = this;
    if (asked?.form.name === form && asked.number === number && Boolean(asked.prompt) === (type === "ready")) this.question.noted();
  }
}

/**
 * @param {FormQuestion} question
 * @param {number} at
 * @param {Answer} before
 */
function field(question, at, before) {
  const { kind, text, low, high } = question;
  const name = `question-${at}`;
  if (kind === "likert" || kind === "choice") {
    const points = Array.from({ length: high - low + 1 }, (_, point) => String(low + point));
    const radios = (kind === "likert" ? points : question.choices).map((value) => {
      const radio = make("input", { type: "radio", name, value });
      radio.checked = String(before) === value;
      return make("label", {}, radio, t(value));
    });
    const ends = make("div", { class: "ends" }, make("span", {}, t(question.low_text)), make("span", {}, t(question.high_text)));
    const parts = kind === "likert" ? [make("div", { class: "points" }, ...radios), ends] : radios;
    return make("fieldset", { class: `question ${kind}` }, make("legend", {}, t(text)), ...parts);
  }
  /** @type {HTMLInputElement | HTMLTextAreaElement} */
  let made;
  if (kind === "text") made = make("textarea", { name, id: name, rows: "3", maxlength: "2000" });
  else {
    const limits = { min: String(low), max: String(high), step: "any", autocomplete: "off" };
    made = make("input", { type: "number", name, id: name, ...limits });
  }
  made.value = String(before ?? "");
  return make("div", { class: "question" }, make("label", { for: name }, t(text)), made);
}
