/** NASA-TLX at the end of a run: six scales of 21 marks, from 0 to 100, and optionally 15 pairs on a page of their own. */

import { button, element, make, setText } from "./dom.js";
import { later, t } from "./language.js";
import { Question } from "./question.js";

/** @typedef {import("./types.js").App} App */

/**
 * Half-given answers belong to their run: the next participant must not find them.
 * @param {string} run
 */
const storedOf = (run) => `deltaswarm-tlx/${run}`;

const [LOW, HIGH] = [later("very low"), later("very high")];
/** @typedef {{key: string, title: string, within: string, definition: string, low: string, high: string}} Scale `within`: the title in a sentence */
/** @type {Scale[]} */
const SCALES = [
  {
    key: "mental",
    title: later("Mental demand"),
    within: later("mental demand"),
    definition: later("How much mental and perceptual activity was required (thinking, deciding, calculating, remembering, looking, searching)? Was the task easy or demanding, simple or complex?"),
    low: LOW,
    high: HIGH,
  },
  {
    key: "physical",
    title: later("Physical demand"),
    within: later("physical demand"),
    definition: later("How much physical activity was required (pushing, pulling, turning, controlling, activating)? Was the task easy or demanding, slow or brisk, slack or strenuous?"),
    low: LOW,
    high: HIGH,
  },
  {
    key: "temporal",
    title: later("Temporal demand"),
    within: later("temporal demand"),
    definition: later("How much time pressure did you feel due to the rate or pace at which the tasks occurred? Was the pace slow and leisurely or rapid and frantic?"),
    low: LOW,
    high: HIGH,
  },
  {
    key: "performance",
    title: later("Performance"),
    within: later("performance"),
    definition: later("How successful do you think you were in accomplishing the goals of the task? How satisfied were you with your performance in accomplishing these goals?"),
    low: later("perfect"),
    high: later("failure"),
  },
  {
    key: "effort",
    title: later("Effort"),
    within: later("effort"),
    definition: later("How hard did you have to work, mentally and physically, to accomplish your level of performance?"),
    low: LOW,
    high: HIGH,
  },
  {
    key: "frustration",
    title: later("Frustration"),
    within: later("frustration"),
    definition: later("How insecure, discouraged, irritated, stressed and annoyed, or secure, gratified, content, relaxed and complacent did you feel during the task?"),
    low: LOW,
    high: HIGH,
  },
];

export class TlxPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.question = new Question(app, "tlx", () => this.open(), "tlx-missing");
    /** @type {{scales: Record<string, number>, pairs: Record<string, string>, isSecond?: boolean}} `isSecond`: the page of the pairs */
    this.answers = { scales: {}, pairs: {} };
    button("tlx-send").addEventListener("click", () => this.goOn());
  }

  /** The pairs in their drawn order; none if there are no weights. */
  get pairs() {
    const { asked } = this.app.model;
    return asked?.kind === "tlx" ? (asked.pairs ?? []) : [];
  }

  get stored() {
    return storedOf(this.app.model.hello?.run ?? "");
  }

  update() {
    this.question.update();
  }

  /** Build the form, with the answers from before a reload of the page. */
  open() {
    this.answers = JSON.parse(sessionStorage.getItem(this.stored) ?? "null") ?? { scales: {}, pairs: {} };
    element("tlx-scales").replaceChildren(...SCALES.map((scale) => this.slider(scale)));
    element("tlx-pairs").replaceChildren(...this.pairs.map(([first, second]) => this.pair(first, second)));
    this.note();
  }

  /** @param {Scale} scale */
  slider({ key, title, definition, low, high }) {
    const before = this.answers.scales[key];
    const id = `tlx-${key}`;
    const slider = make("input", { type: "range", id, min: "0", max: "100", step: "5", "aria-describedby": `${id}-question` });
    slider.value = String(before ?? 50);
    const show = () => {
      const value = this.answers.scales[key];
      slider.dataset["answered"] = String(value !== undefined);
      if (value === undefined) slider.setAttribute("aria-valuetext", t("not answered yet"));
      else slider.removeAttribute("aria-valuetext");
    };
    const take = () => {
      this.answers.scales[key] = slider.valueAsNumber;
      show();
      this.note();
    };
    for (const kind of ["input", "change", "pointerup"]) slider.addEventListener(kind, take);
    slider.addEventListener("keydown", (event) => {
      if (event.key === " " || event.key === "Enter") take();
    });
    show();
    const ends = make("div", { class: "ends" }, make("span", {}, t(low)), make("span", {}, t(high)));
    return make("div", { class: "scale" }, make("label", { for: id }, t(title)), make("p", { id: `${id}-question` }, t(definition)), slider, ends);
  }

  /**
   * @param {string} first
   * @param {string} second
   */
  pair(first, second) {
    const name = [first, second].sort().join("-");
    const scales = SCALES.filter(({ key }) => key === first || key === second).sort((a) => (a.key === first ? -1 : 1));
    const choices = scales.map(({ key, title, definition }) => {
      const radio = make("input", { type: "radio", name, value: key });
      radio.checked = this.answers.pairs[name] === key;
      radio.addEventListener("change", () => {
        this.answers.pairs[name] = key;
        this.note();
      });
      return make("label", { title: t(definition) }, radio, t(title));
    });
    const [one, other] = scales.map(({ title, within }) => [t(title), t(within)]);
    return make("fieldset", { class: "pair" }, make("legend", { class: "unseen" }, t("{scale} or {other}", { scale: one?.[0] ?? "", other: other?.[1] ?? "" })), ...choices);
  }

  /** Store the answers, and show what is missing on the page that is open. */
  note() {
    sessionStorage.setItem(this.stored, JSON.stringify(this.answers));
    const { scales, pairs, isSecond = false } = this.answers;
    const open = SCALES.filter(({ key }) => scales[key] === undefined).map(({ within }) => t(within));
    const left = this.pairs.length - Object.keys(pairs).length;
    const missing = isSecond ? (left ? [t("{count} of {total} pairs", { count: left, total: this.pairs.length })] : []) : open;
    element("tlx-scales").hidden = isSecond;
    element("tlx-weights").hidden = !isSecond;
    setText(button("tlx-send"), isSecond || !this.pairs.length ? t("Send answers") : t("Continue"));
    button("tlx-send").disabled = missing.length > 0;
    setText(element("tlx-missing"), missing.length ? t("Still to answer: {scales}.", { scales: missing.join(", ") }) : t("All is answered."));
  }

  /** Go on to the pairs, or send the answers. */
  goOn() {
    if (this.pairs.length && !this.answers.isSecond) {
      this.answers.isSecond = true;
      this.note();
      return element("tlx-title").focus();
    }
    const { scales, pairs } = this.answers;
    const chosen = Object.values(pairs);
    const weights = this.pairs.length ? Object.fromEntries(SCALES.map(({ key }) => [key, chosen.filter((other) => other === key).length])) : null;
    this.question.send({ type: "tlx", scales, weights });
  }

  /** The answers are noted: their draft goes. */
  noted() {
    sessionStorage.removeItem(this.stored);
    this.question.noted();
    this.app.say(t("Thank you: your answers are noted."));
  }
}
