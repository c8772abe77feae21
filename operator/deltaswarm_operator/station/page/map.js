/** The map's panel: pan, zoom, select, and choose an order's target. */

import { byId, element, input, setText } from "./dom.js";
import { draw } from "./draw.js";
import { Heat } from "./heat.js";
import { t } from "./language.js";
import { activities, ages, markers } from "./legend.js";
import { inks } from "./looks.js";
import { spread } from "./spread.js";
import { View } from "./view.js";
import { aboutAgent, aboutEvent, eventName, place } from "./words.js";

/** @typedef {import("./types.js").App} App */
/** @typedef {import("./types.js").Selection} Selection */
/** @typedef {"heat" | "activity" | "labels" | "trees"} Layer */

const NEAR_PX = 16;
const PAN_PX = 40;
const ZOOM = 1.25;
/** @type {Record<string, [number, number]>} */
const ARROWS = { ArrowLeft: [PAN_PX, 0], ArrowRight: [-PAN_PX, 0], ArrowUp: [0, PAN_PX], ArrowDown: [0, -PAN_PX] };

export class MapPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.canvas = byId("map", HTMLCanvasElement);
    this.on = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    this.info = element("map-info");
    this.view = new View();
    this.heat = new Heat();
    /** @type {Selection | null} */
    this.hovered = null;
    /** @type {Map<number, [number, number]>} position of each pointer that touches the map */
    this.pointers = new Map();
    this.hasMoved = false;
    this.isDirty = false;
    this.legendOf = "";
    this.onDraw = () => {};
    /** kind of the view: the truth and a task need no heat map, so it is off there until asked for */
    this.kind = "";
    this.arenaOf = "";
    this.layers = {
      heat: input("layer-heat"),
      activity: input("layer-activity"),
      labels: input("layer-labels"),
      trees: input("layer-trees"),
    };
    for (const box of Object.values(this.layers)) box.addEventListener("change", () => this.redraw());
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.listen();
  }

  listen() {
    const { canvas, view } = this;
    element("map-in").addEventListener("click", () => this.zoom(ZOOM));
    element("map-out").addEventListener("click", () => this.zoom(1 / ZOOM));
    element("map-fit").addEventListener("click", () => this.fit());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    canvas.addEventListener("pointercancel", (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener("pointerleave", () => this.hover(null));
    canvas.addEventListener("focus", () => this.redraw());
    canvas.addEventListener("blur", () => this.redraw());
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("dblclick", (event) => {
      view.zoom(ZOOM * ZOOM, event.offsetX, event.offsetY);
      this.redraw();
    });
  }

  resize() {
    const { canvas, view } = this;
    const dots = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !height) return;
    canvas.width = Math.round(width * dots);
    canvas.height = Math.round(height * dots);
    this.on.setTransform(dots, 0, 0, dots, 0, 0);
    const isFitted = view.isFitted || view.width === 1;
    view.pan((width - view.width) / 2, (height - view.height) / 2);
    [view.width, view.height] = [width, height];
    if (isFitted) this.fit();
    else this.redraw();
  }

  /** Take a new hello. */
  start() {
    const { hello } = this.app.model;
    if (!hello) return;
    this.heat.start(hello.run, hello.arena_m);
    const kind = `${hello.kind} ${hello.goal}`;
    if (kind !== this.kind) this.layers.heat.checked = !hello.goal && !["researcher", "conductor"].includes(hello.kind);
    this.kind = kind;
    for (const [name, box] of Object.entries(this.layers)) {
      const isOffered = hello.layers?.includes(name) ?? true;
      if (!isOffered) box.checked = false;
      for (const label of box.labels ?? []) label.hidden = !isOffered;
    }
    const arena = JSON.stringify([hello.run, hello.arena_m, hello.base_m]);
    if (arena !== this.arenaOf) this.fit();
    this.arenaOf = arena;
  }

  fit() {
    const { hello } = this.app.model;
    if (hello) this.view.fit(hello.arena_m, hello.base_m);
    this.redraw();
  }

  /** @param {number} factor */
  zoom(factor) {
    this.view.zoom(factor);
    this.redraw();
  }

  /** @param {Layer} layer */
  toggle(layer) {
    if (!this.layers[layer].labels?.[0]?.hidden) this.layers[layer].click();
  }

  /** Take a new picture. */
  update() {
    const { model } = this.app;
    this.heat.take(model.heard, model.now_s);
    for (const label of this.layers.trees.labels ?? []) label.classList.toggle("unneeded", !model.agents.some((agent) => agent[5] >= 0));
    this.legend();
    this.tell();
    this.redraw();
  }

  redraw() {
    if (this.isDirty) return;
    this.isDirty = true;
    window.requestAnimationFrame(() => {
      this.isDirty = false;
      const { heat, activity, labels, trees } = this.layers;
      element("heat-legend").hidden = !heat.checked;
      element("activity-legend").hidden = !activity.checked;
      const layers = {
        heat: heat.checked,
        activity: activity.checked,
        labels: labels.checked,
        trees: trees.checked,
      };
      draw(this.on, this.view, this.app, layers, this.heat, document.activeElement === this.canvas);
      this.onDraw();
    });
  }

  /** @param {WheelEvent} event */
  wheel(event) {
    event.preventDefault();
    this.view.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
    this.redraw();
  }

  /** @param {PointerEvent} event */
  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.hasMoved = this.pointers.size > 1;
    if (this.app.pick?.kind === "circle" && this.pointers.size === 1)
      this.app.pick.place(...this.view.toArena(event.offsetX, event.offsetY));
  }

  /** @param {PointerEvent} event */
  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return this.hover(this.nearest(event.offsetX, event.offsetY));
    const [x, y] = [event.offsetX - before[0], event.offsetY - before[1]];
    if (!this.hasMoved && Math.hypot(x, y) < 4) return;
    this.hasMoved = true;
    const pick = this.app.pick;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const [was, is] = [
        Math.hypot(before[0] - other[0], before[1] - other[1]),
        Math.hypot(event.offsetX - other[0], event.offsetY - other[1]),
      ];
      this.view.zoom(is / Math.max(was, 1), ...other);
    } else if (pick?.kind === "circle") {
      const { x_m = 0, y_m = 0 } = pick.target();
      const [at_x_m, at_y_m] = this.view.toArena(event.offsetX, event.offsetY);
      pick.radius(Math.hypot(at_x_m - x_m, at_y_m - y_m));
      return;
    } else this.view.pan(x, y);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.redraw();
  }

  /** @param {PointerEvent} event */
  up(event) {
    if (this.pointers.delete(event.pointerId) && !this.hasMoved) this.choose(event.offsetX, event.offsetY);
  }

  /**
   * Take a click: the target of the order that is being written, else a selection.
   * @param {number} x
   * @param {number} y
   */
  choose(x, y) {
    const { pick } = this.app;
    const near = this.nearest(x, y);
    const event = near?.kind === "event" ? this.app.model.events.find((row) => row[0] === near.id) : undefined;
    if (pick?.kind === "place" && event) pick.place(event[1], event[2]);
    else if (pick?.kind === "place" || pick?.kind === "circle") pick.place(...this.view.toArena(x, y));
    else this.app.select(near);
    if (near?.kind === "agent" && (pick?.kind === "agent" || pick?.kind === "tree")) pick.agent(near.id);
  }

  /**
   * @param {number} x
   * @param {number} y
   * @returns {Selection | null}
   */
  nearest(x, y) {
    let least = Infinity;
    /** @type {Selection | null} */
    let near = null;
    const { agents, events, hello } = this.app.model;
    const places = spread(agents, events, this.view);
    const reach = { event: NEAR_PX, agent: Math.max(NEAR_PX, (hello?.radius_m ?? 0) * this.view.scale) };
    for (const [kind, rows] of /** @type {["agent" | "event", [number, number, number][]][]} */ (
      /** @type {unknown} */ ([
        ["event", events],
        ["agent", agents],
      ])
    )) {
      for (const [id, x_m, y_m] of rows) {
        const [at_x, at_y] = (kind === "agent" && places.get(id)) || this.view.toScreen(x_m, y_m);
        const distance = Math.hypot(at_x - x, at_y - y);
        if (distance <= Math.min(least, reach[kind])) [least, near] = [distance, { kind, id }];
      }
    }
    return near;
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const arrow = ARROWS[event.key];
    if (arrow) this.view.pan(...arrow);
    else if (event.key === "+" || event.key === "=") this.view.zoom(ZOOM);
    else if (event.key === "-") this.view.zoom(1 / ZOOM);
    else if (event.key === "PageDown" || event.key === "PageUp") this.step(event.key === "PageDown" ? 1 : -1);
    else if (event.key === "Enter") this.choose(this.view.width / 2, this.view.height / 2);
    else return;
    event.preventDefault();
    this.redraw();
  }

  /**
   * Select the next agent (`by` 1) or the previous one (-1).
   * @param {number} by
   */
  step(by) {
    const ids = this.app.model.agents.map((agent) => agent[0]).sort((a, b) => a - b);
    const at = this.app.selection?.kind === "agent" ? ids.indexOf(this.app.selection.id) : by > 0 ? -1 : 0;
    const id = ids[(at + by + ids.length) % ids.length];
    if (id !== undefined) this.app.select({ kind: "agent", id }, true);
  }

  /** @param {Selection} selection */
  reveal({ kind, id }) {
    const { agents, events } = this.app.model;
    const found = kind === "agent" ? agents.find((agent) => agent[0] === id) : events.find((event) => event[0] === id);
    if (found) this.view.reveal(found[1], found[2]);
  }

  /** @param {Selection | null} near */
  hover(near) {
    if (near?.id === this.hovered?.id && near?.kind === this.hovered?.kind) return;
    this.hovered = near;
    this.canvas.classList.toggle("over", near !== null);
    this.tell();
  }

  /** Describe what is under the pointer, or else the selection. */
  tell() {
    const { model, selection } = this.app;
    const about = this.hovered ?? selection;
    const pick = this.app.pick?.kind;
    if (!about && (pick === "place" || pick === "circle"))
      return setText(
        this.info,
        pick === "place"
          ? t("Click on the map, or choose an event, for the place.")
          : t("Click on the map to choose the centre; drag to choose the radius."),
      );
    if (!about && pick && pick !== "all") return setText(this.info, t("Click on an agent on the map to choose."));
    const agent = about?.kind === "agent" ? model.agents.find((row) => row[0] === about.id) : undefined;
    const event = about?.kind === "event" ? model.events.find((row) => row[0] === about.id) : undefined;
    const isOther = about?.kind !== selection?.kind || about?.id !== selection?.id;
    const where = selection && isOther ? `${t("At the pointer:")} ` : "";
    if (agent) {
      const told = { number: agent[0], about: aboutAgent(agent, model), place: place(agent[1], agent[2]) };
      setText(this.info, where + t("Agent {number}: {about}, {place}", told));
    } else if (event) {
      const told = { number: eventName(event[0]), about: aboutEvent(event, model), place: place(event[1], event[2]) };
      setText(this.info, where + t("Event {number}: {about}, {place}", told));
    } else if (about?.kind === "event") setText(this.info, t("Event {number} is no longer reported.", { number: eventName(about.id) }));
    else setText(this.info, t("Nothing is selected. Click an agent or an event."));
  }

  /** Explain the markers on the map. */
  legend() {
    const { model } = this.app;
    const roles = [...new Set(model.agents.map((agent) => agent[3]))].sort();
    const key = JSON.stringify([
      roles,
      model.events.length > 0,
      model.agents.some((agent) => !agent[7]),
      model.hello?.base_m,
      model.hello?.radius_m,
      Boolean(model.shownTruth),
      inks().ink,
    ]);
    if (key === this.legendOf) return;
    this.legendOf = key;
    element("map-legend").replaceChildren(...markers(model));
    element("heat-legend").replaceChildren(...ages());
    element("activity-legend").replaceChildren(...activities());
  }
}
