/** The participant's call for help, and the conductor's answer to it. */

import { button, setText } from "./dom.js";
import { later, t } from "./language.js";

/** @typedef {import("./types.js").App} App */

/** What the button says; a press calls, or ends the call. */
const WORDS = { over: later("Call for help"), asked: later("Help is called"), seen: later("Help is on its way") };

export class HelpCall {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.call = button("help-me");
    this.call.addEventListener("click", () => this.send(this.state === "over" ? "asked" : "over"));
    button("help-seen").addEventListener("click", () => this.send("seen"));
  }

  /** The state that is noted, or on the way. */
  get state() {
    const waiting = this.app.waiting((intent) => intent.type === "help")?.intent;
    return (waiting?.type === "help" ? waiting.state : this.app.model.picture?.help) ?? "over";
  }

  /** @param {string} state */
  send(state) {
    this.app.send({ type: "help", state });
    this.update();
  }

  update() {
    const { hello } = this.app.model;
    const { state } = this;
    this.call.hidden = hello?.kind !== "live" || !hello.panels?.includes("help");
    this.call.setAttribute("aria-pressed", String(state !== "over"));
    setText(this.call, t(WORDS[/** @type {keyof typeof WORDS} */ (state)] ?? WORDS.over));
    button("help-seen").hidden = hello?.kind !== "conductor" || state !== "asked";
  }
}
