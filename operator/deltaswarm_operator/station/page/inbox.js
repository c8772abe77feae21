/** The inbox: what agents reported, message by message; sort, filter, mark as read. */

import { button, choice, element, keepRows, make, setText } from "./dom.js";
import { t } from "./language.js";
import { clock, message } from "./words.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./types.js").InboxRow} InboxRow */

const MAX_SHOWN = 150;

/** @type {Record<string, (a: InboxRow, b: InboxRow) => number>} */
const ORDERS = {
  newest: (a, b) => b[0] - a[0],
  oldest: (a, b) => a[0] - b[0],
  agent: (a, b) => a[2] - b[2] || b[0] - a[0],
  followers: (a, b) => b[4] - a[4] || b[0] - a[0],
};

export class InboxPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.list = element("inbox-list");
    this.order = choice("inbox-order");
    this.filter = choice("inbox-filter");
    this.order.addEventListener("change", () => this.update());
    this.filter.addEventListener("change", () => this.update());
    button("inbox-all-read").addEventListener("click", () => this.readAll());
    this.list.addEventListener("click", (event) => this.open(rowOf(event.target)));
    this.list.addEventListener("keydown", (event) => this.key(event));
  }

  /** @returns {InboxRow[]} */
  wanted() {
    const { inbox, read } = this.app.model;
    const { selection } = this.app;
    const items = [...inbox.values()];
    /** @type {Record<string, (item: InboxRow) => boolean>} */
    const filters = {
      unread: (item) => !read.has(item[0]),
      fresh: (item) => Boolean(item[6]),
      roots: (item) => item[3] === "root",
      events: (item) => item[5].length > 0,
      selected: (item) =>
        selection?.kind === "agent" ? item[2] === selection.id : selection ? item[5].includes(selection.id) : true,
    };
    const wanted = items.filter(filters[this.filter.value] ?? (() => true));
    return wanted.sort(ORDERS[this.order.value] ?? ORDERS["newest"]);
  }

  update() {
    const { model } = this.app;
    const wanted = this.wanted();
    keepRows(
      this.list,
      wanted.slice(0, MAX_SHOWN),
      (item) => String(item[0]),
      create,
      (row, item) => {
        const isRead = model.read.has(item[0]);
        if (row.dataset["read"] !== String(isRead)) {
          row.dataset["read"] = String(isRead);
          const state = row.querySelector(".state");
          if (state) setText(state, item[6] ? t("new") : "");
          const hint = row.querySelector(".unseen");
          if (hint) setText(hint, isRead ? "" : `${t("unread")}: `);
        }
      },
    );
    if (!this.list.querySelector('[tabindex="0"]')) this.list.querySelector("li")?.setAttribute("tabindex", "0");
    button("inbox-all-read").hidden = model.hello?.kind !== "live";
    const unread = model.picture?.unread ?? 0;
    const isElsewhere = model.hello?.kind === "researcher";
    setText(element("inbox-count"), unread ? t("{count} unread", { count: unread }) : isElsewhere ? "" : t("all read"));
    const hidden = wanted.length - MAX_SHOWN;
    setText(
      element("inbox-note"),
      hidden > 0
        ? t("{count} more are not listed. Filter or sort for others, or select an agent and show its messages alone.", { count: hidden })
        : wanted.length
          ? ""
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
    const item = this.app.model.inbox.get(Number(row.dataset["key"]));
    if (!item) return;
    const { read } = this.app.model;
    const canRead = ["live", "replay"].includes(this.app.model.hello?.kind ?? "");
    if (canRead && !read.has(item[0])) {
      this.app.send({ type: "read", items: [item[0]] });
      read.add(item[0]);
      this.update();
    }
    this.app.select({ kind: "agent", id: item[2] }, true, false);
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
function create(item) {
  const agent = make("b", {}, make("span", { class: "unseen" }), t("agent {number}", { number: item[2] }));
  return make(
    "li",
    { tabindex: "-1", "data-agent": String(item[2]) },
    make("time", {}, clock(item[1])),
    agent,
    make("span", { class: "what" }, message(item)),
    make("span", { class: "state", title: t("It names an event or a root that was not known before.") }),
  );
}
