/** Where agents are drawn: several at one place stand in a circle around it, or they would look like one. */

/** @typedef {import("./types.js").AgentRow} AgentRow */
/** @typedef {import("./view.js").View} View */
/** @typedef {[number, number, number]} Spot agent, x, y [px] */

/**
 * @param {AgentRow[]} agents
 * @param {View} view
 * @returns {Map<number, [number, number]>} position of each agent [px]
 */
export function spread(agents, view) {
  /** @type {Spot[][]} */
  const groups = [];
  /** @type {Map<string, Spot[]>} groups by the cell, of a marker's size, of their first agent */
  const cells = new Map();
  for (const [id, x_m, y_m] of [...agents].sort((a, b) => a[0] - b[0])) {
    const [x, y] = view.toScreen(x_m, y_m);
    const [column, row] = [Math.floor(x / view.marker_px), Math.floor(y / view.marker_px)];
    const near = [-1, 0, 1].flatMap((down) => [-1, 0, 1].map((right) => cells.get(`${column + right} ${row + down}`)));
    const group = near.find((group) => group?.[0] && Math.hypot(group[0][1] - x, group[0][2] - y) < view.marker_px);
    if (group) group.push([id, x, y]);
    else {
      groups.push([[id, x, y]]);
      cells.set(`${column} ${row}`, /** @type {Spot[]} */ (groups.at(-1)));
    }
  }
  /** @type {Map<number, [number, number]>} */
  const places = new Map();
  for (const group of groups) {
    const count = group.length;
    const radius = count > 1 ? view.marker_px / Math.sin(Math.PI / count) : 0;
    for (const [at, [id, x, y]] of group.entries()) {
      const angle = (2 * Math.PI * at) / count;
      places.set(id, [x + radius * Math.sin(angle), y - radius * Math.cos(angle)]);
    }
  }
  return places;
}
