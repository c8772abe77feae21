/** Messages between feed and page. Written by docs/extensions/page_messages.py; do not change it by hand. */

import type {
  Act,
  AgentRow,
  CommandRow,
  EventRow,
  Form,
  HistoryRow,
  InboxRow,
  Language,
  Point,
  Probe,
  Session,
  Target,
  Truth,
  Workload,
} from "./types.js";

/** the run, the arena, the base, the thresholds, the forms of the orders, the questions, the translations */
export type Hello = {
  type: "hello";
  kind: "live" | "replay" | "researcher" | "conductor" | "watch";
  run: string;
  title: string;
  step_s: number;
  duration_s: number;
  arena_m: Point;
  obstacles: Point[][];
  base_m: Point | null;
  range_m: number | null;
  radius_m: number;
  agents: number;
  thresholds_hz: number[];
  inbox?: { policy: string; order: string; held: string };
  event_numbers: [number, number][];
  commands: Form[];
  goal: string;
  sets_delta?: "operator" | "swarm" | "system" | "budget";
  speeds: number[];
  layers?: string[];
  panels?: string[];
  place: number[];
  asks: boolean;
  end_text: string;
  worth?: Record<string, string>;
  language: Language | null;
  session: Session | null
};

/** at most ten times per second: agents, events, the number of events that are no longer reported and how long they were reported, new inbox items, workload, status of the orders, pace, the open question */
export type Picture = {
  type: "picture";
  step: number;
  time_s: number;
  over: boolean;
  agents: AgentRow[];
  events: EventRow[];
  inbox: InboxRow[];
  counts: [number, number][];
  judged: [number, string][];
  held?: [number, number, number | null];
  unread: number;
  closed?: { events: number; after_s: number };
  workload: Workload;
  commands: CommandRow[];
  pace: { paused: boolean; speed: number };
  probe: Probe | null;
  proposal: { delta: number; left_s: number } | null;
  help: "asked" | "seen" | "over";
  next?: { what: string; at_s: number } | null;
  replay?: { from_s: number; to_s: number; speed: number; paused: boolean };
  truth?: Truth | null;
  status?: Record<string, unknown>
};

/** the inbox and the history of rates, for a newly loaded page; to the conductor, the participant's acts */
export type CatchUp = {
  type: "catch_up";
  inbox: InboxRow[];
  counts: [number, number][];
  read: number[];
  history: HistoryRow[];
  acts?: Act[]
};

export type Message =
  | Hello
  | Picture
  | CatchUp
  | { type: "held"; inbox: InboxRow[] }
  | { type: "accepted"; id: string; number: number }
  | { type: "beat"; number?: number }
  | { type: "noted"; id: string }
  | { type: "refused"; id: string | null; why: string; again?: boolean }
  | { type: "read"; items: number[] }
  | { type: "act"; act: Act }
  | { type: "acts"; acts: Act[]; is_first: boolean }
  | { type: "truth"; time_s: number; agents: Truth["agents"]; events: Truth["events"] }
  | { type: "role"; role: "watch" }
  | { type: "ended" }
  | { type: "moved"; address: string };

export type Intent =
  | { type: "command"; name: string; target: Target; arguments?: Record<string, unknown> | null }
  | { type: "veto"; delta?: number | null }
  | { type: "judge"; event: number; answer: string }
  | { type: "pace"; speed?: number | null; steps?: number | null; paused?: boolean | null }
  | { type: "read"; items?: number[] | null; all?: boolean | null; up_to?: number | null }
  | { type: "held" }
  | { type: "isa"; number: number; answer: number; shown_s?: number | null }
  | { type: "tlx"; scales: Record<string, number>; weights?: Record<string, number> | null; shown_s?: number | null }
  | { type: "form"; form: string; number?: number | null; answers: Record<string, unknown>; shown_s?: number | null }
  | { type: "ready"; form: string; number: number; shown_s?: number | null }
  | { type: "note"; text: string }
  | { type: "help"; state: string }
  | { type: "end" }
  | { type: "page"; event: string; text?: string | null }
  | { type: "beat"; number?: number | null; rtt_s?: number | null; done?: boolean | null }
  | { type: "sheet"; consent: boolean; participant?: string | null; condition?: string | null }
  | { type: "catch_up" }
  | { type: "seek"; time_s: number };

/** What every input of a person has besides. */
export type Input = { id?: string | null; page_s?: number | null; sent_s?: number | null };
