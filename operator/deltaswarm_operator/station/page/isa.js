/** The ISA question, how busy the person is right now: five buttons, or keys 1 to 5, until its time is up. */

import { byId, dialog, element, make, setText } from "./dom.js";
import { later, t } from "./language.js";
import { whenPainted } from "./outbox.js";

/** @typedef {import("./types.js").App} App */

const ANSWERS = [later("under-used"), later("relaxed"), later("comfortable"), later("high"), later("excessive")];

export class IsaPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.where = element("isa");
    /** @type {number | null} */
    this.number = null;
    this.answered = -1;
    /** the page's clock when the question was first painted [s] */
    this.shown_s = 0;
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
    if (this.number === null || this.waiting || !this.shown_s) return; // nobody answers what is not painted yet
    this.app.send({ type: "isa", number: this.number, answer, shown_s: this.shown_s });
    this.look();
  }

  /** The answer that was given and is not noted yet. */
  get waiting() {
    const found = this.app.waiting((intent) => intent.type === "isa" && intent.number === this.number)?.intent;
    return found?.type === "isa" ? found : null;
  }

  /** Keep an answer that is on the way as it is. */
  look() {
    const { waiting } = this;
    for (const made of this.where.querySelectorAll("button")) {
      made.disabled = waiting !== null;
      made.setAttribute("aria-pressed", String(made.dataset["answer"] === String(waiting?.answer)));
    }
  }

  /**
   * An answer is noted.
   * @param {number} number of the question
   * @param {number} answer
   */
  noted(number, answer) {
    this.answered = number;
    this.update();
    this.app.say(t("Your answer {answer} is noted.", { answer }));
  }

  update() {
    const probe = this.app.model.question;
    const { number: before, waiting: onTheWay } = this;
    const asked = probe?.kind === "isa" && probe.number !== this.answered ? probe : null;
    this.where.hidden = asked === null;
    this.number = asked?.number ?? null;
    if (before !== null && before !== this.number && before !== this.answered && !onTheWay)
      this.app.say(t("Question {number} is closed without an answer from this page.", { number: before + 1 }));
    if (!asked) return;
    const left = byId("isa-left", HTMLProgressElement);
    if (before !== this.number) {
      dialog("help").close();
      this.shown_s = 0;
      whenPainted(`isa/${this.app.model.hello?.run}/${asked.number}`, (shown_s) => {
        if (this.number === asked.number) this.shown_s = shown_s;
      });
      left.max = asked.left_s;
    }
    setText(element("isa-title"), t("How busy are you right now? (question {number})", { number: asked.number + 1 }));
    left.value = asked.left_s;
    setText(element("isa-seconds"), t("{seconds} s left", { seconds: Math.ceil(asked.left_s) }));
    this.look();
  }

  /** Forget what was answered: another run numbers its questions anew. */
  forget() {
    this.answered = -1;
  }
}
