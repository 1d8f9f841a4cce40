// What stands beside the pictures: stop, contacts, numbers, reports.

import { compass } from "./chart.js";

const $ = (id) => document.getElementById(id);

/** Give an element a text, if it has another. */
function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export const fixed = (x, digits, unit) =>
  x === null || x === undefined || Number.isNaN(x) ? "–" : `${x.toFixed(digits)}${unit}`;

export const share = (sorted, p) => sorted[Math.min(sorted.length - 1, Math.floor(p * sorted.length))];

/**
 * The banner: the stop with its reason.
 * @param stop whether the robot is stopped; null: nobody says.
 * @param why why nobody does.
 */
export function showStop(stop, reason, recorded, why) {
  const banner = $("stop");
  const state = stop === null ? "unknown" : stop ? "stopped" : "free";
  banner.className = state;
  const title = { unknown: "STOP UNKNOWN", stopped: "■ STOPPED", free: "✓ FREE" }[state];
  say(banner.querySelector("strong"), recorded ? `recorded: ${title}` : title);
  const free = recorded ? "no stop was asked for" : "the skin asks for no stop";
  say(banner.querySelector("span"), { unknown: why, stopped: reason, free }[state]);
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
  compass(box.querySelector("canvas"), push, colours);
  const signed = (x) => (x < -0.005 ? "−" : "+") + Math.abs(x).toFixed(2);
  const text = push
    ? `${push.force.toFixed(1)} N towards x ${signed(push.direction[0])}, ` +
      `y ${signed(push.direction[1])}, z ${signed(push.direction[2])}`
    : "none";
  say(box.querySelector("p"), text);
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

/** A button that is pressed twice: the second time within 4 s, it is meant. */
export function twice(button, question, act) {
  const name = button.textContent;
  let timer = null;
  const calm = () => {
    clearTimeout(timer);
    timer = null;
    button.textContent = name;
    button.classList.remove("sure");
  };
  button.onclick = () => {
    if (timer === null) {
      button.textContent = question;
      button.classList.add("sure");
      timer = setTimeout(calm, 4000);
    } else {
      calm();
      act();
    }
  };
  button.onblur = calm;
}
