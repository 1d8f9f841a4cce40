// Force of all contacts over time, with the time that the robot was stopped.

const FONT = "system-ui, sans-serif";

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
   * @param cursor time [s] to mark, or null.
   */
  draw(points, from, to, label, cursor, colours) {
    const { context: ctx, ratio } = this;
    const [w, h] = [this.canvas.width, this.canvas.height];
    const [left, right, top, bottom] = [44, 6, 8, 18].map((x) => x * ratio);
    const most = Math.max(5, ...points.map((p) => p.force));
    const end = most <= 20 ? Math.ceil(most / 5) * 5 : Math.ceil(most / 20) * 20;
    const x = (t) => left + ((t - from) / (to - from || 1)) * (w - left - right);
    const y = (force) => h - bottom - (force / end) * (h - top - bottom);
    ctx.fillStyle = colours.panel;
    ctx.fillRect(0, 0, w, h);
    this.stops(points, x, top, h - bottom, from, colours);
    ctx.font = `${11 * ratio}px ${FONT}`;
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
  timeAt(event, from, to) {
    const box = this.canvas.getBoundingClientRect();
    const share = (event.clientX - box.left - 44) / (box.width - 50);
    return from + Math.min(1, Math.max(0, share)) * (to - from);
  }
}

/** The robot from above, x forward, and the push on it. */
export function compass(canvas, push, colours) {
  const ctx = canvas.getContext("2d");
  const middle = canvas.width / 2;
  const radius = 0.52 * middle;
  ctx.clearRect(0, 0, canvas.width, canvas.height);
  ctx.lineWidth = 3;
  ctx.strokeStyle = colours.faint;
  ctx.beginPath();
  ctx.arc(middle, middle, radius, 0, 2 * Math.PI);
  ctx.stroke();
  ctx.beginPath(); // the front
  ctx.moveTo(middle - 12, middle - radius + 6);
  ctx.lineTo(middle, middle - radius - 12);
  ctx.lineTo(middle + 12, middle - radius + 6);
  ctx.fillStyle = colours.faint;
  ctx.fill();
  if (!push) return;
  const [dx, dy] = [-push.direction[1], -push.direction[0]]; // y left, x up, on the canvas
  const flat = Math.hypot(dx, dy);
  ctx.strokeStyle = ctx.fillStyle = colours.bad;
  ctx.lineWidth = 6;
  if (flat < 0.2) {
    ctx.beginPath();
    ctx.arc(middle, middle, 8, 0, 2 * Math.PI);
    ctx.fill();
    return;
  }
  const tip = [middle - 0.25 * radius * dx, middle - 0.25 * radius * dy];
  const tail = [middle - 1.6 * radius * dx, middle - 1.6 * radius * dy];
  const angle = Math.atan2(dy, dx);
  ctx.beginPath();
  ctx.moveTo(...tail);
  ctx.lineTo(...tip);
  for (const side of [-0.5, 0.5]) {
    ctx.moveTo(...tip);
    ctx.lineTo(tip[0] - 24 * Math.cos(angle + side), tip[1] - 24 * Math.sin(angle + side));
  }
  ctx.stroke();
}
