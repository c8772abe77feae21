/** The station's page: connects the link, the model and the panels. */

import { AutonomyPanel } from "./autonomy.js";
import { CommandPanel } from "./commands.js";
import { ConductPanel } from "./conduct.js";
import { choice, element, setText } from "./dom.js";
import { FormPanel } from "./form.js";
import { HelpCall } from "./help_call.js";
import { InboxPanel } from "./inbox.js";
import { IsaPanel } from "./isa.js";
import { Keys } from "./keys.js";
import { KnowledgePanel } from "./knowledge.js";
import { retell, speak, t } from "./language.js";
import { Link } from "./link.js";
import { MapPanel } from "./map.js";
import { Model } from "./model.js";
import { offerPanels } from "./offers.js";
import { PacePanel } from "./pace.js";
import { Outbox } from "./outbox.js";
import { PageEvents } from "./page_events.js";
import { showPlain } from "./plain.js";
import { startScreen } from "./screen.js";
import { SessionPanel } from "./session.js";
import { ELSEWHERE, shortcuts } from "./shortcuts.js";
import { Tabs } from "./tabs.js";
import { TaskPanel } from "./task.js";
import { startTheme } from "./theme.js";
import { TlxPanel } from "./tlx.js";
import { inputName, question } from "./words.js";
import { WorkloadPanel } from "./workload.js";

const LISTS_EVERY_MS = 250;
const SILENT_MS = 4000;
const SAID_MS = 6000;
const ASK_EVERY_MS = 1000;
const SHOW_EVERY_MS = 1000;

/** @type {import("./types.js").App} */
const app = {
  model: new Model(),
  selection: null,
  pick: null,
  covered: null,
  send(intent) {
    if (intent.type === "held") link.send(intent); // asks to be shown something: nothing is noted of it
    else if (isNoting() && !link.hasEnded) {
      if (!outbox.add(intent)) refused(intent.type, t("it is too long"));
    } else if (intent.type !== "page" && !link.send(intent))
      app.say(link.hasEnded ? t("Not sent: the run has ended.") : t("Not sent: there is no connection."));
  },
  waiting: (fits) => outbox.waiting(fits),
  isLate: (page_s) => outbox.isLate(page_s),
  say(text) {
    setText(element("said"), text);
    window.clearTimeout(saidTimer);
    saidTimer = window.setTimeout(() => setText(element("said"), ""), SAID_MS);
  },
  select(selection, reveal = false, forOrder = true) {
    app.selection = selection;
    if (!selection?.byItself) task.selected();
    if (selection && reveal) map.reveal(selection);
    if (forOrder && selection?.kind === "agent") app.pick?.agent(selection.id);
    if (forOrder && selection?.kind === "event") app.pick?.event(selection.id);
    map.tell();
    map.redraw();
    knowledge.update();
    if (choice("inbox-filter").value === "selected") inbox.update();
  },
  redraw() {
    map.redraw();
    map.tell();
  },
};

let saidTimer = 0;
let listsTimer = 0;
let heardAt_ms = performance.now();
let isOpen = false;
/** Whether it was told that nothing of the run is left to send. */
let isDone = false;
/** Whether no hello has come over this connection yet. */
let isNew = true;
/** Whether no picture has come over this connection yet; the first one may be old. */
let isFirstPicture = true;
/** Whether the feed writes down what this page sends. */
const isNoting = () => ["live", "conductor"].includes(app.model.hello?.kind ?? "");

const map = new MapPanel(app);
const workload = new WorkloadPanel(app);
const inbox = new InboxPanel(app);
const knowledge = new KnowledgePanel(app);
const commands = new CommandPanel(app);
const autonomy = new AutonomyPanel(app);
const task = new TaskPanel(app, map.view);
map.onDraw = () => task.place();
const tabs = new Tabs(() => commands.aim());
const pace = new PacePanel(app);
const isa = new IsaPanel(app);
const tlx = new TlxPanel(app);
const session = new SessionPanel(app);
const form = new FormPanel(app);
const help = new HelpCall(app);
const conduct = new ConductPanel(app, (time_s) => pace.seek(time_s), () => {
  map.update();
  showLists();
});
const events = new PageEvents(
  app,
  () => tabs.chosen,
  () => map.view.scale,
);

/** @param {import("./types.js").Hello} hello */
function takeHello(hello) {
  speak(hello.language);
  const isFirst = !app.model.hello;
  const isOther = app.model.takeHello(hello);
  if (isOther) {
    app.selection = null;
    isa.forget();
    conduct.forget();
  }
  link.isBeating = app.model.hello?.kind === "live";
  link.isSteady = ["live", "conductor", "watch"].includes(app.model.hello?.kind ?? "");
  if ((isNew || isOther) && isNoting()) {
    const lost = outbox.begin(hello.run).filter((intent) => intent.type !== "page").map(inputName);
    if (lost.length) app.say(t("Not noted, since the run is over: {inputs}.", { inputs: [...new Set(lost)].join(", ") }));
  }
  isNew = false;
  if (isFirst || isOther) events.begin();
  setText(element("title"), conduct.title || t(hello.title));
  const { kind } = app.model.hello ?? hello;
  document.documentElement.dataset["kind"] = kind;
  if (kind === "researcher") setText(element("fates-none"), "The participant's page has the orders.");
  offerPanels(hello, kind, tabs);
  if (isFirst && hello.goal && kind === "live") tabs.show("tab-events");
  conduct.start();
  map.start();
  workload.start();
  commands.start();
  autonomy.start();
  task.start();
  session.start();
  showLists();
}

/** @param {import("./types.js").Picture} picture */
function takePicture(picture) {
  app.model.takePicture(picture);
  askForMissing();
  if (!isFirstPicture) heardAt_ms = performance.now();
  isFirstPicture = false;
  pace.update();
  help.update();
  conduct.follow();
  isa.update();
  autonomy.update();
  tlx.update();
  session.update();
  form.update();
  map.update();
  showListsSoon();
  showStatus();
}

/** Say whose page this is, if not the participant's, and what the participant is asked now. */
function showRole() {
  const words = {
    live: "",
    replay: "",
    watch: t("You only watch"),
    researcher: "Researcher's view: shows what no operator knows",
    conductor: `Conductor's view: shows what the participant does not know. Participant: ${conduct.words}`,
  };
  const { hello, asked, picture } = app.model;
  const isCalled = hello?.kind === "conductor" && picture?.help === "asked";
  element("role").classList.toggle("alarm", isCalled);
  if (isCalled) return setText(element("role"), "The participant calls for help.");
  const text = hello ? words[hello.kind] : "";
  element("role").hidden = !text;
  setText(element("role"), text && asked ? t("{role}. The participant is asked: {question}", { role: text, question: question(asked) }) : text);
}

let askTimer = 0;

/** Ask for missing messages, at most once a second, until an answer comes. */
function askForMissing() {
  if (askTimer || app.model.isCaughtUp) return;
  link.send({ type: "catch_up" });
  askTimer = window.setTimeout(() => {
    askTimer = 0;
    askForMissing();
  }, ASK_EVERY_MS);
}

function showListsSoon() {
  listsTimer ||= window.setTimeout(showLists, LISTS_EVERY_MS);
}

/** Update the text panels. Pictures cause this at most four times a second, since nobody reads faster. */
function showLists() {
  showRole();
  window.clearTimeout(listsTimer);
  listsTimer = 0;
  workload.update();
  inbox.update();
  knowledge.update();
  task.update();
  commands.update();
  conduct.update();
}

/** Show whether the page is up to date. */
function showStatus() {
  const { picture, hello } = app.model;
  const isSilent = performance.now() - heardAt_ms > SILENT_MS;
  let [state, words] = ["live", hello?.kind === "replay" ? t("replay") : t("live")];
  if (!picture) [state, words] = ["silent", t("waiting for the run")];
  const atEnd = t(hello?.end_text ?? "");
  element("ended").hidden = !link.hasEnded || !atEnd || hello?.kind === "conductor";
  showPlain(app.model, link.hasEnded);
  if (link.hasEnded) element("help-me").hidden = true;
  setText(element("ended"), atEnd);
  if (link.hasEnded) [state, words] = ["ended", atEnd ? t("the run has ended") : t("the run has ended; this page may be closed")];
  if (link.hasEnded && hello?.kind === "conductor" && atEnd) words = "the run has ended; the page of the next one follows here";
  else if (!isOpen) [state, words] = ["lost", hello ? t("connection lost, trying again") : t("connecting")];
  else if (picture?.over) [state, words] = ["ended", t("the run is over")];
  else if (pace.state.paused) [state, words] = ["paused", t("paused")];
  else if (picture && isSilent) [state, words] = ["silent", t("nothing new arrives")];
  setText(element("status"), words);
  element("status").dataset["state"] = state;
}

/** @param {import("./types.js").Message} message */
function take(message) {
  if (message.type === "moved") window.location.replace(message.address);
  else if (message.type === "role") app.model.isWatching = true;
  else if (message.type === "hello") takeHello(message);
  else if (message.type === "picture") takePicture(message);
  else if (message.type === "catch_up") {
    app.model.takeCatchUp(message);
    if (message.acts) {
      conduct.forget();
      conduct.take(message.acts);
    }
    showLists();
  } else if (message.type === "truth") {
    app.model.takeTruth(message);
    map.update();
    showListsSoon();
  } else if (message.type === "acts") {
    if (message.is_first) conduct.forget();
    conduct.take(message.acts);
    showListsSoon();
  } else if (message.type === "act") {
    conduct.take([message.act]);
    showListsSoon();
  } else if (message.type === "read") {
    for (const item of message.items) app.model.read.add(item);
    inbox.update();
  } else if (message.type === "held") {
    app.model.held = message.inbox;
    inbox.update();
  } else if (message.type === "accepted") commands.accepted(message.number);
  else if (message.type === "noted") noted(outbox.settle(message.id));
  else if (message.type === "refused" && !message.again) refused(outbox.settle(message.id)?.type ?? message.id, message.why);
  showStatus();
}

/** @param {import("./types.js").Intent | null} intent */
function noted(intent) {
  if (intent?.type === "isa") isa.noted(intent.number, intent.answer);
  else if (intent?.type === "tlx") tlx.noted();
  else if (intent?.type === "form" || intent?.type === "ready") form.noted(intent);
  else if (intent?.type === "sheet") session.question.noted();
  else if (intent?.type === "note") session.noted(intent.text);
  else if (intent?.type === "veto") app.say(t("Your veto is noted."));
  showKept();
}

/**
 * @param {string | null} kind of the input
 * @param {string} why
 */
function refused(kind, why) {
  if (kind === "page" || kind === "beat") return; // nobody asked for what the page notes by itself
  if (kind === "command") return commands.refused(why);
  app.say(t("Not accepted: {why}.", { why: retell(why) }));
  if (kind === "isa") isa.look();
  else if (kind === "tlx") tlx.question.refused(why);
  else if (kind === "form") form.question.refused(why);
  else if (kind === "sheet") session.question.refused(why);
  else if (kind === "note") session.look();
}

/** Say how many inputs are not noted yet, and keep what is on the way as it is. */
function showKept() {
  const count = link.hasEnded ? 0 : outbox.late;
  element("kept").hidden = count === 0;
  setText(element("kept"), count ? t("Not noted yet: {count}. It stays here, and is sent again by itself.", { count }) : "");
  const { done } = link.beatWith();
  if (done && !isDone) link.beatAt_ms = -Infinity; // the operator waits for it
  isDone = done;
  for (const { question } of [tlx, session, form]) if (question.dialog.open) question.look();
}

const link = new Link(take, (nowOpen) => {
  isOpen = nowOpen;
  if (nowOpen) {
    isNew = isFirstPicture = true;
    app.model.isCaughtUp = false;
    window.clearTimeout(askTimer);
    askTimer = 0;
  } else outbox.end();
  showStatus();
});
const outbox = new Outbox((message) => link.send(message));
link.beatWith = () => {
  outbox.rtt_s = link.rtt_s;
  return { done: Boolean(app.model.picture?.over) && outbox.isEmpty };
};

new Keys(shortcuts({ app, autonomy, form, inbox, isa, map, pace, tabs, task }), ELSEWHERE);
startScreen();
startTheme(() => {
  if (app.model.hello) workload.start();
  map.legendOf = "";
  map.legend();
  showLists();
  map.redraw();
});
window.setInterval(() => {
  showStatus();
  showKept();
}, SHOW_EVERY_MS);
