/** Texts in the participant's language. A text's English is its key; what has no translation stays English. */

/** @typedef {Record<string, string | number>} Values what is put in for {names} */

const ATTRIBUTES = ["title", "aria-label", "placeholder"];
/** A pattern with fewer letters of its own would fit texts that are not meant. */
const LEAST_LETTERS = 12;

/** @type {Map<string, string>} */
let texts = new Map();
/** @type {string | null} the language that was taken; another needs a fresh page */
let taken = null;

/**
 * Mark a text for translation where it is defined before the language is known; `t` translates it where it is shown.
 * @param {string} english
 */
export const later = (english) => english;

/**
 * Translate a text and put in its values.
 * @param {string} english
 * @param {Values} [values]
 */
export function t(english, values = {}) {
  return (texts.get(english) || english).replace(/\{(\w+)\}/g, (whole, name) => String(values[name] ?? whole));
}

/**
 * Translate a text for one or for several.
 * @param {number} count
 * @param {string} one
 * @param {string} several
 */
export const plural = (count, one, several) => t(count === 1 ? one : several, { count });

/**
 * Translate what the operator says, in which values already stand.
 * @param {string} said
 */
export function retell(said) {
  if (texts.has(said)) return t(said);
  for (const english of [...texts.keys()].sort((a, b) => b.length - a.length)) {
    const literals = english.split(/\{\w+\}/);
    if (literals.length < 2 || literals.join("").length < LEAST_LETTERS) continue;
    const names = [...english.matchAll(/\{(\w+)\}/g)].map(([, name]) => name ?? "");
    const escaped = literals.map((literal) => literal.replace(/[.*+?^${}()|[\]\\]/g, "\\$&"));
    const found = new RegExp(`^${escaped.join("(.+?)")}$`).exec(said);
    if (found) return t(english, Object.fromEntries(names.map((name, at) => [name, t(found[at + 1] ?? "")])));
  }
  return said;
}

/**
 * Take the run's language. The first one translates what the page says already; another one loads the page again.
 * @param {import("./types.js").Language | null} [language]
 */
export function speak(language) {
  const key = JSON.stringify(language ?? null);
  if (taken !== null) {
    if (key !== taken) window.location.reload();
    return;
  }
  taken = key;
  if (!language) return;
  texts = new Map(Object.entries(language.texts));
  if (language.tag) document.documentElement.lang = language.tag;
  translateDocument();
}

function translateDocument() {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_ELEMENT | NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode;
    if (node instanceof Element) {
      for (const name of ATTRIBUTES) if (node.hasAttribute(name)) node.setAttribute(name, inPlace(node.getAttribute(name) ?? ""));
    } else if (node.parentElement?.translate) node.nodeValue = inPlace(node.nodeValue ?? "");
  }
}

/**
 * Translate a text of the document, between the white space around it.
 * @param {string} text
 */
function inPlace(text) {
  const english = text.trim().replace(/\s+/g, " ");
  return texts.has(english) ? text.replace(/\S[^]*\S|\S/, () => t(english)) : text;
}
