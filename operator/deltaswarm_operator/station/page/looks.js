/** Colours and shapes: either alone distinguishes roles, for any eye and on any screen. */

import { later } from "./language.js";

/**
 * Okabe and Ito's palette, as in recordings.
 * @type {Record<string, [string, string]>}
 */
const ROLES = {
  free: ["#56b4e9", "circle"],
  attending: ["#e69f00", "diamond"],
  root: ["#d55e00", "square"],
  member: ["#0072b2", "triangle"],
  orphan: ["#cc79a7", "down"],
  relocating: ["#009e73", "pentagon"],
  leaving: ["#f0e442", "hexagon"],
  dead: ["#999999", "cross"],
};
const OTHERS = ["#88ccee", "#ddcc77", "#cc6677", "#117733", "#aa4499", "#44aa99", "#882255"];

/** @typedef {{ink: string, soft: string, faint: string, arena: string, outside: string, obstacle: string, halo: string, accent: string}} Inks */

/** @type {{light: Inks, dark: Inks}} */
const INKS = {
  light: {
    ink: "#1b2028",
    soft: "#6b7480",
    faint: "#e3e7ec",
    arena: "#ffffff",
    outside: "#eef1f4",
    obstacle: "#c3c9d1",
    halo: "#ffffff",
    accent: "#6a1fb5",
  },
  dark: {
    ink: "#eef1f5",
    soft: "#97a1ad",
    faint: "#2a313a",
    arena: "#12161b",
    outside: "#1b2027",
    obstacle: "#48525e",
    halo: "#12161b",
    accent: "#d3a6ff",
  },
};

/**
 * Bands of the heat map: maximum age [s], label, and opacity.
 * @type {[number, string, number][]}
 */
export const HEAT = [
  [10, "10 s", 0.5],
  [60, "1 min", 0.36],
  [300, "5 min", 0.24],
  [900, "15 min", 0.14],
  [Infinity, later("older"), 0.07],
];
/**
 * Bands of activity: least number of agents on average, label, and opacity.
 * @type {[number, string, number][]}
 */
export const ACTIVITY = [
  [2, later("2 and more"), 0.6],
  [1, "1", 0.44],
  [0.3, "0.3", 0.28],
  [0.05, later("less"), 0.14],
];
const ACTIVITY_RGB = { light: "0, 80, 190", dark: "110, 170, 255" };
const HEAT_RGB = { light: "0, 120, 110", dark: "60, 210, 190" };

export function isDark() {
  const chosen = document.documentElement.dataset["theme"];
  return chosen ? chosen === "dark" : window.matchMedia("(prefers-color-scheme: dark)").matches;
}

export const inks = () => INKS[isDark() ? "dark" : "light"];

/** @param {number} age_s */
export function heat(age_s) {
  const band = HEAT.find(([limit]) => age_s < limit);
  return `rgba(${HEAT_RGB[isDark() ? "dark" : "light"]}, ${band ? band[2] : 0})`;
}

/** @param {number} agents */
export function activity(agents) {
  const band = ACTIVITY.find(([least]) => agents >= least);
  return `rgba(${ACTIVITY_RGB[isDark() ? "dark" : "light"]}, ${band ? band[2] : 0})`;
}

/**
 * @param {string} role
 * @returns {[string, string]} colour and shape
 */
export function look(role) {
  const known = Object.hasOwn(ROLES, role) ? ROLES[role] : undefined;
  if (known) return known;
  let sum = 0;
  for (const letter of role) sum = (sum * 31 + (letter.codePointAt(0) ?? 0)) % 9973;
  return [OTHERS[sum % OTHERS.length] ?? "#88ccee", "octagon"];
}

/**
 * The share of the colour that remains at this age.
 * @param {number} age_s
 */
export const strength = (age_s) => Math.max(0.4, 1 - Math.max(0, age_s - 5) / 120);

/**
 * Regular shapes: number of corners, and rotation [in angles between corners].
 * @type {Record<string, [number, number]>}
 */
const CORNERS = {
  square: [4, 0.5],
  diamond: [4, 0],
  triangle: [3, 0],
  down: [3, 0.5],
  pentagon: [5, 0],
  hexagon: [6, 0],
  octagon: [8, 0.5],
};

/**
 * Trace a marker, to be filled or stroked.
 * @param {CanvasRenderingContext2D} on
 * @param {string} shape
 * @param {number} x
 * @param {number} y
 * @param {number} size radius [px]
 */
export function trace(on, shape, x, y, size) {
  on.beginPath();
  if (shape === "cross" || shape === "star") {
    for (let arm = 0; arm < (shape === "star" ? 3 : 2); arm += 1) {
      const angle = shape === "star" ? (arm * Math.PI) / 3 + Math.PI / 2 : Math.PI / 4 + (arm * Math.PI) / 2;
      on.moveTo(x - size * Math.cos(angle), y - size * Math.sin(angle));
      on.lineTo(x + size * Math.cos(angle), y + size * Math.sin(angle));
    }
    return;
  }
  const corners = CORNERS[shape];
  if (!corners) {
    on.arc(x, y, size, 0, 2 * Math.PI);
    return;
  }
  const [many, turn] = corners;
  for (let corner = 0; corner < many; corner += 1) {
    const angle = ((corner + turn) * 2 * Math.PI) / many - Math.PI / 2;
    on.lineTo(x + size * Math.cos(angle), y + size * Math.sin(angle));
  }
  on.closePath();
}

/**
 * @param {string} role
 * @param {number} size of markers [px]
 */
const markRadius = (role, size) => (role === "root" ? size * 1.35 : size * 1.1);

/**
 * Draw an agent's body, a disc to scale and no smaller than the marker that stands on it.
 * @param {CanvasRenderingContext2D} on
 * @param {string} role
 * @param {number} x
 * @param {number} y
 * @param {number} radius of the body [px]
 * @param {number} size of markers [px]
 */
export function markBody(on, role, x, y, radius, size) {
  on.beginPath();
  on.arc(x, y, Math.max(radius, markRadius(role, size)), 0, 2 * Math.PI);
  const [alpha, { ink }] = [on.globalAlpha, inks()];
  on.fillStyle = look(role)[0];
  on.globalAlpha = 0.35 * alpha;
  on.fill();
  on.globalAlpha = alpha;
  on.strokeStyle = ink;
  on.lineWidth = 1;
  on.stroke();
}

/**
 * Draw an agent's marker: filled if the agent reported itself, hollow if another agent named it.
 * @param {CanvasRenderingContext2D} on
 * @param {string} role
 * @param {number} x
 * @param {number} y
 * @param {boolean} own
 * @param {number} size radius [px]
 */
export function mark(on, role, x, y, own, size) {
  const [colour, shape] = look(role);
  const { ink, halo } = inks();
  trace(on, shape, x, y, markRadius(role, size));
  on.lineJoin = "round";
  if (shape === "cross") {
    on.strokeStyle = colour;
    on.lineWidth = 3;
    on.stroke();
    return;
  }
  if (!own) {
    on.strokeStyle = ink;
    on.lineWidth = 4;
    on.stroke();
  }
  on.fillStyle = own ? colour : halo;
  on.fill();
  on.strokeStyle = own ? ink : colour;
  on.lineWidth = own ? 1 : 2.5;
  on.stroke();
}

/**
 * @param {CanvasRenderingContext2D} on
 * @param {number} x
 * @param {number} y
 * @param {number} size radius [px]
 */
export function markEvent(on, x, y, size) {
  const { ink, halo } = inks();
  on.lineCap = "round";
  for (const [colour, width] of /** @type {[string, number][]} */ ([
    [halo, 5],
    [ink, 2.5],
  ])) {
    trace(on, "star", x, y, size);
    on.strokeStyle = colour;
    on.lineWidth = width;
    on.stroke();
  }
}

/**
 * Draw the ring of a newly reported event.
 * @param {CanvasRenderingContext2D} on
 * @param {number} x
 * @param {number} y
 * @param {number} radius [px]
 */
export function markNew(on, x, y, radius) {
  on.beginPath();
  on.arc(x, y, radius, 0, 2 * Math.PI);
  on.strokeStyle = inks().ink;
  on.lineWidth = 1.5;
  on.stroke();
}

/**
 * @param {CanvasRenderingContext2D} on
 * @param {number} x
 * @param {number} y
 * @param {number} size radius [px]
 */
export function markBase(on, x, y, size) {
  const { ink, halo } = inks();
  on.beginPath();
  on.moveTo(x, y - size * 1.3);
  on.lineTo(x + size * 1.2, y - size * 0.2);
  on.lineTo(x + size * 0.9, y - size * 0.2);
  on.lineTo(x + size * 0.9, y + size);
  on.lineTo(x - size * 0.9, y + size);
  on.lineTo(x - size * 0.9, y - size * 0.2);
  on.lineTo(x - size * 1.2, y - size * 0.2);
  on.closePath();
  on.fillStyle = halo;
  on.fill();
  on.strokeStyle = ink;
  on.lineWidth = 2;
  on.stroke();
}
