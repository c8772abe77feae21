/** The map's legend: what its markers and its shades mean. */

import { make } from "./dom.js";
import { t } from "./language.js";
import { ACTIVITY, HEAT, activity, heat as heatColour, inks, mark, markBase, markBody, markEvent, markNew, strength } from "./looks.js";
import { LEAST_MARKER_PX as MARKER_PX } from "./view.js";

/** @param {import("./model.js").Model} model */
export function markers(model) {
  const roles = [...new Set(model.agents.map((agent) => agent[3]))].sort();
  const entries = roles.map((role) => sample(role ? t(role) : t("unknown"), (on) => mark(on, role, 10, 10, true, MARKER_PX - 1)));
  if (model.agents.some((agent) => !agent[7]))
    entries.push(sample(t("hollow: told by another agent"), (on) => mark(on, "member", 10, 10, false, MARKER_PX - 1)));
  if (model.hello?.radius_m)
    entries.push(
      sample(t("body (to scale when zoomed in)"), (on) => {
        markBody(on, "free", 10, 10, 9, MARKER_PX - 2);
        mark(on, "free", 10, 10, true, MARKER_PX - 3);
      }),
    );
  if (model.events.length) {
    entries.push(sample(t("event (e7: number 7)"), (on) => markEvent(on, 10, 10, MARKER_PX)));
    entries.push(
      sample(t("new event"), (on) => {
        markEvent(on, 10, 10, MARKER_PX - 2);
        markNew(on, 10, 10, MARKER_PX + 1);
      }),
    );
  }
  if (!model.shownTruth)
    entries.push(
      sample(t("faded: long unheard"), (on) => {
        on.globalAlpha = strength(Infinity);
        mark(on, "root", 10, 10, true, MARKER_PX - 2);
      }),
    );
  if (model.hello?.base_m)
    entries.push(sample(model.hello.range_m ? t("base and its range") : t("base"), (on) => markBase(on, 10, 10, 6)));
  return entries;
}

export const ages = () => [
  make("span", {}, t("last heard from within")),
  ...HEAT.map(([limit, words]) => shade(t(words), heatColour(Math.min(limit, 10000) - 1))),
];

export const activities = () => [
  make("span", {}, t("agents heard there over the last minute")),
  ...ACTIVITY.map(([least, words]) => shade(t(words), activity(least))),
];

/**
 * @param {string} words
 * @param {string} colour
 */
function shade(words, colour) {
  return sample(words, (on) => {
    on.fillStyle = colour;
    on.fillRect(2, 3, 16, 14);
    on.strokeStyle = inks().soft;
    on.strokeRect(2.5, 3.5, 15, 13);
  });
}

/**
 * Make an entry of the legend.
 * @param {string} words
 * @param {(on: CanvasRenderingContext2D) => void} paint
 */
function sample(words, paint) {
  const canvas = make("canvas", { width: "20", height: "20", "aria-hidden": "true" });
  const on = canvas.getContext("2d");
  if (on) paint(on);
  return make("span", { class: "sample" }, canvas, words);
}
