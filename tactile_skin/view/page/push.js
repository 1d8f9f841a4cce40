// SPDX-License-Identifier: Apache-2.0
// The robot from above, x forward, and the push on it.

import { from } from "./words.js";

const FLAT = 0.2; // part of a unit vector below which the push has no direction from above

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
  ctx.strokeStyle = ctx.fillStyle = colours.bad;
  ctx.lineWidth = 6;
  if (Math.hypot(dx, dy) < FLAT) {
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

/** A push in words and numbers. */
export function spelt(push) {
  if (!push) return "no push";
  const signed = (x) => (x < -0.005 ? "−" : "+") + Math.abs(x).toFixed(2);
  const [x, y, z] = push.direction.map(signed);
  return `${push.force.toFixed(1)} N ${from(push.direction)} (along x\u00a0${x}, y\u00a0${y}, z\u00a0${z})`;
}
