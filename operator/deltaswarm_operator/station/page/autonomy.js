/** Who sets delta: what the system is about to change, and the person's veto. */

import { button, element, setText } from "./dom.js";
import { later, t } from "./language.js";

/** @typedef {import("./types.js").App} App */

const WHO = {
  operator: "",
  swarm: later("The agents choose delta themselves."),
  system: later("The system sets delta. You can veto a change before it is made."),
  budget: later("The system sets delta, so that messages keep within a budget."),
};

export class AutonomyPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.where = element("proposal");
    button("veto").addEventListener("click", () => this.veto());
  }

  start() {
    const who = this.app.model.hello?.sets_delta ?? "operator";
    setText(element("sets-delta"), t(WHO[who]));
    element("sets-delta").hidden = who === "operator";
  }

  veto() {
    const { proposal } = this.app.model.picture ?? {};
    if (proposal && !button("veto").hidden) this.app.send({ type: "veto", delta: proposal.delta });
  }

  update() {
    const { hello, picture } = this.app.model;
    const proposal = picture?.proposal;
    this.where.hidden = !proposal;
    if (!proposal) return;
    setText(element("proposal-text"), t("The system sets delta to {delta}", { delta: proposal.delta }));
    setText(element("proposal-left"), t("in {seconds} s", { seconds: Math.ceil(proposal.left_s) }));
    button("veto").hidden = hello?.kind !== "live";
  }
}
