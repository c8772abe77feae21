/** A dialog that is open while a question has no answer; only an answer closes it. */

import { dialog } from "./dom.js";

/** @typedef {import("./types.js").App} App */

export class Question {
  /**
   * @param {App} app
   * @param {"sheet" | "tlx" | "form"} kind of the probe, and the dialog's name
   * @param {() => void} fill prepares the form before it opens
   */
  constructor(app, kind, fill) {
    this.app = app;
    this.kind = kind;
    this.fill = fill;
    this.dialog = dialog(kind);
    this.isSent = false;
    /** which question is asked; one form may follow another */
    this.of = "";
    this.dialog.addEventListener("keydown", (event) => event.key === "Escape" && event.preventDefault());
    this.dialog.addEventListener("close", () => this.update());
  }

  update() {
    const probe = this.app.model.question;
    const isAsked = probe?.kind === this.kind;
    const of = `${this.app.model.hello?.run}/${probe?.kind === "form" ? `${probe.form.name}/${probe.number}` : ""}`;
    if (!isAsked || of !== this.of) this.isSent = false;
    if (isAsked && of !== this.of && this.dialog.open) this.fill();
    if (isAsked) this.of = of;
    const isWanted = isAsked && !this.isSent;
    if (isWanted === this.dialog.open) return;
    if (!isWanted) return this.dialog.close();
    this.fill();
    if (probe?.kind === "form" && probe.left_s !== null) this.dialog.show();
    else this.dialog.showModal();
  }

  /** @param {boolean} isSent */
  answer(isSent) {
    this.isSent = isSent;
    this.update();
  }
}
