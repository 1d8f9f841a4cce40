// SPDX-License-Identifier: Apache-2.0
// Force and stop over time: each reading of the last minute, and tenths of a second before it.

const FINE = 60; // s of which each reading is kept
const STEP = 0.1; // s of a point before that
const ALL = 600; // s that are kept
const SET_BACK = 1; // s by which a stamp is before the last one where the clock was set back

export class History {
  /** @param kept of the server: {times [s], force [N], stop}. */
  constructor(kept = { times: [], force: [], stop: [] }) {
    this.points = kept.times.map((t, k) => ({ t, force: kept.force[k], stop: kept.stop[k] }));
    this.fine = []; // [{t, force, stop}], as this page saw them
  }

  push({ stamp: t, contacts, stop }) {
    const last = this.fine.at(-1)?.t ?? -Infinity;
    if (t < last - SET_BACK) [this.points, this.fine] = [[], []];
    else if (t <= last) return;
    const force = contacts.reduce((sum, contact) => sum + contact.force, 0);
    this.fine.push({ t, force, stop });
    while (this.fine[0].t < t - FINE) this.fine.shift();
    const point = this.points.at(-1);
    if (point && t < point.t + STEP) {
      point.force = Math.max(point.force, force);
      point.stop ||= stop;
    } else {
      this.points.push({ t, force, stop });
    }
    while (this.points[0].t < t - ALL) this.points.shift();
  }

  /** All that is known from a time on. */
  of(from) {
    const begin = this.fine[0]?.t ?? Infinity;
    if (from > begin) return this.fine;
    const before = this.points.filter(({ t }) => t >= from - 1 && t < begin);
    return from < begin - FINE ? this.points.filter(({ t }) => t >= from - 1) : [...before, ...this.fine];
  }
}
