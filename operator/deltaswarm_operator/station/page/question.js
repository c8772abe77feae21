/** A dialog that is open while a question has no answer; only an answer that is noted closes it. */

import { dialog, element, setText } from "./dom.js";
import { retell, t } from "./language.js";
import { whenPainted } from "./outbox.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./types.js").Intent} Intent */

export class Question {
  /**
   * @param {App} app
   * @param {"sheet" | "tlx" | "form"} kind of the probe, and the dialog's name
   * @param {() => void} fill prepares the form before it opens
   * @param {string} said the element that says what became of the answers
   */
  constructor(app, kind, fill, said) {
    this.app = app;
    this.kind = kind;
    this.fill = fill;
    this.said = element(said);
    this.dialog = dialog(kind);
    /** Whether the answers are noted, and only the next picture is still to say so. */
    this.isNoted = false;
    /** which question is asked; one form may follow another */
    this.of = "";
    /** the page's clock when the question was first painted [s] */
    this.shown_s = 0;
    /** whether the person was in the dialog when the last answer was sent, and so expects the next question there */
    this.isInside = false;
    this.dialog.addEventListener("keydown", (event) => event.key === "Escape" && event.preventDefault());
    this.dialog.addEventListener("close", () => this.update());
  }

  /** The answers that were given and are not noted yet. */
  get waiting() {
    const { asked } = this.app.model;
    return this.app.waiting((intent) =>
      intent.type === "form" || intent.type === "ready"
        ? asked?.kind === "form" && asked.form.name === intent.form && asked.number === intent.number && Boolean(asked.prompt) === (intent.type === "ready")
        : intent.type === this.kind,
    );
  }

  update() {
    const probe = this.app.model.question;
    const isAsked = probe?.kind === this.kind;
    const of = `${this.app.model.hello?.run}/${probe?.kind === "form" ? `${probe.form.name}/${probe.number}/${probe.prompt ? "ready" : ""}` : ""}`;
    if (!isAsked || of !== this.of) this.isNoted = false;
    if (isAsked && of !== this.of && this.dialog.open) this.dialog.close(); // the next one may be of the other kind
    if (isAsked) this.of = of;
    const isWanted = isAsked && !this.isNoted;
    if (isWanted !== this.dialog.open) {
      if (!isWanted) return this.dialog.close();
      this.show();
      const isPassing = probe?.kind === "form" && probe.left_s !== null;
      this.moveTo(isPassing ? element("asks") : document.body);
      if (isPassing) {
        this.dialog.open = true; // `show()` would take the focus from a person who types
        if (this.isInside && document.activeElement === document.body) this.enter();
        else this.app.say(t("You are asked a question: press q to go to it."));
      } else this.dialog.showModal();
    }
    if (isWanted) this.look();
  }

  /**
   * Put the dialog where it is shown; moving it must not move the focus.
   * @param {HTMLElement} where
   */
  moveTo(where) {
    const title = this.dialog.querySelector("h2");
    title?.removeAttribute("autofocus");
    if (this.dialog.parentElement !== where) where.append(this.dialog);
    title?.toggleAttribute("autofocus", where === document.body);
  }

  /** Move to the first field. */
  enter() {
    const first = this.dialog.querySelector("input, textarea, button");
    if (first instanceof HTMLElement) first.focus();
  }

  /** Fill in the form, and note when it is painted. */
  show() {
    this.fill();
    this.shown_s = 0;
    const { of } = this;
    whenPainted(`${this.kind}/${of}`, (shown_s) => {
      if (this.of === of) this.shown_s = shown_s;
    });
  }

  /** Keep answers that are on the way as they are, and say so if it takes long. */
  look() {
    const { waiting } = this;
    for (const part of this.dialog.querySelectorAll(".scroll, .row, label, button")) if (part instanceof HTMLElement) part.inert = waiting !== null;
    if (!waiting) return;
    setText(this.said, this.app.isLate(waiting.page_s) ? t("Not noted yet: there is no connection. Your answers stay here, and are sent again by themselves.") : t("Sending …"));
  }

  /**
   * Send the answers.
   * @param {Intent} intent
   */
  send(intent) {
    this.isInside = this.dialog.contains(document.activeElement);
    this.app.send(/** @type {Intent} */ ({ ...intent, ...(this.shown_s ? { shown_s: this.shown_s } : {}) }));
    this.look();
  }

  /** The answers are noted. */
  noted() {
    this.isNoted = true;
    setText(this.said, "");
    this.update();
  }

  /**
   * Ask again, since the answers were not accepted.
   * @param {string} why
   */
  refused(why) {
    this.look();
    setText(this.said, t("Not accepted: {why}.", { why: retell(why) }));
  }
}
