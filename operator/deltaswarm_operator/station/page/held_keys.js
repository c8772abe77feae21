/** Each press of a key counts once, and only for what was on the screen when it went down. */

import { isTyping } from "./dom.js";

/** Keys that move something as long as they are held. */
const MOVING = ["ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "+", "-", "=", "Tab"];

/** @type {Set<string>} keys that are down */
const down = new Set();
/** @type {Set<string>} those of them that went down before the newest question was painted: they do nothing */
const stale = new Set();
/** Whether a question has come that is not painted yet. */
let isUnseen = false;

/** A question has come: what is held now was not meant for it. */
export function questionComes() {
  for (const key of down) stale.add(key);
  isUnseen = true;
}

/** The question is painted: what is pressed from now on may be meant for it. */
export function questionIsSeen() {
  isUnseen = false;
}

/** @param {KeyboardEvent} event */
const nameOf = (event) => event.code || event.key;

/** @param {KeyboardEvent} event */
const isLineBreak = (event) => event.target instanceof HTMLTextAreaElement && !event.ctrlKey && !event.metaKey;

/** @param {KeyboardEvent} event */
function goesDown(event) {
  const key = nameOf(event);
  const isText = isTyping(event.target) && (event.key !== "Enter" || isLineBreak(event));
  const wasDown = event.repeat || (down.has(key) && !event.metaKey); // with it, a Mac tells of no other key that comes up
  if ((isUnseen && !isText) || (event.repeat && !down.has(key))) stale.add(key);
  down.add(key);
  if (!stale.has(key) && (!wasDown || isText || MOVING.includes(event.key))) return;
  event.preventDefault();
  event.stopImmediatePropagation();
}

/** @param {KeyboardEvent} event */
function comesUp(event) {
  const key = nameOf(event);
  if (event.key === "Meta") down.clear();
  down.delete(key);
  if (stale.delete(key)) event.preventDefault(); // a space would press the button that has the focus now
}

window.addEventListener("keydown", goesDown, true);
window.addEventListener("keyup", comesUp, true);
window.addEventListener("blur", () => {
  down.clear();
  stale.clear();
});
