/** Clock, pause, step and speed, and the time bar of a replay. */

import { button, choice, element, input, setOptions, setText } from "./dom.js";
import { t } from "./language.js";
import { clock, number, speed } from "./words.js";

/** @typedef {import("./types.js").App} App */

const SEEK_EVERY_MS = 100;
const JUMP_S = 10;
const REACHED_OVER_MS = 5000;
const ASKED_FOR_MS = 1000;

export class PacePanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.pause = button("pause");
    this.speeds = choice("speed");
    this.bar = input("seek");
    this.isDragging = false;
    this.seekAt_ms = -Infinity;
    /** @type {[number, number][]} wall time [ms] and the run's time [s] of the newest pictures */
    this.passed = [];
    this.reachedOf = "";
    /** the speed last asked for: the next key may come before a picture shows this speed */
    this.asked = 1;
    this.askedAt_ms = -Infinity;
    this.pause.addEventListener("click", () => this.toggle());
    button("step").addEventListener("click", () => this.step());
    let byPointer = false;
    this.speeds.addEventListener("pointerdown", () => (byPointer = true));
    this.speeds.addEventListener("keydown", () => (byPointer = false));
    this.speeds.addEventListener("change", () => {
      this.app.send({ type: "pace", speed: Number(this.speeds.value) });
      if (byPointer) this.speeds.blur(); // otherwise the next shortcut's letter might choose another speed
    });
    this.bar.addEventListener("input", () => this.drag());
    this.bar.addEventListener("change", () => this.drop());
    button("seek-back").addEventListener("click", () => this.jump(-JUMP_S));
    button("seek-on").addEventListener("click", () => this.jump(JUMP_S));
  }

  get state() {
    const { picture } = this.app.model;
    return picture?.replay ?? picture?.pace ?? { paused: false, speed: 1 };
  }

  toggle() {
    this.app.send({ type: "pace", paused: !this.state.paused });
  }

  step() {
    this.app.send({ type: "pace", steps: this.state.speed < 0 ? -1 : 1 });
  }

  /**
   * Go faster or slower; 0, as fast as possible, is the fastest speed.
   * @param {number} by
   */
  shift(by) {
    const speeds = [...(this.app.model.hello?.speeds ?? [])].sort((a, b) => (a || Infinity) - (b || Infinity));
    const now_ms = performance.now();
    const from = now_ms - this.askedAt_ms < ASKED_FOR_MS ? this.asked : this.state.speed;
    const next = speeds[speeds.indexOf(from) + by];
    if (next === undefined || !speeds.includes(from)) return;
    this.app.send({ type: "pace", speed: next });
    [this.asked, this.askedAt_ms] = [next, now_ms];
  }

  /** @param {number} time_s */
  seek(time_s) {
    const { replay } = this.app.model.picture ?? {};
    if (replay) this.app.send({ type: "seek", time_s: Math.min(replay.to_s, Math.max(replay.from_s, time_s)) });
  }

  /** @param {number} by_s */
  jump(by_s) {
    this.seek(this.app.model.now_s + by_s);
  }

  drag() {
    this.isDragging = true;
    setText(element("seek-time"), clock(this.bar.valueAsNumber));
    const now_ms = performance.now();
    if (now_ms - this.seekAt_ms < SEEK_EVERY_MS) return;
    this.seekAt_ms = now_ms;
    this.seek(this.bar.valueAsNumber);
  }

  drop() {
    this.isDragging = false;
    this.seek(this.bar.valueAsNumber);
  }

  /** The speed reached, if well below the wanted speed, or if that is as fast as possible. */
  reached() {
    const { now_s, picture } = this.app.model;
    const { paused, speed: wanted } = this.state;
    const now_ms = performance.now();
    const key = `${paused} ${wanted}`;
    if (key !== this.reachedOf || now_s < (this.passed.at(-1)?.[1] ?? 0)) this.passed = [];
    this.reachedOf = key;
    this.passed.push([now_ms, now_s]);
    while (now_ms - (this.passed[0]?.[0] ?? now_ms) > REACHED_OVER_MS) this.passed.shift();
    const [from_ms, from_s] = this.passed[0] ?? [now_ms, now_s];
    if (paused || wanted < 0 || picture?.over || picture?.replay || now_ms - from_ms < REACHED_OVER_MS / 2) return "";
    const found = (1000 * (now_s - from_s)) / (now_ms - from_ms);
    return wanted === 0 || found < 0.9 * wanted ? t("now {speed}×", { speed: number(found, found < 10 ? 1 : 0) }) : "";
  }

  update() {
    const { hello, picture, now_s } = this.app.model;
    if (!hello) return;
    const { paused } = this.state;
    setText(element("speed-reached"), this.reached());
    setText(
      element("time"),
      clock(picture?.over ? Math.min(now_s + hello.step_s, hello.duration_s || Infinity) : now_s),
    );
    element("time").style.minWidth = `${clock(hello.duration_s).length}ch`;
    setText(element("duration"), hello.duration_s > 0 ? t("of {time}", { time: clock(hello.duration_s) }) : "");
    setText(this.pause, paused ? t("▶ Go on") : t("❚❚ Pause"));
    this.pause.setAttribute("aria-pressed", String(paused));
    const isOver = Boolean(picture?.over) && hello.kind !== "replay";
    const canPace = hello.speeds.length > 0;
    for (const part of [this.pause, button("step"), this.speeds]) {
      part.disabled = isOver;
      part.hidden = !canPace;
    }
    const offered = hello.speeds.includes(this.state.speed) ? hello.speeds : [...hello.speeds, this.state.speed];
    setOptions(
      this.speeds,
      offered.map((value) => [String(value), speed(value)]),
    );
    if (document.activeElement !== this.speeds) this.speeds.value = String(this.state.speed);
    const replay = picture?.replay;
    element("replay").hidden = !replay;
    if (!replay || this.isDragging) return;
    this.bar.min = String(replay.from_s);
    this.bar.max = String(replay.to_s);
    this.bar.step = String(hello.step_s);
    this.bar.value = String(now_s);
    setText(element("seek-time"), clock(now_s));
    this.bar.setAttribute("aria-valuetext", clock(now_s));
    setText(element("seek-end"), clock(replay.to_s));
  }
}
