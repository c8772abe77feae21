/** Where agents are drawn: several at one place stand in a circle around it, or they would look like one. */

/** @typedef {import("./types.js").AgentRow} AgentRow */
/** @typedef {import("./view.js").View} View */

/**
 * @param {AgentRow[]} agents
 * @param {View} view
 * @returns {Map<number, [number, number]>} position of each agent [px]
 */
export function spread(agents, view) {
  /** @type {Map<string, [number, number, number][]>} */
  const groups = new Map();
  for (const [id, x_m, y_m] of agents) {
    const [x, y] = view.toScreen(x_m, y_m);
    const cell = `${Math.round(x / view.marker_px)} ${Math.round(y / view.marker_px)}`;
    const group = groups.get(cell);
    if (group) group.push([id, x, y]);
    else groups.set(cell, [[id, x, y]]);
  }
  /** @type {Map<number, [number, number]>} */
  const places = new Map();
  for (const group of groups.values()) {
    const count = group.length;
    const radius = count > 1 ? view.marker_px / Math.sin(Math.PI / count) : 0;
    group.sort(([a], [b]) => a - b);
    for (const [at, [id, x, y]] of group.entries()) {
      const angle = (2 * Math.PI * at) / count;
      places.set(id, [x + radius * Math.sin(angle), y - radius * Math.cos(angle)]);
    }
  }
  return places;
}
