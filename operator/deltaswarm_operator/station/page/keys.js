/** Shortcuts, and the list of them. */

import { button, dialog, element, input, isTyping, make } from "./dom.js";

const STORED = "deltaswarm-shortcuts";

/** @typedef {{keys: string[], shown?: string, words: string, act: (key: string) => void, always?: boolean}} Shortcut */

export class Keys {
  /**
   * @param {Shortcut[]} shortcuts
   * @param {[string, string][]} others keys that work in one place only
   */
  constructor(shortcuts, others) {
    this.byKey = new Map(shortcuts.flatMap((shortcut) => shortcut.keys.map((key) => [key, shortcut])));
    this.help = dialog("help");
    this.isOn = input("shortcuts-on");
    this.isOn.checked = localStorage.getItem(STORED) !== "off";
    this.isOn.addEventListener("change", () => localStorage.setItem(STORED, this.isOn.checked ? "on" : "off"));
    const lines = [
      ...shortcuts.map(
        ({ keys, shown, words }) => /** @type {[string, string]} */ ([shown ?? keys.join(" or "), words]),
      ),
      ...others,
    ];
    element("help-list").replaceChildren(
      ...lines.flatMap(([keys, words]) => [
        make(
          "dt",
          {},
          ...keys.split(" ").map((key) => (key === "or" || key === "to" ? ` ${key} ` : make("kbd", {}, key))),
        ),
        make("dd", {}, words),
      ]),
    );
    button("help-open").addEventListener("click", () => this.help.showModal());
    button("help-close").addEventListener("click", () => this.help.close());
    document.addEventListener("keydown", (event) => this.take(event));
  }

  /** @param {KeyboardEvent} event */
  take(event) {
    if (event.defaultPrevented || event.ctrlKey || event.altKey || event.metaKey) return;
    if (isTyping(event.target) || document.querySelector("dialog[open]")) return;
    const shortcut = this.byKey.get(event.key);
    if (!shortcut || (!this.isOn.checked && !shortcut.always)) return;
    event.preventDefault();
    shortcut.act(event.key);
  }
}
