/** Text for people: times, ages, and what agents do. */

import { later, plural, t } from "./language.js";

/** @typedef {import("./types.js").AgentRow} AgentRow */
/** @typedef {import("./types.js").EventRow} EventRow */
/** @typedef {import("./types.js").InboxRow} InboxRow */
/** @typedef {import("./types.js").CommandRow} CommandRow */

/**
 * Format a time: 65 as 1:05, 3723 as 1:02:03.
 * @param {number} time_s
 */
export function clock(time_s) {
  const whole = Math.max(0, Math.floor(time_s));
  const hours = Math.floor(whole / 3600);
  const minutes = Math.floor((whole % 3600) / 60);
  const seconds = String(whole % 60).padStart(2, "0");
  return hours ? `${hours}:${String(minutes).padStart(2, "0")}:${seconds}` : `${minutes}:${seconds}`;
}

/** @param {number} age_s */
export function age(age_s) {
  const whole = Math.max(0, Math.round(age_s));
  if (whole < 100) return `${whole} s`;
  if (whole < 100 * 60) return `${Math.round(whole / 60)} min`;
  return `${Math.round(whole / 3600)} h`;
}

/** @param {number} age_s */
export const ago = (age_s) => (age_s < 0.5 ? t("just now") : t("{age} ago", { age: age(age_s) }));

/**
 * Format a number with at most `digits` decimals and no trailing zeros.
 * @param {number} value
 * @param {number} digits
 */
export const number = (value, digits = 1) => String(Number(value.toFixed(digits)));

/** @param {number} speed */
export function speed(speed) {
  if (speed === 0) return t("as fast as possible");
  return speed < 0 ? t("{speed}× backwards", { speed: -speed }) : `${speed}×`;
}

/**
 * Describe what an agent does, as far as reported.
 * @param {AgentRow} agent
 * @param {AgentRow[]} agents
 * @param {EventRow[]} events
 */
export function doing([id, x_m, y_m, role, parent, root], agents, events) {
  if (role === "root") {
    const followers = agents.filter((other) => other[5] === id && other[0] !== id).length;
    const known = plural(followers, later("{count} known follower"), later("{count} known followers"));
    return followers ? `${t("root of a tree")}, ${known}` : t("root of a tree");
  }
  if (role === "attending") {
    const near = events.filter((event) => event[6].includes(id));
    near.sort((a, b) => Math.hypot(a[1] - x_m, a[2] - y_m) - Math.hypot(b[1] - x_m, b[2] - y_m));
    return near[0] ? t("at event {number}", { number: eventName(near[0][0]) }) : t("at an event");
  }
  if (role === "member") {
    if (root < 0) return t("member of a tree");
    return parent >= 0 && parent !== root
      ? t("in the tree of agent {root}, below agent {parent}", { root, parent })
      : t("in the tree of agent {root}", { root });
  }
  return role ? t(role) : t("role unknown");
}

/**
 * @param {AgentRow} agent
 * @param {number} now_s
 */
export function seen(agent, now_s) {
  const when = ago(now_s - agent[6]);
  if (agent[7]) return t("seen {when}", { when });
  return agent[5] >= 0 && agent[5] !== agent[0]
    ? t("told by agent {number} {when}", { number: agent[5], when })
    : t("told by another agent {when}", { when });
}

/**
 * @param {EventRow} event
 * @param {number} now_s
 */
export function reported([, , , first_s, seen_s, by, attending], now_s) {
  const told = { age: age(now_s - first_s), when: ago(now_s - seen_s), number: by };
  const known = by >= 0 ? t("known for {age}, reported {when} by agent {number}", told) : t("known for {age}, reported {when}", told);
  return attending.length ? `${known}, ${t("attended by {agents}", { agents: agentsOf(attending) })}` : known;
}

/**
 * Name agents: agent 3; agents 3, 4 and 7 more.
 * @param {number[]} ids
 * @param {number} [total]
 */
export function agentsOf(ids, total = ids.length) {
  const numbers = ids.join(", ");
  if (total > ids.length) return t("agents {numbers} and {count} more", { numbers, count: total - ids.length });
  return total === 1 ? t("agent {number}", { number: numbers }) : t("agents {numbers}", { numbers });
}

/**
 * @param {number} x_m
 * @param {number} y_m
 */
export const place = (x_m, y_m) => `(${number(x_m)}, ${number(y_m)}) m`;

/** @param {InboxRow} item */
export function message([, , , role, followers, events]) {
  const numbers = [...events].sort((a, b) => a - b).join(", ");
  const some = events.length > 1 ? t("events {numbers}", { numbers }) : t("event {number}", { number: numbers });
  const what = events.length ? some : t("no event");
  const led = plural(followers, later("{count} follower"), later("{count} followers"));
  const who = followers > 0 ? `${t(role)}, ${led}` : t(role);
  return who ? `${who}: ${what}` : what;
}

/**
 * Describe what is known of an agent; the truth comes from no reporter.
 * @param {AgentRow} agent
 * @param {import("./model.js").Model} model
 */
export function aboutAgent(agent, model) {
  const { agents, events, now_s, picture } = model;
  const what = doing(agent, agents, events) + (agent[8] > 0 ? `, ${t("delta {delta}", { delta: agent[8] })}` : "");
  if (!model.shownTruth) return `${what}, ${seen(agent, now_s)}`;
  if (model.hello?.kind !== "conductor") return what;
  const known = picture?.agents.find((other) => other[0] === agent[0]);
  const told = known ? `${doing(known, picture?.agents ?? [], picture?.events ?? [])}, ${seen(known, now_s)}` : "never heard of it";
  return `${what}. Participant: ${told}`;
}

/**
 * Name an event: those that the participant has no number for have names of their own.
 * @param {number} id
 */
export const eventName = (id) => (id < 0 ? `u${-id}` : String(id));

/**
 * @param {EventRow} event
 * @param {import("./model.js").Model} model
 */
export function aboutEvent(event, { now_s, picture, shownTruth, hello }) {
  if (!shownTruth) return reported(event, now_s);
  const since = `since ${clock(event[3])}`;
  if (hello?.kind !== "conductor") return since;
  const known = picture?.events.find((other) => other[0] === event[0]);
  return `${since}. Participant: ${known ? reported(known, now_s) : "does not know of it"}`;
}

/**
 * Split an argument's name into readable words and a unit: within_m is "within" in m.
 * @param {string} key
 * @param {string} [unit]
 * @returns {[string, string]}
 */
export function argument(key, unit) {
  const suffix = /_(s|m)$/.exec(key)?.[1];
  const bare = suffix && (!unit || unit === suffix) ? key.slice(0, -suffix.length - 1) : key;
  return [t(bare.replaceAll("_", " ")), unit || (bare === key ? "" : (suffix ?? ""))];
}

/**
 * Describe an order's target.
 * @param {CommandRow[2]} target
 */
export function aim([kind, first = 0, second = 0, radius_m = 0]) {
  if (kind === "all") return t("all agents");
  if (kind === "tree") return t("the tree of agent {number}", { number: first });
  if (kind === "agent") return t("agent {number}", { number: first });
  const at = place(first, second);
  return kind === "circle" ? t("{radius} m around {place}", { radius: number(radius_m), place: at }) : at;
}

/** @param {CommandRow} command */
export function order([, name, , values]) {
  const given = Object.entries(values).map(([key, value]) => {
    const [words, unit] = argument(key);
    const said = typeof value === "string" ? t(value) : value;
    const amount = unit ? `${said} ${unit}` : `${said}`;
    return name.endsWith(key) ? amount : `${words} ${amount}`;
  });
  return given.length ? `${t(name)} ${given.join(", ")}` : t(name);
}

/**
 * Describe an order's outcome, and until when agents pass it on and begin it.
 * @param {CommandRow} command
 * @param {number} now_s
 */
export function fate([, , , , , heard, done, refused, expires_s, state, superseded, refusers], now_s) {
  const parts = [heard ? t("heard by {count}", { count: heard }) : t("heard by nobody yet")];
  if (done && state !== "done") parts.push(t("done by {count}", { count: done }));
  if (refused) parts.push(t("refused by {agents}", { agents: refusers.length ? agentsOf(refusers, refused) : refused }));
  if (superseded) parts.push(t("replaced at {count}", { count: superseded }));
  if (state === "expired") return t("heard by nobody in time");
  const outcome = parts.join(", ");
  return now_s < expires_s ? t("{outcome}; passed on until {time}", { outcome, time: clock(expires_s) }) : outcome;
}

/** @type {Record<string, string>} */
const INPUTS = {
  command: later("an order"),
  judge: later("a judgement"),
  note: later("a note"),
  isa: later("an answer to ISA"),
  tlx: later("the answers to NASA-TLX"),
  form: later("the answers to a form"),
  ready: later("that you are ready"),
  read: later("that messages are read"),
  pace: later("a change of the pace"),
  veto: later("a veto"),
  help: later("a call for help"),
  sheet: later("the sheet"),
};

/**
 * Name an input, and what it was about.
 * @param {import("./types.js").Intent} intent
 */
export function inputName(intent) {
  const name = t(INPUTS[intent.type] ?? intent.type);
  if (intent.type === "judge") return `${name} (${t("event {number}", { number: eventName(intent.event) })}, ${t(intent.answer)})`;
  const about = intent.type === "command" ? t(intent.name) : intent.type === "note" ? intent.text : "";
  return about ? `${name} (${about})` : name;
}

/**
 * Name an open question.
 * @param {import("./types.js").Probe} probe
 */
export function question(probe) {
  if (probe.kind === "sheet") return t("to consent");
  if (probe.kind === "tlx") return "NASA-TLX";
  return probe.kind === "isa" ? t("ISA (question {number})", { number: probe.number + 1 }) : t(probe.form.title || probe.form.name);
}
