// SPDX-License-Identifier: Apache-2.0
// The scale of a picture: where it ends, and how that is shown.

import { roundUp } from "./colours.js";

const LATE = 0.5; // part of a scale up to which a text after it has room
const HELD = 3000; // ms for which a scale does not shrink

const tidy = (x) => String(Number(x.toPrecision(3))).replace("-", "−");

export function largest(values) {
  let most = 0;
  for (const x of values || []) if (x > most) most = x;
  return most;
}

export class Scales {
  constructor() {
    this.peaks = {}; // name -> [[when, largest]]
  }

  /** A scale's end that follows the largest value at once, and shrinks after a while. */
  hold(name, most, least, now) {
    const kept = (this.peaks[name] ??= []);
    while (kept.length && kept.at(-1)[1] <= most) kept.pop();
    kept.push([now, most]);
    while (kept[0][0] < now - HELD) kept.shift();
    return roundUp(Math.max(least, kept[0][1]));
  }
}

/** @param limit on one cell that stops the robot, in the scale's unit, or null. */
export function showScale(legend, table, low, high, unit, limit) {
  const key = [low, high, unit, limit, table.slice(510, 514)].join();
  if (legend.dataset.key === key) return;
  legend.dataset.key = key;
  const bar = document.createElement("canvas");
  [bar.width, bar.height] = [256, 1];
  bar.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(table), 256, 1), 0, 0);
  const ends = document.createElement("div");
  for (const text of [tidy(low), `${tidy((low + high) / 2)} ${unit}`, tidy(high)]) {
    const end = document.createElement("span");
    end.textContent = text;
    ends.append(end);
  }
  legend.replaceChildren(bar, ends);
  if (limit === null) return;
  const mark = document.createElement("p");
  const inside = limit <= high;
  const late = limit > LATE * high; // its text is in front of it
  mark.className = late ? "limit late" : "limit";
  mark.style[late ? "marginRight" : "marginLeft"] = `${100 * (late ? Math.max(0, 1 - limit / high) : limit / high)}%`;
  mark.textContent = inside ? `stop at ${tidy(limit)}` : `stop at ${tidy(limit)} ${unit} →`;
  legend.append(mark);
}
