/** Keyboard shortcuts, and their list. */

import { button, dialog, element, input, isTyping, make } from "./dom.js";
import { later } from "./language.js";

const STORED = "deltaswarm-shortcuts";
const TYPING_MS = 1200;
const OR = later("or");

/** @param {string} key */
const lower = (key) => (key.length === 1 ? key.toLowerCase() : key);

/** @typedef {{keys: string[], shown?: string, words: string, act: (key: string) => void, always?: boolean, inHelp?: () => boolean}} Shortcut */

export class Keys {
  /**
   * @param {Shortcut[]} shortcuts
   * @param {[string, string][]} others keys that work in one place only
   */
  constructor(shortcuts, others) {
    this.byKey = new Map(shortcuts.flatMap((shortcut) => shortcut.keys.map((key) => [key, shortcut])));
    /** when a letter that chooses an option of a list was last typed */
    this.typedAt_ms = -Infinity;
    this.help = dialog("help");
    this.isOn = input("shortcuts-on");
    this.isOn.checked = localStorage.getItem(STORED) !== "off";
    this.isOn.addEventListener("change", () => localStorage.setItem(STORED, this.isOn.checked ? "on" : "off"));
    const lines = [
      ...shortcuts.map(
        ({ keys, shown, words }) => /** @type {[string, string]} */ ([shown ?? keys.join(` ${OR} `), words]),
      ),
      ...others,
    ];
    element("help-list").replaceChildren(
      ...lines.map(([keys, words]) =>
        make(
          "div",
          {},
          make("dt", {}, ...keys.split(" ").map((key) => (key === OR || key === "–" ? ` ${key} ` : make("kbd", {}, key)))),
          make("dd", {}, words),
        ),
      ),
    );
    button("help-open").addEventListener("click", () => this.help.showModal());
    button("help-close").addEventListener("click", () => this.help.close());
    document.addEventListener("keydown", (event) => this.take(event));
  }

  /** @param {KeyboardEvent} event */
  take(event) {
    if (event.defaultPrevented || event.ctrlKey || event.altKey || event.metaKey) return;
    const { target } = event;
    const key = event.shiftKey ? event.key : lower(event.key); // whatever Caps Lock makes of a letter
    const shortcut = this.byKey.get(key) ?? this.byKey.get(lower(key));
    const open = document.querySelector("dialog:modal");
    if (open && !(open === this.help && shortcut?.inHelp?.())) return; // an answer goes through the help
    if (event.key === "Escape" && target instanceof HTMLElement && isTyping(target)) return target.blur();
    if (target instanceof HTMLSelectElement ? this.isChoosing(target, event) : isTyping(target)) return;
    if (!shortcut || (!this.isOn.checked && !shortcut.always)) return;
    event.preventDefault();
    shortcut.act(key);
  }

  /**
   * Whether a key chooses an option of a list; all other keys are shortcuts, even in a list.
   * @param {HTMLSelectElement} list
   * @param {KeyboardEvent} event
   */
  isChoosing(list, { key, timeStamp }) {
    if (key.length > 1 || key === " ") return true;
    const begins = [...list.options].some((option) => option.text.toLowerCase().startsWith(key.toLowerCase()));
    const isChoosing = begins || timeStamp - this.typedAt_ms < TYPING_MS;
    if (isChoosing) this.typedAt_ms = timeStamp;
    return isChoosing;
  }
}
