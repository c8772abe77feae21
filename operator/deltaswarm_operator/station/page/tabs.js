/** Tabs: one panel at a time, arrow keys between them. */

import { element } from "./dom.js";

export class Tabs {
  /** @param {() => void} onShow */
  constructor(onShow) {
    this.onShow = onShow;
    this.chosen = "tab-commands";
    /** @type {HTMLElement[]} */
    this.tabs = Array.from(document.querySelectorAll('[role="tab"]'));
    for (const tab of this.tabs) {
      tab.addEventListener("click", () => this.show(tab.id));
      tab.addEventListener("keydown", (event) => {
        const by = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
        const offered = this.tabs.filter((other) => !other.hidden);
        const next = offered[(offered.indexOf(tab) + by + offered.length) % offered.length];
        if (!by || !next) return;
        this.show(next.id);
        next.focus();
      });
    }
  }

  /**
   * Offer a tab, or hide it if it is of no use.
   * @param {string} id
   * @param {boolean} isOffered
   */
  offer(id, isOffered) {
    element(id).hidden = !isOffered;
    const first = this.tabs.find((tab) => !tab.hidden);
    if (element(this.chosen).hidden && first) this.show(first.id);
  }

  /** Whether no tab is offered. */
  get isEmpty() {
    return this.tabs.every((tab) => tab.hidden);
  }

  /** @param {string} id */
  show(id) {
    if (element(id).hidden) return;
    this.chosen = id;
    for (const tab of this.tabs) {
      const isChosen = tab.id === id;
      tab.setAttribute("aria-selected", String(isChosen));
      tab.tabIndex = isChosen ? 0 : -1;
      element(tab.getAttribute("aria-controls") ?? "").hidden = !isChosen;
    }
    this.onShow();
  }
}
