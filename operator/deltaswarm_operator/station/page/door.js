/** The door of a study by link: what one agrees to, the wait for a place, and the code at the end. */

import { button, element, setText } from "./dom.js";
import { speak, t } from "./language.js";

const AGAIN_MS = 1000;
const LONGEST_AGAIN_MS = 8000;
/** Where the open link keeps the person's own one. */
const OWN = "deltaswarm-own-link";

/**
 * @typedef {object} Door
 * @property {"new" | "waiting" | "running" | "away" | "complete" | "screened out" | "declined" | "ended" | "failed"} state
 * @property {boolean} has_agreed
 * @property {number} place in line
 * @property {"" | "paused" | "early" | "late" | "no room"} closed why the person may not begin
 * @property {string} opens when people may begin
 * @property {string} [code]
 * @property {string} [back] where to go at the end
 * @property {string} [embed] origin of the page around this one
 * @property {string} title
 * @property {string} consent
 * @property {import("./types.js").Language | null} language
 */

/** What the browser needs, by its name. */
const NEEDED = { WebSocket: "WebSocket", canvas: "HTMLCanvasElement", dialogs: "HTMLDialogElement" };
const MIN_WIDTH_PX = 700;

let again_ms = AGAIN_MS;
/** @type {WebSocket | null} */
let socket = null;
let told = "";

const isJoining = !/\/p\/[^/]+\/$/.test(window.location.pathname);

/** @returns {string[]} what this browser lacks */
function lacking() {
  const names = Object.entries(NEEDED).filter(([, kind]) => !(kind in window));
  return names.map(([name]) => name);
}

/** @param {Door} door */
function words(door) {
  if (door.state === "complete") return t("Thank you. You have completed the study.");
  if (door.state === "screened out") return t("Thank you. The study ends here for you.");
  if (door.state === "declined") return t("You do not take part. Nothing was recorded. You may close this page.");
  if (door.state === "ended") return t("The study was ended. Thank you for taking part.");
  if (door.state === "failed") return t("Something went wrong here. Nothing that you did is lost.");
  if (door.state === "running") return t("It begins.");
  if (door.closed === "early") return t("The study begins on {when}.", { when: new Date(door.opens).toLocaleString() });
  if (door.closed === "late") return t("The study is closed: nobody new can begin.");
  if (door.closed) return t("Please wait: nobody is admitted at the moment.");
  if (door.state === "waiting" && door.place > 0)
    return t("All places are taken. You are number {place} in line; keep this page open.", { place: door.place });
  if (door.state === "waiting") return t("Please wait.");
  if (window.innerWidth < MIN_WIDTH_PX) return t("This page needs a wider window.");
  return "";
}

/** @param {Door} door */
function show(door) {
  speak(door.language);
  const isNew = door.state === "new" && !door.has_agreed;
  document.title = door.title;
  setText(element("door-title"), t(door.title));
  setText(element("door-consent"), isNew ? t(door.consent) : "");
  const lacks = lacking();
  setText(element("door-said"), lacks.length ? t("This browser lacks: {what}.", { what: lacks.join(", ") }) : words(door));
  const isClosed = ["early", "late"].includes(door.closed);
  const mayBegin = !lacks.length && !isClosed && (isNew || door.state === "failed");
  button("door-agree").hidden = !mayBegin;
  button("door-decline").hidden = !(isNew && door.consent) || isJoining;
  setText(button("door-agree"), door.state === "failed" ? t("Try again") : door.consent ? t("I agree, begin") : t("Begin"));
  setText(button("door-decline"), t("I do not agree"));
  element("door-code").hidden = !door.code;
  setText(element("door-code-label"), t("Your code:"));
  setText(element("door-code-value"), door.code ?? "");
  const back = /** @type {HTMLAnchorElement} */ (element("door-back"));
  back.hidden = !door.back;
  if (door.back) back.href = door.back;
  setText(back, t("Go on"));
  if (door.code && door.embed && door.code !== told) {
    told = door.code;
    window.parent.postMessage({ type: "deltaswarm", state: door.state, code: door.code }, door.embed);
  }
  if (door.state === "running") window.location.assign("run/");
}

/** @param {string} address */
function go(address) {
  if (isJoining) localStorage.setItem(OWN + window.location.pathname, address);
  window.location.replace(address);
}

function connect() {
  const address = new URL(`door${window.location.search}`, window.location.href);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  socket = new WebSocket(address);
  socket.onmessage = (event) => {
    again_ms = AGAIN_MS;
    const message = JSON.parse(String(event.data));
    if (message.type === "door") show(message);
    else if (message.type === "go") go(message.address);
    else if (message.type === "full") setText(element("door-said"), t("Too many people came from your network. Try again later."));
  };
  socket.onclose = () => {
    window.setTimeout(connect, again_ms);
    again_ms = Math.min(LONGEST_AGAIN_MS, 2 * again_ms);
  };
}

button("door-agree").addEventListener("click", () => socket?.send(JSON.stringify({ type: "agree" })));
button("door-decline").addEventListener("click", () => socket?.send(JSON.stringify({ type: "decline" })));
const own = isJoining && !window.location.search ? localStorage.getItem(OWN + window.location.pathname) : null;
if (own) window.location.replace(own);
else connect();
