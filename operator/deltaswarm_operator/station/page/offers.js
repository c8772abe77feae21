/** What a run leaves to this page: panels, tabs, and where the session stands. */

import { element, setText } from "./dom.js";
import { t } from "./language.js";

/**
 * Offer the panels that the run leaves to this page; what it has no use for has no place.
 * @param {import("./types.js").Hello} hello
 * @param {string} kind of the page
 * @param {import("./tabs.js").Tabs} tabs
 */
export function offerPanels({ panels, asks, commands, sets_delta, place }, kind, tabs) {
  const isOperated = ["live", "watch"].includes(kind);
  /** @param {string} panel */
  const has = (panel) => !isOperated || (panels?.includes(panel) ?? true);
  const isOrdered = !isOperated || commands.length > 0 || (sets_delta ?? "operator") !== "operator";
  for (const panel of ["workload", "inbox"]) element(panel).hidden = !has(panel);
  tabs.offer("tab-commands", has("orders") && isOrdered);
  tabs.offer("tab-agents", has("agents"));
  tabs.offer("tab-events", has("events"));
  tabs.offer("tab-notes", has("notes") && ["live", "conductor"].includes(kind));
  tabs.offer("tab-acts", kind === "conductor" || kind === "replay");
  element("side").hidden = tabs.isEmpty;
  element("asks").hidden = !asks || kind !== "live";
  const [number, count] = place ?? [];
  element("place").hidden = count === undefined;
  if (number !== undefined && count !== undefined) setText(element("place"), number ? t("Run {number} of {count}", { number, count }) : t("Training"));
}
