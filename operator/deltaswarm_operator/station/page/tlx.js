/** NASA-TLX at the end of a run: six scales from 0 to 100 in steps of 5, and optionally pairwise weights. */

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
/** @type {[string, string, string, string, string, string][]} key, title, title in a sentence, question, low end, high end */
const SCALES = [
  ["mental", later("Mental demand"), later("mental demand"), later("How mentally demanding was the task?"), LOW, HIGH],
  ["physical", later("Physical demand"), later("physical demand"), later("How physically demanding was the task?"), LOW, HIGH],
  ["temporal", later("Temporal demand"), later("temporal demand"), later("How hurried or rushed was the pace of the task?"), LOW, HIGH],
  [
    "performance",
    later("Performance"),
    later("performance"),
    later("How successful were you in accomplishing what you were asked to do?"),
    later("perfect"),
    later("failure"),
  ],
  ["effort", later("Effort"), later("effort"), later("How hard did you have to work to accomplish your level of performance?"), LOW, HIGH],
  [
    "frustration",
    later("Frustration"),
    later("frustration"),
    later("How insecure, discouraged, irritated, stressed and annoyed were you?"),
    LOW,
    HIGH,
  ],
];
const PAIRS = SCALES.flatMap((first, at) =>
  SCALES.slice(at + 1).map((second) => /** @type {const} */ ([first, second])),
);

export class TlxPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.question = new Question(app, "tlx", () => this.open(), "tlx-missing");
    /** @type {{scales: Record<string, number>, pairs: Record<string, string>}} */
    this.answers = { scales: {}, pairs: {} };
    button("tlx-send").addEventListener("click", () => this.send());
  }

  get asksWeights() {
    return Boolean(this.app.model.hello?.session?.asks.weights);
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
    element("tlx-weights").hidden = !this.asksWeights;
    element("tlx-pairs").replaceChildren(
      ...(this.asksWeights ? PAIRS.map(([first, second]) => this.pair(first, second)) : []),
    );
    this.note();
  }

  /** @param {typeof SCALES[number]} scale */
  slider([key, title, , question, low, high]) {
    const before = this.answers.scales[key];
    const id = `tlx-${key}`;
    const slider = make("input", {
      type: "range",
      id,
      min: "0",
      max: "100",
      step: "5",
      "aria-describedby": `${id}-question`,
    });
    slider.autofocus = key === SCALES[0]?.[0]; // otherwise the part that scrolls would have the focus
    slider.value = String(before ?? 50);
    slider.dataset["answered"] = String(before !== undefined);
    const shown = make("output", { for: id }, before === undefined ? "–" : String(before));
    const take = () => {
      this.answers.scales[key] = slider.valueAsNumber;
      slider.dataset["answered"] = "true";
      setText(shown, slider.value);
      this.note();
    };
    for (const kind of ["input", "change", "pointerup"]) slider.addEventListener(kind, take);
    slider.addEventListener("keydown", (event) => {
      if (event.key === " " || event.key === "Enter") take();
    });
    const ends = make("div", { class: "ends" }, make("span", {}, t(low)), make("span", {}, t(high)));
    return make(
      "div",
      { class: "scale" },
      make("label", { for: id }, t(title)),
      make("p", { id: `${id}-question` }, t(question)),
      shown,
      slider,
      ends,
    );
  }

  /**
   * @param {typeof SCALES[number]} first
   * @param {typeof SCALES[number]} second
   */
  pair(first, second) {
    const name = `${first[0]}-${second[0]}`;
    const choices = [first, second].map(([key, title]) => {
      const radio = make("input", { type: "radio", name, value: key });
      radio.checked = this.answers.pairs[name] === key;
      radio.addEventListener("change", () => {
        this.answers.pairs[name] = key;
        this.note();
      });
      return make("label", {}, radio, t(title));
    });
    return make(
      "fieldset",
      { class: "pair" },
      make("legend", { class: "unseen" }, t("{scale} or {other}", { scale: t(first[1]), other: t(second[2]) })),
      ...choices,
    );
  }

  /** Store the answers, and show what is missing. */
  note() {
    sessionStorage.setItem(this.stored, JSON.stringify(this.answers));
    const open = SCALES.filter(([key]) => this.answers.scales[key] === undefined).map(([, , title]) => t(title));
    const pairs = this.asksWeights ? PAIRS.length - Object.keys(this.answers.pairs).length : 0;
    const missing = [...open, ...(pairs ? [t("{count} of {total} pairs", { count: pairs, total: PAIRS.length })] : [])];
    button("tlx-send").disabled = missing.length > 0;
    setText(element("tlx-missing"), missing.length ? t("Still to answer: {scales}.", { scales: missing.join(", ") }) : t("All is answered."));
  }

  send() {
    const { scales, pairs } = this.answers;
    const chosen = Object.values(pairs);
    const weights = this.asksWeights
      ? Object.fromEntries(SCALES.map(([key]) => [key, chosen.filter((other) => other === key).length]))
      : null;
    this.question.send({ type: "tlx", scales, weights });
  }

  /** The answers are noted: their draft goes. */
  noted() {
    sessionStorage.removeItem(this.stored);
    this.question.noted();
    this.app.say(t("Thank you: your answers are noted."));
  }
}
