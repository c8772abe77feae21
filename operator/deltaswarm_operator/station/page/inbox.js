/** The inbox: what agents reported, in the lines of the inbox's policy; sort, filter, mark as read, see what is held back. */

import { button, choice, element, keepRows, make, setText } from "./dom.js";
import { t } from "./language.js";
import { clock, message } from "./words.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./types.js").InboxRow} InboxRow */

/** @typedef {import("./types.js").InboxLine} InboxLine */

const MAX_SHOWN = 150;
const SEVERITIES = ["alert", "notice", "info"];

/** @type {Record<string, (a: InboxLine, b: InboxLine) => number>} */
const ORDERS = {
  newest: (a, b) => b.number - a.number,
  oldest: (a, b) => a.number - b.number,
  agent: (a, b) => a.first[2] - b.first[2] || b.number - a.number,
  followers: (a, b) => b.first[4] - a.first[4] || b.number - a.number,
  ranked: (a, b) => rank(a.first) - rank(b.first) || a.number - b.number,
};

export class InboxPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.list = element("inbox-list");
    this.order = choice("inbox-order");
    this.filter = choice("inbox-filter");
    this.policyOrder = "newest";
    this.asked = "";
    /** @type {import("./types.js").Hello | null} of the connection on which it was asked */
    this.hello = null;
    this.order.addEventListener("change", () => this.update());
    this.filter.addEventListener("change", () => this.update());
    button("inbox-all-read").addEventListener("click", () => this.readAll());
    this.list.addEventListener("click", (event) => this.open(rowOf(event.target)));
    this.list.addEventListener("keydown", (event) => this.key(event));
  }

  /** @returns {InboxLine[]} */
  lines() {
    const { model } = this.app;
    if (this.filter.value === "held") return model.held.map((item) => lineOf([item], model));
    /** @type {Map<number, InboxRow[]>} */
    const lines = new Map();
    for (const item of model.inbox.values()) {
      const number = item[8] ?? item[0];
      const line = lines.get(number);
      if (line) line.push(item);
      else lines.set(number, [item]);
    }
    return [...lines.values()].map((items) => lineOf(items, model));
  }

  /** @returns {InboxLine[]} */
  wanted() {
    const { selection } = this.app;
    /** @type {Record<string, (line: InboxLine) => boolean>} */
    const filters = {
      unread: (line) => line.isUnread,
      fresh: ({ items }) => items.some((item) => item[6]),
      roots: ({ items }) => items.some((item) => item[3] === "root"),
      events: ({ items }) => items.some((item) => item[5].length > 0),
      selected: ({ items }) =>
        !selection || items.some((item) => (selection.kind === "agent" ? item[2] === selection.id : item[5].includes(selection.id))),
    };
    return this.lines()
      .filter(filters[this.filter.value] ?? (() => true))
      .sort(ORDERS[this.order.value] ?? ORDERS["newest"]);
  }

  /** Begin with the order of the inbox's policy; ask again for what is held back if that is listed and has changed. */
  follow() {
    const { hello, picture } = this.app.model;
    const order = hello?.inbox?.order ?? "newest";
    if (this.policyOrder !== order) this.order.value = this.policyOrder = order;
    if (this.hello !== hello) this.asked = ""; // a new connection: what was asked may be lost
    this.hello = hello;
    const held = this.filter.value === "held" ? String(picture?.held) : "";
    if (held && held !== this.asked) this.app.send({ type: "held" });
    this.asked = held;
  }

  update() {
    const { model } = this.app;
    this.follow();
    const wanted = this.wanted();
    keepRows(
      this.list,
      wanted.slice(0, MAX_SHOWN),
      (line) => `${line.number}`,
      create,
      (row, line) => {
        const state = `${line.count} ${line.isUnread} ${line.first[0]}`;
        if (row.dataset["state"] === state) return;
        row.dataset["state"] = state;
        row.dataset["read"] = String(!line.isUnread);
        row.dataset["severity"] = line.first[7] ?? "";
        setIn(row, "time", clock(line.first[1]));
        setIn(row, ".what", whatOf(line));
        const isRanked = model.hello?.inbox?.order === "ranked";
        const severity = isRanked && line.first[7] ? t(line.first[7]) : "";
        setIn(row, ".state", [severity, line.items.some((item) => item[6]) ? t("new") : ""].filter(Boolean).join(", "));
        setIn(row, ".unseen", line.isUnread ? `${t("unread")}: ` : "");
      },
    );
    if (!this.list.querySelector('[tabindex="0"]')) this.list.querySelector("li")?.setAttribute("tabindex", "0");
    button("inbox-all-read").hidden = model.hello?.kind !== "live";
    const unread = model.picture?.unread ?? 0;
    const isElsewhere = model.hello?.kind === "researcher";
    setText(element("inbox-count"), unread ? t("{count} unread", { count: unread }) : isElsewhere ? "" : t("all read"));
    const hidden = wanted.length - MAX_SHOWN;
    const held = model.picture?.held?.[0] ?? 0;
    setText(
      element("inbox-note"),
      hidden > 0
        ? t("{count} more are not listed. Filter or sort for others, or select an agent and show its messages alone.", { count: hidden })
        : wanted.length
          ? held
            ? t("{count} messages are held back: {why}", { count: held, why: t(model.hello?.inbox?.held ?? "") })
            : ""
          : isElsewhere
            ? "The participant's page has the inbox."
            : t("No messages."),
    );
    document.title = `${unread ? `(${unread}) ` : ""}${element("title").textContent}`;
  }

  readAll() {
    this.app.send({ type: "read", all: true, up_to: this.app.model.newest });
  }

  /**
   * Mark a message as read and show its sender on the map.
   * @param {HTMLElement | null} row
   */
  open(row) {
    if (!row) return;
    const line = this.lines().find(({ number }) => String(number) === row.dataset["key"]);
    if (!line) return;
    const { read } = this.app.model;
    const canRead = ["live", "replay"].includes(this.app.model.hello?.kind ?? "");
    const items = line.items.map((item) => item[0]).filter((item) => !read.has(item));
    if (canRead && items.length) {
      this.app.send({ type: "read", items });
      for (const item of items) read.add(item);
      this.update();
    }
    this.app.select({ kind: "agent", id: line.first[2] }, true, false);
    this.focus(row);
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const row = rowOf(event.target);
    if (event.key === "ArrowDown") this.step(1);
    else if (event.key === "ArrowUp") this.step(-1);
    else if (event.key === "Enter" || event.key === " ") this.open(row);
    else return;
    event.preventDefault();
  }

  /**
   * Move to the next message (`by` 1) or the previous one (-1).
   * @param {number} by
   */
  step(by) {
    const at = rowOf(document.activeElement);
    const next = at ? (by > 0 ? at.nextElementSibling : at.previousElementSibling) : this.list.firstElementChild;
    if (next instanceof HTMLElement) this.focus(next);
  }

  /** Move to the last focused message, or to the filter if there is none. */
  enter() {
    const row = this.list.querySelector('[tabindex="0"]');
    if (row instanceof HTMLElement) this.focus(row);
    else this.filter.focus();
  }

  /** Open the next unread message, so that one key works through the queue. */
  next() {
    const row = this.list.querySelector('[data-read="false"]');
    if (row instanceof HTMLElement) this.open(row);
    else this.app.say(t("No unread message is shown."));
  }

  /** @param {HTMLElement} row */
  focus(row) {
    for (const other of this.list.querySelectorAll('[tabindex="0"]')) other.setAttribute("tabindex", "-1");
    row.setAttribute("tabindex", "0");
    row.focus();
  }
}

/** @param {EventTarget | null} target */
function rowOf(target) {
  const row = target instanceof Element ? target.closest("#inbox-list > li") : null;
  return row instanceof HTMLElement ? row : null;
}

/** @param {InboxRow} item */
function rank(item) {
  return SEVERITIES.indexOf(item[7] ?? "info");
}

/**
 * A line is listed as the most severe of its items, the newest of these.
 * @param {InboxRow[]} items
 * @param {import("./model.js").Model} model
 * @returns {InboxLine}
 */
function lineOf(items, { read, counts }) {
  const first = items.reduce((best, item) => (rank(item) <= rank(best) ? item : best));
  const number = items[0]?.[8] ?? first[0];
  const isUnread = items.some((item) => !read.has(item[0]));
  return { number, items, first, count: items.length + (counts.get(number) ?? 0), isUnread };
}

/** @param {InboxLine} line */
function whatOf({ first, count }) {
  return count > 1 ? `${message(first)} (${t("{count} messages", { count })})` : message(first);
}

/** @param {InboxLine} line */
function create({ first }) {
  const agent = make("b", {}, make("span", { class: "unseen" }), t("agent {number}", { number: first[2] }));
  return make(
    "li",
    { tabindex: "-1", "data-agent": String(first[2]) },
    make("time", {}),
    agent,
    make("span", { class: "what" }),
    make("span", { class: "state", title: t("It names an event or a root that was not known before.") }),
  );
}

/**
 * @param {HTMLElement} row
 * @param {string} selector
 * @param {string} text
 */
function setIn(row, selector, text) {
  const part = row.querySelector(selector);
  if (part) setText(part, text);
}
