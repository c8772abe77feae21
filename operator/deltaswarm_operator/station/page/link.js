/** The WebSocket. It reconnects by itself, so that the page and half-filled forms stay. */

const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 5000;
/** After a run has ended, another one may begin at the same address. */
const NEXT_RUN_WAIT_MS = 1000;

/** @typedef {import("./types.js").Message} Message */
/** @typedef {import("./types.js").Intent} Intent */

export class Link {
  /**
   * @param {(message: Message) => void} onMessage
   * @param {(isOpen: boolean) => void} onChange
   */
  constructor(onMessage, onChange) {
    this.onMessage = onMessage;
    this.onChange = onChange;
    this.hasEnded = false;
    this.wait_ms = FIRST_WAIT_MS;
    /** @type {WebSocket | null} */
    this.socket = null;
    this.connect();
  }

  connect() {
    const address = new URL("live", window.location.href);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    this.socket = socket;
    socket.onopen = () => {
      this.wait_ms = FIRST_WAIT_MS;
      this.onChange(true);
    };
    socket.onmessage = (event) => this.take(event.data);
    socket.onclose = () => {
      this.onChange(false);
      window.setTimeout(() => this.connect(), this.hasEnded ? NEXT_RUN_WAIT_MS : this.wait_ms);
      this.wait_ms = Math.min(LONGEST_WAIT_MS, this.wait_ms * 2);
    };
  }

  /** @param {unknown} data */
  take(data) {
    const message = /** @type {Message} */ (JSON.parse(String(data)));
    if (message.type === "ended") this.hasEnded = true;
    if (message.type === "picture") this.hasEnded = false;
    this.onMessage(message);
  }

  /**
   * Send an intent; return whether that was possible. Nothing is kept for later: a late order is another order.
   * @param {Intent} intent
   */
  send(intent) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(intent));
    return true;
  }
}
