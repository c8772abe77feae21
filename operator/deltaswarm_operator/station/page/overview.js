/** The experimenter's page of a study by link: who is where, and what can be done about it. In English. */

import { button, element, make, setText } from "./dom.js";
import { clock } from "./words.js";

/**
 * @typedef {object} Row
 * @property {number | null} number
 * @property {string} state
 * @property {string} begun
 * @property {string} run
 * @property {number} time_s
 * @property {number} duration_s
 * @property {string} help
 * @property {number} away_s
 * @property {string} note
 * @property {string} watch token of the page that shows what the participant sees
 */

/** @type {WebSocket | null} */
let socket = null;
let isOpen = true;
/** What the rows show besides texts that change in place. */
let shown = "";

/** @param {Record<string, unknown>} message */
const send = (message) => socket?.send(JSON.stringify(message));

/** @param {Row} row */
function cells(row) {
  const time = row.state === "running" && row.duration_s ? `${clock(row.time_s)} of ${clock(row.duration_s)}` : "";
  const away = row.away_s > 3 ? `${Math.round(row.away_s)} s` : "";
  const help = row.help === "asked" ? "calls" : row.help === "seen" ? "seen" : "";
  return [row.number ?? "", row.state, row.begun, row.run, time, away, help].map((text) => make("td", {}, String(text)));
}

/** @param {Row} row */
function line(row) {
  const note = make("input", { value: row.note, "aria-label": `Note on participant ${row.number}` });
  note.addEventListener("change", () => send({ type: "note", number: row.number, text: note.value }));
  const end = make("button", { type: "button" }, "End");
  end.addEventListener("click", () => {
    if (window.confirm(`End the session of participant ${row.number}?`)) send({ type: "end", number: row.number });
  });
  const isUnderWay = ["running", "waiting", "away"].includes(row.state) && row.number !== null;
  const page = make("a", { href: `${row.number}/`, target: "_blank", rel: "noreferrer" }, "page");
  const watch = make("a", { href: `../../w/${row.watch}/`, target: "_blank", rel: "noreferrer" }, "watch");
  const acts = isUnderWay ? [page, " ", watch, " ", end] : [];
  const made = make("tr", {}, ...cells(row), make("td", {}, row.number === null ? "" : note), make("td", {}, ...acts));
  if (row.help === "asked") made.classList.add("alarm");
  return made;
}

/**
 * @typedef {object} Overview
 * @property {Row[]} rows
 * @property {number} places
 * @property {number} inside
 * @property {number} waiting
 * @property {boolean} admits
 * @property {string} closed why nobody new may begin
 * @property {Record<string, number>} cells sessions that are complete or under way, by order of conditions
 * @property {number} free_bytes
 * @property {number} load of each core
 */

/** @param {Overview} told */
function show(told) {
  isOpen = told.admits;
  /** @type {Map<string, number>} */
  const counts = new Map();
  for (const row of told.rows) counts.set(row.state, (counts.get(row.state) ?? 0) + 1);
  const states = [...counts].map(([state, count]) => `${state}: ${count}`).join(", ");
  const cells_of = Object.entries(told.cells).map(([order, count]) => `${order}: ${count}`).join(", ");
  const lines = [
    `${told.inside} of ${told.places} places taken, ${told.waiting} waiting. ${states}`,
    cells_of && `Complete or under way, by order: ${cells_of}.`,
    `${(told.free_bytes / 1e9).toFixed(1)} GB free on the disk; load ${Math.round(100 * told.load)} % of the cores.`,
    told.closed && `Nobody new may begin: ${told.closed}.`,
  ];
  setText(element("sums"), lines.filter(Boolean).join("\n"));
  button("admissions").setAttribute("aria-pressed", String(!isOpen));
  const key = JSON.stringify(told.rows.map((row) => [row.number, row.state, row.note, row.help === "asked"]));
  const isWriting = document.activeElement instanceof HTMLInputElement;
  if (key !== shown && !isWriting) {
    shown = key;
    element("rows").replaceChildren(...told.rows.map(line));
  }
  told.rows.forEach((row, index) => { // a row that stays can be clicked
    const kept = element("rows").children[index]?.children;
    cells(row).forEach((cell, column) => {
      const there = kept?.[column];
      if (there) setText(there, cell.textContent ?? "");
    });
  });
}

function connect() {
  const address = new URL("live", window.location.href);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  socket = new WebSocket(address);
  socket.onmessage = (event) => show(JSON.parse(String(event.data)));
  socket.onclose = () => {
    setText(element("sums"), "connection lost, trying again");
    window.setTimeout(connect, 1000);
  };
}

button("admissions").addEventListener("click", () => send({ type: "admissions", open: !isOpen }));
connect();
