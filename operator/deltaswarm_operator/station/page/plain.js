/** A plain page between the runs of a session, and thanks at its end: nothing of the run before is left in view. */

import { element, setText } from "./dom.js";
import { t } from "./language.js";

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
  const isLast = hasEnded && number === count;
  const run = number ? t("Run {number} of {count}", { number, count }) : t("Training");
  const text = t(hello?.end_text ?? "");
  setText(element("plain-title"), isLast ? text : run);
  setText(element("plain-text"), isLast ? "" : hasEnded ? text : isOver ? t("This run is over.") : t("It begins soon."));
}
