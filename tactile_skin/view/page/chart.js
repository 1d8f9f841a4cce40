// SPDX-License-Identifier: Apache-2.0
// Force of all contacts over time, with the time that the robot was stopped.

const FONT = "system-ui, sans-serif";

export const RANGES = [[10, "10 s"], [60, "1 min"], [180, "3 min"], [600, "10 min"]]; // s

/** Times of a running skin -> what they are called, at to [s]. */
export const ago = (to) => (t) => (t >= to - 0.05 ? "now" : `−${(to - t).toFixed(0)} s`);

export class Chart {
  constructor(canvas) {
    this.canvas = canvas;
    this.resize();
  }

  resize() {
    this.ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(this.canvas.clientWidth * this.ratio);
    this.canvas.height = Math.round(this.canvas.clientHeight * this.ratio);
    this.context = this.canvas.getContext("2d", { alpha: false });
  }

  /**
   * @param points [{t [s], force [N], stop}], by time.
   * @param from, to the time that is shown [s].
   * @param label time [s] -> text under the chart.
   * @param limit force that stops the robot [N], or null.
   * @param cursor time [s] to mark, or null.
   */
  draw(points, from, to, label, limit, cursor, colours) {
    const { context: ctx, ratio } = this;
    const [w, h] = [this.canvas.width, this.canvas.height];
    const [left, right, top, bottom] = [44, 6, 8, 18].map((x) => x * ratio);
    const most = points.reduce((m, p) => (p.t >= from ? Math.max(m, p.force) : m), Math.max(5, 1.1 * (limit ?? 0)));
    const end = most <= 20 ? Math.ceil(most / 5) * 5 : Math.ceil(most / 20) * 20;
    Object.assign(this, { from, to });
    const x = (t) => left + ((t - from) / (to - from || 1)) * (w - left - right);
    const y = (force) => h - bottom - (force / end) * (h - top - bottom);
    ctx.fillStyle = colours.panel;
    ctx.fillRect(0, 0, w, h);
    this.stops(points, x, top, h - bottom, from, colours);
    ctx.font = `${12 * ratio}px ${FONT}`;
    ctx.fillStyle = colours.faint;
    ctx.strokeStyle = colours.line;
    ctx.lineWidth = ratio;
    ctx.textAlign = "right";
    ctx.textBaseline = "middle";
    for (const force of [0, end / 2, end]) {
      ctx.fillText(`${force} N`, left - 5 * ratio, y(force));
      ctx.beginPath();
      ctx.moveTo(left, y(force));
      ctx.lineTo(w - right, y(force));
      ctx.stroke();
    }
    ctx.textBaseline = "alphabetic";
    for (const share of [0, 0.5, 1]) {
      ctx.textAlign = ["left", "center", "right"][2 * share];
      const t = from + share * (to - from);
      ctx.fillText(label(t), x(t), h - 4 * ratio);
    }
    if (limit !== null) this.limit(limit, left, w - right, y(limit), colours);
    ctx.strokeStyle = colours.force;
    ctx.lineWidth = 2 * ratio;
    ctx.lineJoin = "round";
    ctx.beginPath();
    let before = null;
    for (const point of points) {
      if (point.t < from) continue;
      // where there were no data, there is no line
      if (before === null || point.t - before > 1) ctx.moveTo(x(point.t), y(point.force));
      else ctx.lineTo(x(point.t), y(point.force));
      before = point.t;
    }
    ctx.stroke();
    if (cursor !== null) {
      ctx.strokeStyle = colours.text;
      ctx.lineWidth = ratio;
      ctx.beginPath();
      ctx.moveTo(x(cursor), top);
      ctx.lineTo(x(cursor), h - bottom);
      ctx.stroke();
    }
  }

  limit(limit, left, right, y, colours) {
    const { context: ctx, ratio } = this;
    ctx.strokeStyle = ctx.fillStyle = colours.wrong;
    ctx.setLineDash([6 * ratio, 4 * ratio]);
    ctx.beginPath();
    ctx.moveTo(left, y);
    ctx.lineTo(right, y);
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.textAlign = "left";
    ctx.textBaseline = "bottom";
    ctx.fillText(`stop at ${limit} N`, left + 4 * ratio, y - 2 * ratio);
  }

  stops(points, x, top, bottom, from, colours) {
    const ctx = this.context;
    ctx.fillStyle = colours.stopped;
    ctx.globalAlpha = 0.25;
    let since = null;
    const last = { t: points.at(-1)?.t, stop: false };
    for (const { t, stop } of [...points, last]) {
      if (stop && since === null) since = t;
      if (stop || since === null) continue;
      const begin = Math.max(x(since), x(from)); // not before what is shown
      ctx.fillRect(begin, top, Math.max(0, x(t) - begin), bottom - top);
      since = null;
    }
    ctx.globalAlpha = 1;
  }

  /** The time [s] under a pointer. */
  timeAt(event) {
    const { from, to } = this;
    const box = this.canvas.getBoundingClientRect();
    const share = (event.clientX - box.left - 44) / (box.width - 50);
    return from + Math.min(1, Math.max(0, share)) * (to - from);
  }
}
