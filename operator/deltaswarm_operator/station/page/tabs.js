/** Tabs: one panel at a time, arrow keys between them. */

import { element } from "./dom.js";

export class Tabs {
  /** @param {() => void} onShow */
  constructor(onShow) {
    this.onShow = onShow;
    /** @type {HTMLElement[]} */
    this.tabs = Array.from(document.querySelectorAll('[role="tab"]'));
    for (const [at, tab] of this.tabs.entries()) {
      tab.addEventListener("click", () => this.show(tab.id));
      tab.addEventListener("keydown", (event) => {
        const by = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
        const next = this.tabs[(at + by + this.tabs.length) % this.tabs.length];
        if (!by || !next) return;
        this.show(next.id);
        next.focus();
      });
    }
  }

  /** @param {string} id */
  show(id) {
    for (const tab of this.tabs) {
      const isChosen = tab.id === id;
      tab.setAttribute("aria-selected", String(isChosen));
      tab.tabIndex = isChosen ? 0 : -1;
      element(tab.getAttribute("aria-controls") ?? "").hidden = !isChosen;
    }
    this.onShow();
  }
}
