/** The WebSocket. It reconnects by itself, so that the page and half-filled forms stay. */

const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 5000;
/** After a run has ended, another one may begin at the same address. */
const NEXT_RUN_WAIT_MS = 1000;
/** A connection over which nothing comes for longer is dead, though nobody has closed it. */
const DEAD_MS = 5000;
/** The same where it may be that there is nothing to say. */
const UNSTEADY_DEAD_MS = 15000;
/** The same while it opens, which takes several round trips; longer after each attempt. */
const OPENING_MS = 8000;
const LONGEST_OPENING_MS = 60000;
const RTT = "deltaswarm-rtt";
const LOOK_EVERY_MS = 500;
/** The participant's page says once a second that it is there. */
const BEAT_EVERY_MS = 990;

/** @typedef {import("./types.js").Message} Message */
/** @typedef {import("./types.js").Intent & import("./messages.js").Input} Intent */

export class Link {
  /**
   * @param {(message: Message) => void} onMessage
   * @param {(isOpen: boolean) => void} onChange
   */
  constructor(onMessage, onChange) {
    this.onMessage = onMessage;
    this.onChange = onChange;
    /** Whether the run has ended of which the newest hello told. */
    this.hasEnded = false;
    /** Whether messages come all the time, once there is a connection. */
    this.isSteady = false;
    /** Whether beats are sent, and answered: then only an answer shows that both ways of the connection work. */
    this.isBeating = false;
    this.beatAt_ms = -Infinity;
    this.opening_ms = OPENING_MS;
    this.wait_ms = FIRST_WAIT_MS;
    /** How long the answer to a beat takes [s]; it is likely to be the same over the next connection. */
    this.rtt_s = Number(sessionStorage.getItem(RTT) ?? 0);
    /** What a beat says besides. */
    this.beatWith = () => ({ done: false });
    this.beats = 0;
    /** @type {Map<number, number>} when the newest beats were sent, by their number [ms] */
    this.sent_ms = new Map();
    this.heardAt_ms = performance.now();
    /** @type {WebSocket | null} */
    this.socket = null;
    this.connect();
    window.setInterval(() => this.look(), LOOK_EVERY_MS);
  }

  connect() {
    const address = new URL("live", window.location.href);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    this.socket = socket;
    this.heardAt_ms = performance.now();
    this.sent_ms.clear();
    const began_ms = this.heardAt_ms;
    socket.onopen = () => {
      this.wait_ms = FIRST_WAIT_MS;
      this.heardAt_ms = performance.now();
      this.rtt_s = Math.max(this.rtt_s, (this.heardAt_ms - began_ms) / 2000); // opening takes about two round trips
      this.onChange(true);
    };
    socket.onmessage = (event) => this.take(event.data);
    socket.onclose = () => this.lose(socket);
  }

  /**
   * Connect anew after a while.
   * @param {WebSocket} socket
   */
  lose(socket) {
    socket.onopen = socket.onmessage = socket.onclose = null;
    this.socket = null;
    this.onChange(false);
    window.setTimeout(() => this.connect(), this.hasEnded ? NEXT_RUN_WAIT_MS : this.wait_ms);
    this.wait_ms = Math.min(LONGEST_WAIT_MS, this.wait_ms * 2);
  }

  /** Give up a connection that is dead: one that is asked to close would wait for an answer. */
  look() {
    const { socket } = this;
    this.beat();
    const isOpening = socket?.readyState === WebSocket.CONNECTING;
    const patience_ms = isOpening ? this.opening_ms : (this.isSteady ? DEAD_MS : UNSTEADY_DEAD_MS) + 3000 * this.rtt_s;
    const isDead = performance.now() - this.heardAt_ms > patience_ms;
    if (!socket || !isDead || (this.hasEnded && !isOpening)) return;
    if (isOpening) this.opening_ms = Math.min(LONGEST_OPENING_MS, 2 * this.opening_ms); // the way may be long
    this.lose(socket);
    socket.close();
  }

  /** @param {unknown} data */
  take(data) {
    const message = /** @type {Message} */ (JSON.parse(String(data)));
    if (!this.isBeating || message.type === "beat") this.heardAt_ms = performance.now();
    if (message.type === "beat") this.time(message.number);
    if (message.type === "ended") this.hasEnded = true;
    if (message.type === "hello") this.hasEnded = false; // the next run has no picture yet
    this.onMessage(message);
    this.beat(); // also here, since a page in the background has few timers
  }

  /** Say that this page is there, if that is due. */
  beat() {
    const now_ms = performance.now();
    if (!this.isBeating || now_ms - this.beatAt_ms < BEAT_EVERY_MS) return;
    this.beatAt_ms = now_ms;
    this.beats += 1;
    this.sent_ms.set(this.beats, now_ms);
    this.send({ type: "beat", number: this.beats, rtt_s: this.rtt_s, ...this.beatWith() });
  }

  /**
   * Measure the round trip by the answer to a beat: at once if it is longer, else by and by.
   * @param {number | undefined} number of the beat
   */
  time(number) {
    const sent_ms = this.sent_ms.get(number ?? 0);
    for (const sent of this.sent_ms.keys()) if (sent <= (number ?? 0)) this.sent_ms.delete(sent);
    if (sent_ms === undefined) return;
    const now_s = (performance.now() - sent_ms) / 1000;
    this.rtt_s = Math.round(1000 * Math.max(now_s, 0.8 * this.rtt_s + 0.2 * now_s)) / 1000;
    sessionStorage.setItem(RTT, String(this.rtt_s));
  }

  /**
   * Send a message; return whether that was possible.
   * @param {Intent} message
   */
  send(message) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}
