/** Fields for the arguments of an order, and their values. */

import { element, make, setOptions } from "./dom.js";
import { t } from "./language.js";
import { argument as said } from "./words.js";

/** @typedef {import("./types.js").Argument} Argument */

/**
 * @param {Argument} argument
 * @param {number} at
 * @param {string | number} [given] the value last given
 */
export function field(argument, at, given = argument.default) {
  const id = `argument-${at}`;
  const [bare, unit] = said(argument.name, argument.unit);
  const words = unit ? `${bare} [${unit}]` : bare;
  const attributes = { id, "data-argument": argument.name, title: t(argument.help ?? "") };
  /** @type {HTMLInputElement | HTMLSelectElement} */
  let made;
  if (argument.kind === "choice") {
    made = make("select", attributes);
    setOptions(
      made,
      (argument.choices ?? []).map((value) => [String(value), t(String(value))]),
    );
  } else {
    made = make("input", { ...attributes, type: argument.kind === "text" ? "text" : "number", autocomplete: "off" });
    if (argument.kind !== "text") made.step = argument.kind === "integer" ? "1" : "any";
    if (argument.low !== undefined) made.min = String(argument.low);
    if (argument.high !== undefined) made.max = String(argument.high);
  }
  if (given !== undefined) made.value = String(given);
  return make("label", {}, words, made, make("small", {}, t(argument.help ?? "")));
}

/**
 * Read the value of an argument from its field; throw an error if it is not valid.
 * @param {Argument} argument
 * @param {number} at
 */
export function read({ name, kind, low, high, choices }, at) {
  const { value } = /** @type {HTMLInputElement} */ (element(`argument-${at}`));
  const [words] = said(name);
  if (kind === "choice") return (choices ?? []).find((choice) => String(choice) === value) ?? value;
  if (kind === "text") return value;
  const given = Number(value);
  if (value.trim() === "" || !Number.isFinite(given)) throw new Error(t("{name} must be a number", { name: words }));
  if (kind === "integer" && !Number.isInteger(given)) throw new Error(t("{name} must be a whole number (got {value})", { name: words, value }));
  if (low !== undefined && given < low) throw new Error(t("{name} must be at least {low} (got {value})", { name: words, low, value }));
  if (high !== undefined && given > high) throw new Error(t("{name} must be at most {high} (got {value})", { name: words, high, value }));
  return given;
}
