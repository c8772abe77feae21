/** Helpers for elements. Text is only set as text, never as HTML, so names from scenarios or reports stay text. */

/**
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Record<string, string>} [attributes]
 * @param {...(Node | string)} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function make(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/**
 * @template {HTMLElement} E
 * @param {string} id
 * @param {{new(): E}} kind
 * @returns {E}
 */
export function byId(id, kind) {
  const found = document.getElementById(id);
  if (!(found instanceof kind)) throw new Error(`no ${kind.name} #${id}`);
  return found;
}

/** @param {string} id */
export const element = (id) => byId(id, HTMLElement);
/** @param {string} id */
export const input = (id) => byId(id, HTMLInputElement);
/** @param {string} id */
export const choice = (id) => byId(id, HTMLSelectElement);
/** @param {string} id */
export const button = (id) => byId(id, HTMLButtonElement);
/** @param {string} id */
export const dialog = (id) => byId(id, HTMLDialogElement);

/**
 * Set a text only if it differs, which keeps a reader's selection and does not disturb a screen reader.
 * @param {Element} where
 * @param {string} text
 */
export function setText(where, text) {
  if (where.textContent !== text) where.textContent = text;
}

/**
 * Set a list's options; leave the list alone if nothing changes.
 * @param {HTMLSelectElement} list
 * @param {[string, string][]} options values and their words
 */
export function setOptions(list, options) {
  const key = JSON.stringify(options);
  if (list.dataset["options"] === key) return;
  list.dataset["options"] = key;
  const before = list.value;
  list.replaceChildren(...options.map(([value, words]) => make("option", { value }, words)));
  if (options.some(([value]) => value === before)) list.value = before;
}

/**
 * Whether a key typed in this element is text input.
 * @param {EventTarget | null} where
 */
export function isTyping(where) {
  if (where instanceof HTMLTextAreaElement || where instanceof HTMLSelectElement) return true;
  return where instanceof HTMLInputElement && !["radio", "checkbox", "range", "button"].includes(where.type);
}

/**
 * Keep a list's rows in the order of `items`; create and remove only the rows that change. Under a mouse, none moves.
 * @template T
 * @param {HTMLElement} list
 * @param {T[]} items
 * @param {(item: T) => string} keyOf
 * @param {(item: T) => HTMLElement} create
 * @param {(row: HTMLElement, item: T) => void} update
 */
export function keepRows(list, items, keyOf, create, update) {
  /** @type {Map<string, HTMLElement>} */
  const before = new Map();
  for (const row of list.children) if (row instanceof HTMLElement) before.set(row.dataset["key"] ?? "", row);
  const isPointedAt = list.matches(":hover") && window.matchMedia("(hover: hover)").matches && before.size > 0;
  let next = /** @type {Element | null} */ (list.firstElementChild);
  for (const item of items) {
    const key = keyOf(item);
    let row = before.get(key);
    if (isPointedAt) {
      if (row) update(row, item);
      continue;
    }
    if (!row) {
      row = create(item);
      row.dataset["key"] = key;
    }
    before.delete(key);
    update(row, item);
    if (row === next) next = next.nextElementSibling;
    else list.insertBefore(row, next);
  }
  if (!isPointedAt) for (const row of before.values()) row.remove();
}
