/** Where agents are drawn: those at an event stand on a ring around it, and several at one place in a circle. */

/** @typedef {import("./types.js").AgentRow} AgentRow */
/** @typedef {import("./types.js").EventRow} EventRow */
/** @typedef {import("./view.js").View} View */
/** @typedef {{x: number, y: number, isEvent: boolean, agents: number[]}} Group around a place [px] */

/** Space between the marks of an event and of the agents at it, in markers. */
const RING = 2.6;

/**
 * @param {AgentRow[]} agents
 * @param {EventRow[]} events
 * @param {View} view
 * @returns {Map<number, [number, number]>} position of each agent [px]
 */
export function spread(agents, events, view) {
  const { marker_px } = view;
  /** @type {Group[]} */
  const groups = [];
  /** @type {Map<string, Group[]>} groups by the cell in which their place is */
  const cells = new Map();
  const size = RING * marker_px;

  /**
   * @param {number} x
   * @param {number} y
   * @param {boolean} isEvent
   */
  function found(x, y, isEvent) {
    const group = { x, y, isEvent, agents: [] };
    const cell = `${Math.floor(x / size)} ${Math.floor(y / size)}`;
    cells.set(cell, [...(cells.get(cell) ?? []), group]);
    groups.push(group);
    return group;
  }

  /**
   * @param {number} x
   * @param {number} y
   */
  function near(x, y) {
    const [column, row] = [Math.floor(x / size), Math.floor(y / size)];
    const around = [-1, 0, 1].flatMap((down) => [-1, 0, 1].flatMap((right) => cells.get(`${column + right} ${row + down}`) ?? []));
    const distance = (/** @type {Group} */ group) => Math.hypot(group.x - x, group.y - y);
    const close = around.filter((group) => distance(group) < (group.isEvent ? size : marker_px));
    return close.sort((a, b) => distance(a) - distance(b))[0];
  }

  for (const [, x_m, y_m] of events) found(...view.toScreen(x_m, y_m), true);
  for (const [id, x_m, y_m] of [...agents].sort((a, b) => a[0] - b[0])) {
    const [x, y] = view.toScreen(x_m, y_m);
    (near(x, y) ?? found(x, y, false)).agents.push(id);
  }
  /** @type {Map<number, [number, number]>} */
  const places = new Map();
  for (const { x, y, isEvent, agents: ids } of groups) {
    const apart = ids.length > 1 ? marker_px / Math.sin(Math.PI / ids.length) : 0;
    const radius = isEvent ? Math.max(size, apart) : apart;
    for (const [at, id] of ids.entries()) {
      const angle = (2 * Math.PI * at) / ids.length;
      places.set(id, [x + radius * Math.sin(angle), y - radius * Math.cos(angle)]);
    }
  }
  return places;
}
