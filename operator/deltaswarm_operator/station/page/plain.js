/** A plain page between the runs of a session, and thanks at its end: nothing of the run before is left in view. */

import { element, setText } from "./dom.js";
import { later, t } from "./language.js";

const THANKS = later("Thank you: that was the last run.");
/** Questions that have no answer are asked again before the person is thanked. */
const FOLLOWS_WITHIN_MS = 10000;
let endedAt_ms = 0;

/**
 * Show the plain page, if this is the participant's page in a session and no run is under way.
 * @param {import("./model.js").Model} model
 * @param {boolean} hasEnded
 */
export function showPlain({ hello, picture }, hasEnded) {
  const [number, count] = hello?.place ?? [];
  const isOf = hello?.kind === "live" && number !== undefined && count !== undefined;
  const isOver = hasEnded || Boolean(picture?.over);
  const isPlain = isOf && (isOver || (picture?.step ?? -1) < 0);
  document.documentElement.toggleAttribute("data-plain", isPlain);
  element("plain").hidden = !isPlain;
  if (!isPlain) return;
  if (!hasEnded) endedAt_ms = performance.now();
  const mayFollow = hello.end_text === THANKS && performance.now() - endedAt_ms < FOLLOWS_WITHIN_MS;
  const isLast = hasEnded && number === count && !mayFollow;
  const run = number ? t("Run {number} of {count}", { number, count }) : t("Training");
  const text = t(hello?.end_text ?? "");
  setText(element("plain-title"), isLast ? text : run);
  setText(element("plain-text"), isLast ? "" : hasEnded ? (mayFollow ? t("Please wait.") : text) : isOver ? t("This run is over.") : t("It begins soon."));
}
