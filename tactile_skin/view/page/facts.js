// SPDX-License-Identifier: Apache-2.0
// What stands beside the pictures: stop, contacts, numbers, reports.

import { compass, spelt } from "./push.js";
import { MORE, fixed } from "./words.js";

const $ = (id) => document.getElementById(id);

/** Give an element a text, if it has another. */
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export const share = (sorted, p) => sorted[Math.min(sorted.length - 1, Math.floor(p * sorted.length))];

/**
 * The banner: the stop in one line, and all of its reason under it.
 * @param stop whether the robot is stopped; null: nobody says.
 */
export function showStop(stop, line, reason) {
  const banner = $("stop");
  const state = stop === null ? "unknown" : stop ? "stopped" : "free";
  if (banner.className !== state) banner.className = state;
  const mark = { unknown: "? ", stopped: "■ ", free: "✓ " }[state];
  say(banner.querySelector("strong"), mark + line);
  $("details").hidden = !reason;
  $("why").hidden = !reason || $("details").getAttribute("aria-expanded") !== "true";
  say($("why"), reason);
}

/** The line about old data; empty: they are not. */
export function showOld(text) {
  document.body.classList.toggle("old", text !== "");
  $("old").hidden = text === "";
  say($("old"), text);
}

export function showContacts(contacts) {
  const body = document.querySelector("#contacts tbody");
  while (body.rows.length > contacts.length) body.deleteRow(-1);
  while (body.rows.length < contacts.length) {
    const row = body.insertRow();
    for (let k = 0; k < 5; k++) row.insertCell();
  }
  contacts.forEach((c, k) => {
    const texts = [
      `${c.id}`,
      fixed(c.force, 1, " N"),
      `${c.row.toFixed(1)}, ${c.col.toFixed(1)}`,
      fixed(100 * c.speed, 1, " cm/s"),
      c.gesture,
    ];
    texts.forEach((text, n) => say(body.rows[k].cells[n], text));
  });
}

export function showPush(push, colours) {
  const box = $("push");
  const key = [push?.direction, colours.faint].join();
  if (box.dataset.key !== key) compass(box.querySelector("canvas"), push, colours);
  box.dataset.key = key;
  say(box.querySelector("p"), spelt(push));
}

/**
 * @param meter to show the force in.
 * @param force of all contacts [N].
 * @param limit of it that stops the robot; null: nobody says.
 * @param counts what the stop takes the force for [N]: more, while r_par is not known.
 */
export function showTotal(meter, force, limit, counts) {
  const more = limit && counts > MORE * force ? ` (may be ${fixed(counts, 0, "")})` : "";
  const of = `${more}${limit ? ` of ${limit} N` : ""}`;
  const shown = more ? counts : force;
  say(meter.querySelector("strong"), `${fixed(force, 1, " N")}${of}`);
  const end = limit ?? Math.max(1, force);
  meter.firstElementChild.style.width = `${Math.min(100, (100 * shown) / end)}%`;
  meter.classList.toggle("over", limit !== null && shown >= limit);
  meter.setAttribute("aria-valuenow", force.toFixed(1));
  meter.setAttribute("aria-valuemax", end);
  meter.setAttribute("aria-valuetext", `${fixed(force, 1, " N")}${of}`);
}

/** @param entries [[name, text], ...] */
export function showNumbers(entries) {
  const list = $("numbers");
  while (list.children.length < 2 * entries.length) {
    list.append(document.createElement("dt"), document.createElement("dd"));
  }
  entries.flat().forEach((text, k) => say(list.children[k], text));
}

/** @param says [[node, level, message], ...]; level 1 is a warning, above it an error. */
export function showReports(says) {
  const list = $("says");
  const wanted = says.map(([node, level, text]) => [`${node}: ${text}`, level > 1 ? "error" : ""]);
  if (!wanted.length) wanted.push(["nothing is wrong", "fine"]);
  while (list.children.length > wanted.length) list.lastChild.remove();
  while (list.children.length < wanted.length) list.append(document.createElement("li"));
  wanted.forEach(([text, kind], k) => {
    list.children[k].className = kind;
    say(list.children[k], text);
  });
}
