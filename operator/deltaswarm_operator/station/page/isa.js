/** The ISA question, how busy the person is right now: five buttons, or keys 1 to 5, until its time is up. */

import { byId, dialog, element, make, setText } from "./dom.js";

/** @typedef {import("./types.js").App} App */

const ANSWERS = ["under-used", "relaxed", "comfortable", "high", "excessive"];

export class IsaPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.where = element("isa");
    /** @type {number | null} */
    this.number = null;
    this.answered = -1;
    const buttons = ANSWERS.map((words, at) => {
      const made = make(
        "button",
        { type: "button", "data-answer": String(at + 1) },
        make("b", {}, String(at + 1)),
        words,
      );
      made.addEventListener("click", () => this.answer(at + 1));
      return made;
    });
    element("isa-answers").replaceChildren(...buttons);
  }

  get isAsking() {
    return !this.where.hidden;
  }

  /** @param {number} answer */
  answer(answer) {
    if (this.number === null || !this.app.send({ type: "isa", number: this.number, answer })) return;
    this.answered = this.number;
    this.update();
    this.app.say(`Your answer ${answer} is noted.`);
  }

  update() {
    const probe = this.app.model.question;
    const { number: before } = this;
    const asked = probe?.kind === "isa" && probe.number !== this.answered ? probe : null;
    this.where.hidden = asked === null;
    this.number = asked?.number ?? null;
    if (before !== null && before !== this.number && before !== this.answered)
      this.app.say(`Question ${before + 1} is closed without an answer from this page.`);
    if (!asked) return;
    const left = byId("isa-left", HTMLProgressElement);
    if (before !== this.number) {
      dialog("help").close();
      left.max = asked.left_s;
    }
    setText(element("isa-title"), `How busy are you right now? (question ${asked.number + 1})`);
    left.value = asked.left_s;
    setText(element("isa-seconds"), `${Math.ceil(asked.left_s)} s left`);
  }

  /** Ask again while there is time, since the answer was not accepted. */
  reopen() {
    this.forget();
    this.update();
  }

  /** Forget what was answered: another run numbers its questions anew. */
  forget() {
    this.answered = -1;
  }
}
