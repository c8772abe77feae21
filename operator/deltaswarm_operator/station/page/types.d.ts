/** What messages between feed and page hold, and what panels share; `messages.d.ts` has the messages. */

import type { Intent } from "./messages.js";

export type { CatchUp, Hello, Intent, Message, Picture } from "./messages.js";

/** id, x [m], y [m], role, parent, root (-1: none), time of the newest word [s], 1 if by its own report, delta (0: unknown). */
export type AgentRow = [number, number, number, string, number, number, number, number, number];
/** id, x [m], y [m], first reported [s], last reported [s], agent that reported it last (-1: nobody), who attends it, earlier places [m]. */
export type EventRow = [number, number, number, number, number, number, number[], Point[]];
/** number, time [s], agent, role, followers, events, whether it tells something new; severity, line, place in the order in which items were shown (-1: it was not). */
export type InboxRow = [
  number,
  number,
  number,
  string,
  number,
  number[],
  boolean | number,
  string?,
  number?,
  number?,
];
/** A line of the inbox: its number, its items, the one that it is listed as, the number of all that it stands for, whether it asks to be read. */
export interface InboxLine {
  number: number;
  items: InboxRow[];
  first: InboxRow;
  count: number;
  isUnread: boolean;
}
/** number, name, target, arguments, sent [s], heard by, done by, refused by, expires [s], state, replaced at, some that refused, given by. */
export type CommandRow = [
  number,
  string,
  [TargetKind, ...number[]],
  Record<string, unknown>,
  number,
  number,
  number,
  number,
  number,
  string,
  number,
  number[],
  string,
];
/** time [s], rate over 1 s [Hz], rate over 60 s [Hz]. */
export type HistoryRow = [number, number, number];
export type Point = [number, number];

export type TargetKind = "all" | "circle" | "tree" | "agent" | "place";

export interface Argument {
  name: string;
  kind: "integer" | "number" | "text" | "choice";
  low?: number;
  high?: number;
  choices?: (string | number)[];
  unit?: string;
  default?: string | number;
  help?: string;
}

export interface Form {
  name: string;
  help: string;
  targets: TargetKind[];
  arguments: Argument[];
  /** Whether no agent of this run carries it out. */
  refused?: boolean;
}

export interface Session {
  sheet?: { consent: string; participant: string; condition: string } | null;
  /** Of the conductor's page alone. */
  participant?: string;
  condition?: string;
}

export interface Language {
  /** For the document's `lang` attribute. */
  tag: string;
  /** Translations by the English text. */
  texts: Record<string, string>;
}

export interface Workload {
  messages: number;
  rate_1s_hz: number;
  rate_60s_hz: number;
  senders: number;
  residue: number;
  above_s: number[];
}

export interface FormQuestion {
  name: string;
  text: string;
  kind: "likert" | "number" | "text" | "choice";
  low: number;
  high: number;
  low_text: string;
  high_text: string;
  choices: string[];
  required: boolean;
}

export type Probe =
  | { kind: "isa"; number: number; asked_s: number; left_s: number }
  /** `pairs`: the scales that are compared, in their drawn order. */
  | { kind: "tlx"; pairs?: [string, string][] }
  | { kind: "sheet" }
  /** `hides`: whether what is known must not be seen meanwhile; `left_s`: time left to answer, null: any; `prompt`: whether a question comes once the person is ready. */
  | { kind: "form"; number: number; hides: boolean; left_s: number | null; prompt?: boolean; form: { name: string; title: string; text: string; question: FormQuestion[] } };

export interface Truth {
  agents: [number, number, number, string, number, number, number][];
  events: [number, number, number, number][];
}

/** What the participant did or answered. */
export interface Act {
  time_s: number;
  kind: string;
  by?: string;
  name?: string;
  target?: string;
  value?: number | string;
  items?: string;
  event?: number;
  text?: string;
}

export type Target =
  | { kind: "all" }
  | { kind: "circle"; x_m: number; y_m: number; radius_m: number }
  | { kind: "place"; x_m: number; y_m: number }
  | { kind: "tree"; root: number }
  | { kind: "agent"; agent: number };

export interface Selection {
  kind: "agent" | "event";
  id: number;
  /** Whether the page chose it, not the person. */
  byItself?: boolean;
}

/** A command form that waits for a place, a tree or an agent on the map. */
export interface Pick {
  kind: TargetKind;
  target(): Partial<{ x_m: number; y_m: number; radius_m: number; root: number; agent: number }>;
  place(x_m: number, y_m: number): void;
  radius(radius_m: number): void;
  agent(id: number): void;
  event(id: number): void;
}

/** What panels share. */
export interface App {
  model: import("./model.js").Model;
  selection: Selection | null;
  pick: Pick | null;
  /** The part of the map on which the buttons of a judgement lie [px]. */
  covered: { left: number; right: number; top: number; bottom: number } | null;
  /** Send what a person means; it is kept and sent again until it is noted. */
  send(intent: Intent): void;
  /** The oldest input that is not noted yet and fits. */
  waiting(fits: (intent: Intent) => boolean): { page_s: number; intent: Intent } | null;
  /** Whether an input that was made then should have been noted by now. */
  isLate(page_s: number): boolean;
  say(text: string): void;
  select(selection: Selection | null, reveal?: boolean, forOrder?: boolean): void;
  redraw(): void;
}

declare global {
  /** The part of uPlot 1.6 that is used here. */
  class uPlot {
    constructor(options: object, data: (number | null)[][], target: HTMLElement);
    setData(data: (number | null)[][]): void;
    setSize(size: { width: number; height: number }): void;
    destroy(): void;
    valToPos(value: number, scale: string, canvas?: boolean): number;
    ctx: CanvasRenderingContext2D;
    bbox: { left: number; top: number; width: number; height: number };
    root: HTMLElement;
  }
}
