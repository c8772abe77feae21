/** The workload: message rates, number of senders, and time above the thresholds. */

import { element, setText } from "./dom.js";
import { later, plural, t } from "./language.js";
import { inks } from "./looks.js";
import { clock, number } from "./words.js";

/** @typedef {import("./types.js").App} App */

const FONT = "11px system-ui, sans-serif";
const SHORT = "#0072b2";
const SHORT_DARK = "#56b4e9";

/** Possible intervals between the times below the chart [s]. */
const TIMES_S = [1, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200];

/**
 * Return the width of an axis whose numbers are all to be read [px].
 * @param {uPlot} plot
 * @param {string[] | null} values
 */
function widest({ ctx }, values) {
  ctx.font = FONT;
  return 18 + Math.max(16, ...(values ?? []).map((value) => ctx.measureText(value).width));
}

export class WorkloadPanel {
  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.where = element("workload-chart");
    /** @type {uPlot | null} */
    this.plot = null;
    this.shown_s = -1;
    this.rows = 0;
    new ResizeObserver(() => this.plot?.setSize(this.size())).observe(this.where);
  }

  size() {
    return { width: Math.max(this.where.clientWidth, 100), height: Math.max(this.where.clientHeight, 50) };
  }

  /** Draw the chart again, for another run or other colours. */
  start() {
    this.plot?.destroy();
    const { soft, faint, ink } = inks();
    const short = ink === "#1b2028" ? SHORT : SHORT_DARK;
    const axis = {
      stroke: soft,
      font: FONT,
      grid: { stroke: faint, width: 1 },
      ticks: { stroke: faint },
    };
    const thresholds = this.app.model.hello?.thresholds_hz ?? [];
    const options = {
      ...this.size(),
      legend: { show: false },
      cursor: { show: false },
      padding: [8, 18, 0, 0],
      scales: {
        x: { time: false },
        y: {
          range: (/** @type {uPlot} */ _plot, /** @type {number} */ _low, /** @type {number | null} */ high) => [
            0,
            Math.max(high ?? 0, ...thresholds, 1) * 1.1,
          ],
        },
      },
      axes: [
        {
          ...axis,
          size: 26,
          space: 60,
          incrs: TIMES_S,
          values: (/** @type {uPlot} */ _plot, /** @type {number[]} */ times) => times.map(clock),
        },
        { ...axis, space: 18, size: (/** @type {uPlot} */ plot, /** @type {string[] | null} */ values) => widest(plot, values) },
      ],
      series: [
        {},
        { stroke: short, width: 1.2, points: { show: false } },
        { stroke: ink, width: 2.5, points: { show: false } },
      ],
      hooks: { draw: [(/** @type {uPlot} */ plot) => this.drawThresholds(plot, thresholds)] },
    };
    this.plot = new uPlot(options, this.columns(), this.where);
    this.shown_s = -1;
    element("rate-short").style.setProperty("--line", short);
    element("rate-long").style.setProperty("--line", ink);
  }

  /**
   * @param {uPlot} plot
   * @param {number[]} thresholds
   */
  drawThresholds(plot, thresholds) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.strokeStyle = inks().ink;
    ctx.lineWidth = window.devicePixelRatio || 1;
    ctx.setLineDash([6, 4]);
    for (const threshold of thresholds) {
      const y = plot.valToPos(threshold, "y", true);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    ctx.restore();
  }

  columns() {
    const { history } = this.app.model;
    return [history.map((row) => row[0]), history.map((row) => row[1]), history.map((row) => row[2])];
  }

  update() {
    const { picture, hello, history, now_s } = this.app.model;
    if (!picture?.workload) return;
    const { rate_1s_hz, rate_60s_hz, senders, messages, residue, above_s } = picture.workload;
    setText(element("rate-short"), number(rate_1s_hz));
    setText(element("rate-long"), number(rate_60s_hz));
    setText(element("senders"), String(senders));
    setText(element("messages"), String(messages));
    setText(element("unread"), String(picture.unread));
    setText(element("residue"), number(residue, 2));
    setText(element("events-open"), String(picture.events.length));
    const { events: closed, after_s } = picture.closed ?? { events: 0, after_s: 0 };
    setText(element("events-closed"), String(closed));
    setText(element("closed-after"), closed ? t("closed after {seconds} s each", { seconds: number(after_s, 0) }) : "");
    const thresholds = hello?.thresholds_hz ?? [];
    const above = thresholds.map((limit, at) => t("above {rate} for {time}", { rate: number(limit, 2), time: clock(above_s[at] ?? 0) }));
    setText(element("above"), above.join(" · "));
    const isOver = thresholds.some((limit) => rate_60s_hz > limit);
    element("rate-long").classList.toggle("over", isOver);
    element("rate-long").dataset["over"] = t("high");
    if (this.plot && (this.shown_s !== now_s || this.rows !== history.length)) {
      [this.shown_s, this.rows] = [now_s, history.length];
      this.plot.setData(this.columns());
      const until_s = history.at(-1)?.[0] ?? 0;
      const told = { time: clock(until_s), short: number(rate_1s_hz), long: number(rate_60s_hz) };
      const from = plural(senders, later("{count} sender"), later("{count} senders"));
      const words = t("Messages per second until {time}: {short} in the last second, {long} over a minute, from {senders}.", { ...told, senders: from });
      this.where.setAttribute("aria-label", words);
    }
  }
}
