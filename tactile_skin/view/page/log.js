// SPDX-License-Identifier: Apache-2.0
// The log: stops and findings; a click shows the moment of one.

import { clock, happened, lasted } from "./words.js";

const list = (rows, cols) => {
  const of = (name, lines) => (lines.length ? `${name} ${lines.join(", ")}` : "");
  return [of("row", rows), of("column", cols)].filter(Boolean).join(", ");
};

function place(entry) {
  if (entry.kind === "finding") return list(entry.rows, entry.cols);
  return entry.push ? list([Math.round(entry.push.row)], [Math.round(entry.push.col)]) : "";
}

export class Log {
  /** @param show called with the entry that is chosen. */
  constructor(table, show) {
    this.body = table.tBodies[0];
    this.show = show;
    this.entries = [];
    this.rows = new Map(); // entry's key -> its row
  }

  /** The stop that lasts, or undefined. */
  get stop() {
    return this.entries.find((entry) => entry.kind === "stop" && entry.end === null);
  }

  take(entries, recorded) {
    this.entries = entries;
    const rows = new Map();
    for (const entry of entries) {
      const key = [entry.kind, entry.begin, entry.skin, ...entry.causes, ...entry.rows, ...entry.cols].join();
      const row = this.rows.get(key) ?? this.row();
      rows.set(key, row);
      row.cells[0].textContent = clock(entry.begin, recorded);
      const button = row.cells[2].firstChild;
      const text = happened(entry);
      button.textContent = !entry.skin || text.startsWith(`${entry.skin}/`) ? text : `${entry.skin}: ${text}`;
      button.title = button.textContent;
      button.onclick = () => this.show(entry);
      row.className = entry.kind;
      row.cells[3].textContent = place(entry);
    }
    this.rows = rows;
    this.body.replaceChildren(...rows.values());
    if (!rows.size) {
      const row = document.createElement("tr");
      row.insertCell().textContent = "nothing so far";
      row.cells[0].colSpan = 4;
      this.body.append(row);
    }
    this.tick(0);
  }

  /** What lasts becomes longer. */
  tick(now) {
    const rows = [...this.rows.values()];
    this.entries.forEach((entry, k) => {
      const text = lasted((entry.end ?? now) - entry.begin);
      const cell = rows[k].cells[1];
      if (cell.textContent !== text) cell.textContent = text;
    });
  }

  row() {
    const row = document.createElement("tr");
    for (let k = 0; k < 4; k++) row.insertCell();
    const button = document.createElement("button");
    button.type = "button";
    row.cells[2].append(button);
    return row;
  }
}
