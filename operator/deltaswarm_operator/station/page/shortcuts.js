/** The page's keyboard shortcuts. */

import { element } from "./dom.js";
import { later } from "./language.js";

/**
 * @typedef {object} Panels
 * @property {import("./types.js").App} app
 * @property {import("./autonomy.js").AutonomyPanel} autonomy
 * @property {import("./form.js").FormPanel} form
 * @property {import("./inbox.js").InboxPanel} inbox
 * @property {import("./isa.js").IsaPanel} isa
 * @property {import("./map.js").MapPanel} map
 * @property {import("./pace.js").PacePanel} pace
 * @property {import("./tabs.js").Tabs} tabs
 * @property {import("./task.js").TaskPanel} task
 */

/**
 * @param {Panels} panels
 * @returns {import("./keys.js").Shortcut[]}
 */
export function shortcuts({ app, autonomy, form, inbox, isa, map, pace, tabs, task }) {
  /**
   * @param {string} tab
   * @param {string} id
   */
  function go(tab, id) {
    if (tab) tabs.show(tab);
    element(id).focus();
  }
  return [
    { keys: ["p"], words: later("pause, go on"), act: () => pace.toggle() },
    { keys: ["."], words: later("one step"), act: () => pace.step() },
    { keys: ["<"], words: later("slower"), act: () => pace.shift(-1) },
    { keys: [">"], words: later("faster"), act: () => pace.shift(1) },
    { keys: ["m"], words: later("to the map"), act: () => go("", "map") },
    { keys: ["i"], words: later("to the inbox"), act: () => inbox.enter() },
    { keys: ["c"], words: later("to orders"), act: () => go("tab-commands", "command-name") },
    { keys: ["a"], words: later("to agents"), act: () => go("tab-agents", "tab-agents") },
    { keys: ["e"], words: later("to events"), act: () => go("tab-events", "tab-events") },
    { keys: ["v"], words: later("veto a change of delta"), act: () => autonomy.veto() },
    { keys: ["w"], words: later("select the next event to judge"), act: () => task.next() },
    { keys: ["x"], words: later("judge the selected event: a target"), act: () => task.judge("target") },
    { keys: ["z"], words: later("judge the selected event: a decoy"), act: () => task.judge("decoy") },
    { keys: ["q"], words: later("to the question that is asked beside the map"), act: () => form.enter(), always: true },
    { keys: ["n"], words: later("to notes"), act: () => go("tab-notes", "note-text") },
    { keys: ["j"], words: later("next message"), act: () => inbox.step(1) },
    { keys: ["k"], words: later("message before"), act: () => inbox.step(-1) },
    { keys: ["u"], words: later("open the next unread message: mark as read, show on the map"), act: () => inbox.next() },
    { keys: ["R"], words: later("mark all messages as read"), act: () => inbox.readAll() },
    { keys: ["f"], words: later("show the whole arena"), act: () => map.fit() },
    { keys: ["h"], words: later("heat map of age on or off"), act: () => map.toggle("heat") },
    { keys: ["y"], words: later("heat map of activity on or off"), act: () => map.toggle("activity") },
    { keys: ["l"], words: later("labels on or off"), act: () => map.toggle("labels") },
    { keys: ["t"], words: later("lines of trees on or off"), act: () => map.toggle("trees") },
    { keys: [later("Escape")], words: later("leave a field; select nothing"), act: () => app.select(null) },
    { keys: ["?"], words: later("this list"), act: () => element("help-open").click(), always: true },
    {
      keys: ["1", "2", "3", "4", "5"],
      shown: "1 – 5",
      words: later("answer how busy you are, while you are asked"),
      act: (key) => isa.isAsking && isa.answer(Number(key)),
      always: true,
      inHelp: () => isa.isAsking,
    },
  ];
}

/**
 * Keys that work in one place only.
 * @type {[string, string][]}
 */
export const ELSEWHERE = [
  ["← → ↑ ↓", later("on the map: move it; + and − zoom")],
  [`${later("PageDown")} or ${later("PageUp")}`, later("on the map: next agent, agent before")],
  [later("Enter"), later("on the map: choose what is at its centre; in the inbox: read; in a field of an order: send")],
  [`${later("Ctrl")} Enter`, later("anywhere in an order: send; in notes: save the note")],
];
