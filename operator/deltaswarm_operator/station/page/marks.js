/** Marks on the time bar of a replay: what the participant judged, answered, selected and noted. */

import { element, make } from "./dom.js";
import { later, t } from "./language.js";
import { clock } from "./words.js";

/** What each row of marks shows, from above. */
const ROWS = { judge: later("judgements"), answer: later("answers"), selected: later("selections"), note: later("notes and other acts") };

/**
 * @param {import("./model.js").Model} model
 * @param {import("./types.js").Act[]} acts
 */
export function showMarks({ picture }, acts) {
  const { from_s = 0, to_s = 1 } = picture?.replay ?? {};
  const rows = Object.entries(ROWS).map(([kind, words]) => {
    const own = acts.filter((act) => (act.kind in ROWS ? act.kind : "note") === kind);
    const marks = own.map(({ time_s, name, event, text }) => {
      const what = [name, event && `event ${event}`, text].filter(Boolean).join(" ");
      const mark = make("i", { title: `${clock(time_s)} ${what}` });
      mark.style.left = `${(100 * (time_s - from_s)) / Math.max(to_s - from_s, 1)}%`;
      return mark;
    });
    return [make("span", {}, `${t(words)}: ${own.length}`), make("div", { class: "marks", "data-kind": kind }, ...marks)];
  });
  element("marks").hidden = acts.length === 0;
  element("marks").replaceChildren(...rows.flat());
}
