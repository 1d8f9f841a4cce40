// SPDX-License-Identifier: Apache-2.0
// Words for the stop, directions and times.

const FACES = 0.38; // part of a unit vector that a direction is named by: sine of 22.5 degrees

export const MORE = 1.02; // times a force from which on the most that it may be is shown

const FAILED = ["stale", "waiting", "fault"]; // causes of a stop that are no push

export const fixed = (x, digits, unit) =>
  x === null || x === undefined || Number.isNaN(x) ? "–" : `${x.toFixed(digits)}${unit}`;

const newtons = (x) => x.toFixed(x < 10 ? 1 : 0);

/** Where a push along a unit vector of the robot (x forward, y left, z up) comes from. */
export function from(direction) {
  const [x, y, z] = direction.map((part) => -part);
  const level = [
    x > FACES ? "front" : x < -FACES ? "back" : "",
    y > FACES ? "left" : y < -FACES ? "right" : "",
  ].filter(Boolean);
  const height = z > FACES ? "above" : z < -FACES ? "below" : "";
  if (!level.length) return height && `from ${height}`;
  return `from the ${level.join(" ")}${height && ` and ${height}`}`;
}

/** A push of an entry of the log: its force, the most that it may be, what is allowed, whence. */
export function pushed({ felt, force, limit, peak, cell_limit: cellLimit, push }) {
  const cell = limit && cellLimit && peak / cellLimit > force / limit;
  const [much, allowed] = cell ? [peak, cellLimit] : [force, limit];
  const where = push ? from(push.direction) : "";
  const more = !cell && felt && force > MORE * felt;
  const said = [
    more ? `may be ${newtons(force)}` : "",
    allowed ? `limit ${Number(allowed.toPrecision(3))}` : "",
  ].filter(Boolean).join(", ");
  return [
    `push ${newtons(more ? felt : much)} N`,
    cell ? "on one cell" : "",
    said && `(${said})`,
    where,
  ].filter(Boolean).join(" ");
}

/** An entry of the log in one line. */
export function happened(entry) {
  if (entry.kind !== "stop") return `${entry.causes.join(", ")}: ${entry.reason}`;
  return `stop: ${entry.causes.includes("push") ? pushed(entry) : entry.reason}`;
}

/**
 * The stop in one line; a fault is not hidden behind the push before it.
 * @param stop whether the robot is stopped; null: nobody says.
 * @param head of the snapshot, with the stop's reason and causes.
 * @param entry of the log for the stop that lasts, or undefined.
 * @param why why nobody says.
 */
export function state(stop, head, entry, why) {
  if (stop === null) return `unknown: ${why}`;
  if (!stop) return "free";
  const failed = head.causes.some((cause) => FAILED.includes(cause));
  return `stopped: ${entry?.causes.includes("push") && !failed ? pushed(entry) : head.reason}`;
}

export function lasted(seconds) {
  if (seconds < 10) return `${Math.max(0, seconds).toFixed(1)} s`;
  return seconds < 120 ? `${seconds.toFixed(0)} s` : `${(seconds / 60).toFixed(0)} min`;
}

/** A stamp as the time of day; times from the start of a recording as seconds. */
export const clock = (t, recorded) =>
  recorded ? `${t.toFixed(1)} s` : new Date(1000 * t).toTimeString().slice(0, 8);
