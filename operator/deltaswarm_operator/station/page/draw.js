/** Draws the map: only what was reported, fading with age. */

import { Labels } from "./labels.js";
import { t } from "./language.js";
import { activity, heat as heatColour, inks, mark, markBase, markBody, markEvent, markNew, strength } from "./looks.js";
import { cross, ordered, ring, roundLength, ruler, trail } from "./overlays.js";
import { spread } from "./spread.js";
import { age, eventName } from "./words.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./types.js").Hello} Hello */
/** @typedef {import("./view.js").View} View */
/** @typedef {CanvasRenderingContext2D} Canvas */
/** @typedef {Map<number, [number, number]>} Places positions of agents [px] */
/** @typedef {{heat: boolean, activity: boolean, labels: boolean, trees: boolean}} Layers */

const OLD_S = 30;
const NEW_EVENT_S = 20;

/**
 * @param {Canvas} on
 * @param {View} view
 * @param {App} app
 * @param {Layers} layers
 * @param {import("./heat.js").Heat} heat
 * @param {boolean} hasFocus
 */
export function draw(on, view, app, layers, heat, hasFocus) {
  const { hello } = app.model;
  on.globalAlpha = 1;
  on.setLineDash([]);
  on.fillStyle = inks().outside;
  on.fillRect(0, 0, view.width, view.height);
  if (!hello) return;
  ground(on, view, hello);
  if (layers.heat) shade(on, view, heat, (cell) => heatColour(app.model.now_s - (heat.heard_s[cell] ?? NaN)));
  if (layers.activity) shade(on, view, heat, (cell) => activity(heat.active[cell] ?? 0));
  fixed(on, view, hello);
  const places = spread(app.model.agents, app.model.events, view);
  if (hello.radius_m) bodies(on, view, app, places, hello.radius_m * view.scale);
  if (layers.trees) trees(on, view, app);
  const labels = new Labels();
  if (app.covered) labels.taken.push(app.covered);
  for (const event of app.model.events) drawEvent(on, view, event, app, labels);
  for (const agent of app.model.agents) drawAgent(on, view, agent, places, app, labels);
  on.globalAlpha = 1;
  ordered(on, view, app);
  if (layers.labels) labels.draw(on);
  chosen(on, view, app, places);
  picked(on, view, app, places, hasFocus);
  seenByThem(on, view, app, places);
  ruler(on, view);
}

/**
 * @param {Canvas} on
 * @param {View} view
 * @param {Hello} hello
 */
function ground(on, view, hello) {
  const { arena, faint, soft } = inks();
  const [left, top] = view.toScreen(0, hello.arena_m[1]);
  const [right, bottom] = view.toScreen(hello.arena_m[0], 0);
  on.fillStyle = arena;
  on.fillRect(left, top, right - left, bottom - top);
  on.strokeStyle = faint;
  on.lineWidth = 1;
  on.beginPath();
  const step_m = roundLength(70 / view.scale);
  for (let x_m = step_m; x_m < hello.arena_m[0]; x_m += step_m) line(on, view, x_m, 0, x_m, hello.arena_m[1]);
  for (let y_m = step_m; y_m < hello.arena_m[1]; y_m += step_m) line(on, view, 0, y_m, hello.arena_m[0], y_m);
  on.stroke();
  on.strokeStyle = soft;
  on.lineWidth = 1.5;
  on.strokeRect(left, top, right - left, bottom - top);
}

/**
 * @param {Canvas} on
 * @param {View} view
 * @param {number} x_m
 * @param {number} y_m
 * @param {number} to_x_m
 * @param {number} to_y_m
 */
function line(on, view, x_m, y_m, to_x_m, to_y_m) {
  on.moveTo(...view.toScreen(x_m, y_m));
  on.lineTo(...view.toScreen(to_x_m, to_y_m));
}

/**
 * @param {Canvas} on
 * @param {View} view
 * @param {import("./heat.js").Heat} heat
 * @param {(cell: number) => string} colour
 */
function shade(on, view, heat, colour) {
  for (let row = 0; row < heat.rows; row += 1) {
    for (let column = 0; column < heat.columns; column += 1) {
      const cell = row * heat.columns + column;
      if (Number.isNaN(heat.heard_s[cell])) continue;
      const [left, bottom] = view.toScreen(column * heat.cell_m, row * heat.cell_m).map(Math.round);
      const [right, top] = view.toScreen((column + 1) * heat.cell_m, (row + 1) * heat.cell_m).map(Math.round);
      on.fillStyle = colour(cell);
      on.fillRect(left ?? 0, top ?? 0, (right ?? 0) - (left ?? 0), (bottom ?? 0) - (top ?? 0));
    }
  }
}

/**
 * @param {Canvas} on
 * @param {View} view
 * @param {Hello} hello
 */
function fixed(on, view, hello) {
  const { obstacle, soft } = inks();
  on.fillStyle = obstacle;
  on.strokeStyle = soft;
  on.lineWidth = 1;
  for (const corners of hello.obstacles) {
    on.beginPath();
    for (const [x_m, y_m] of corners) on.lineTo(...view.toScreen(x_m, y_m));
    on.closePath();
    on.fill();
    on.stroke();
  }
  if (!hello.base_m) return;
  const [x, y] = view.toScreen(...hello.base_m);
  if (hello.range_m) {
    on.beginPath();
    on.arc(x, y, hello.range_m * view.scale, 0, 2 * Math.PI);
    on.setLineDash([6, 5]);
    on.strokeStyle = soft;
    on.lineWidth = 1.5;
    on.stroke();
    on.setLineDash([]);
  }
  markBase(on, x, y, 8);
}

/**
 * Draw the agents' bodies below all markers, so that none hides another agent's.
 * @param {Canvas} on
 * @param {View} view
 * @param {App} app
 * @param {Places} places
 * @param {number} radius [px]
 */
function bodies(on, view, { model }, places, radius) {
  for (const [id, x_m, y_m, role, , , said_s] of model.agents) {
    on.globalAlpha = strength(model.now_s - said_s);
    markBody(on, role, ...(places.get(id) ?? view.toScreen(x_m, y_m)), radius, view.marker_px);
  }
  on.globalAlpha = 1;
}

/**
 * @param {Canvas} on
 * @param {View} view
 * @param {App} app
 */
function trees(on, view, { model, selection }) {
  const { ink, accent } = inks();
  const places = new Map(model.agents.map((agent) => [agent[0], agent]));
  const chosen = selection?.kind === "agent" ? places.get(selection.id) : undefined;
  const tree = chosen && (chosen[5] >= 0 ? chosen[5] : chosen[3] === "root" ? chosen[0] : -1);
  for (const [, x_m, y_m, , parent, root, said_s] of places.values()) {
    const above = places.get(parent);
    if (!above) continue;
    const isChosen = tree !== undefined && tree >= 0 && root === tree;
    on.globalAlpha = isChosen ? 1 : 0.6 * Math.min(strength(model.now_s - said_s), strength(model.now_s - above[6]));
    on.strokeStyle = isChosen ? accent : ink;
    on.lineWidth = isChosen ? 3 : 1.8;
    on.beginPath();
    line(on, view, x_m, y_m, above[1], above[2]);
    on.stroke();
  }
  on.globalAlpha = 1;
}

/**
 * @param {Canvas} on
 * @param {View} view
 * @param {import("./types.js").EventRow} event
 * @param {App} app
 * @param {Labels} labels
 */
function drawEvent(on, view, [id, x_m, y_m, first_s, seen_s, , attending, before], { model, selection }, labels) {
  const [x, y] = view.toScreen(x_m, y_m);
  const age_s = model.now_s - seen_s;
  const isSelected = selection?.kind === "event" && selection.id === id;
  for (const place of isSelected ? before : []) labels.keep(...view.toScreen(...place), 4);
  on.globalAlpha = strength(age_s);
  markEvent(on, x, y, view.marker_px + 1);
  if (model.now_s - first_s < NEW_EVENT_S) markNew(on, x, y, view.marker_px + 5);
  const judged = model.judged.get(id);
  const parts = [(id < 0 ? "" : "e") + eventName(id), ...(judged ? [t(judged)] : []), ...(attending.length > 1 ? [t("{count} agents", { count: attending.length })] : []), ...(age_s > OLD_S ? [age(age_s)] : [])];
  const text = parts.join(" · ");
  labels.add({ text, x, y, size: view.marker_px + 2, strength: strength(age_s), rank: isSelected ? 0 : 2 });
}

/**
 * Draw what is selected on top of everything: a ring, and the places at which an event was reported.
 * @param {Canvas} on
 * @param {View} view
 * @param {App} app
 * @param {Places} places
 */
function chosen(on, view, { model, selection }, places) {
  if (!selection) return;
  const event = selection.kind === "event" && model.events.find((row) => row[0] === selection.id);
  if (event) trail(on, view, [...event[7], [event[1], event[2]]]);
  const row = event || (selection.kind === "agent" && model.agents.find((agent) => agent[0] === selection.id));
  if (row) ring(on, ...((selection.kind === "agent" && places.get(selection.id)) || view.toScreen(row[1], row[2])), view.marker_px);
}

/**
 * @param {Canvas} on
 * @param {View} view
 * @param {import("./types.js").AgentRow} agent
 * @param {Places} places
 * @param {App} app
 * @param {Labels} labels
 */
function drawAgent(on, view, [id, x_m, y_m, role, , , said_s, own], places, { model, selection }, labels) {
  const [x, y] = places.get(id) ?? view.toScreen(x_m, y_m);
  const age_s = model.now_s - said_s;
  on.globalAlpha = strength(age_s);
  mark(on, role, x, y, Boolean(own), view.marker_px);
  const isSelected = selection?.kind === "agent" && selection.id === id;
  const text = age_s > OLD_S ? `${id} · ${age(age_s)}` : `${id}`;
  const rank = isSelected ? 0 : role === "root" ? 1 : 3 + age_s;
  labels.add({ text, x, y, size: view.marker_px, strength: strength(age_s), rank });
}

/**
 * Draw the target of the order that is being written.
 * @param {Canvas} on
 * @param {View} view
 * @param {App} app
 * @param {Places} places
 * @param {boolean} hasFocus
 */
function picked(on, view, { pick, model }, places, hasFocus) {
  if (!pick) return;
  const { accent } = inks();
  on.strokeStyle = accent;
  on.lineWidth = 2;
  const target = pick.target();
  const { x_m, y_m } = target;
  if (x_m !== undefined && y_m !== undefined) {
    const [x, y] = view.toScreen(x_m, y_m);
    cross(on, x, y, 9);
    if (target.radius_m !== undefined) {
      on.beginPath();
      on.arc(x, y, target.radius_m * view.scale, 0, 2 * Math.PI);
      on.globalAlpha = 0.12;
      on.fillStyle = accent;
      on.fill();
      on.globalAlpha = 1;
      on.stroke();
    }
  }
  for (const [id, at_x_m, at_y_m, , , root] of model.agents) {
    if (id === target.agent || (target.root !== undefined && (root === target.root || id === target.root)))
      ring(on, ...(places.get(id) ?? view.toScreen(at_x_m, at_y_m)), view.marker_px);
  }
  if (hasFocus) {
    on.setLineDash([3, 3]);
    cross(on, view.width / 2, view.height / 2, 14);
    on.setLineDash([]);
  }
}

/**
 * Draw a dashed ring around what the participant has selected, for the conductor.
 * @param {Canvas} on
 * @param {View} view
 * @param {App} app
 * @param {Places} places
 */
function seenByThem(on, view, { model }, places) {
  const { theirs } = model;
  const rows = theirs?.kind === "agent" ? model.agents : model.events;
  const found = theirs && /** @type {[number, number, number][]} */ (/** @type {unknown} */ (rows)).find(([id]) => id === theirs.id);
  if (!theirs || !found) return;
  on.setLineDash([4, 3]);
  ring(on, ...((theirs.kind === "agent" && places.get(theirs.id)) || view.toScreen(found[1], found[2])), view.marker_px + 5);
  on.setLineDash([]);
}
