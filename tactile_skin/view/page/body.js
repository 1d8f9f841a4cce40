// SPDX-License-Identifier: Apache-2.0
// The page of a body: all of its skins, the worst first; each has a page of its own.

import { fill, toggle, twice } from "./buttons.js";
import { ago, Chart, RANGES } from "./chart.js";
import { rising } from "./colours.js";
import { Connection } from "./connection.js";
import { showOld, showStop, showTotal } from "./facts.js";
import { History } from "./history.js";
import { Log } from "./log.js";
import { Mat, pageColours } from "./mat.js";
import { largest, Scales, showScale } from "./scale.js";
import { state } from "./words.js";

const PACE = 66; // ms between two pictures of a skin
const TEXTS = 100; // ms between two changes of the texts
const OLD = 1; // s after which data are old
const STEP = 0.1; // s of a point of the chart
const HELD = 3000; // ms for which a skin stays in front that was worse
const LEAST = 0.5; // N per cell, end of the scale at least
const SIZE = 360; // px that a picture is high at most, or
const SHARE = 0.6; // this part of the window's height
const IN_SPACE = 480; // px, the same of all covers in space
const RANKS = ["stopped", "unknown", "suspect", "free"]; // the worst first
const $ = (id) => document.getElementById(id);

const colours = pageColours();
const scales = new Scales();

/** What the server says of one skin, or of the body. */
class Heard {
  constructor(name) {
    this.name = name;
    this.hello = this.latest = null;
    this.log = [];
    this.history = new History();
    this.lost = "";
    [this.newsAt, this.askedAt] = [performance.now(), 0]; // ms
    const listener = {
      hello: (hello) => this.greet(hello),
      snapshot: (head, arrays) => this.take(head, arrays),
      said: ({ success, message }) => { $("said").textContent = success ? message : `refused: ${message}`; },
      lost: (why) => { this.lost = why || "no connection to the skin's page server"; },
    };
    this.connection = new Connection(listener, name && `?${name}`);
  }

  greet(hello) {
    this.hello = hello;
    this.history = new History(hello.history);
  }

  take(head, arrays) {
    const now = performance.now();
    this.lost = "";
    if (head.log) this.log = head.log;
    if (head.number !== this.latest?.head.number) this.newsAt = now;
    this.latest = { head, arrays, at: now };
    this.history.push(head);
  }

  /** The time of its clock now [s]. */
  time(now) {
    return this.latest.head.stamp + (this.latest.head.age ?? 0) + (now - this.latest.at) / 1000;
  }

  ask(now) {
    if (!this.hello || now - this.askedAt < PACE) return;
    const wanted = { a: "published", b: "", at: 0, after: this.latest?.head.number ?? 0, drawn: 0 };
    if (this.connection.want(wanted)) this.askedAt = now;
  }

  /** Why nothing is known of it now; empty if it is heard. */
  silent(now) {
    const seconds = (now - this.newsAt) / 1000;
    return this.lost || (seconds > OLD ? `nothing was heard for ${seconds.toFixed(0)} s` : "");
  }

  /** Whether it stops the robot; null: nobody says. */
  stop(now) {
    return this.silent(now) || !this.latest ? null : this.latest.head.stop;
  }

  /** @param entry of the log for the stop that lasts, or undefined. */
  line(now, entry) {
    const why = this.silent(now) || "nothing is heard of its stop";
    return state(this.stop(now), this.latest?.head, entry, why);
  }
}

class Card extends Heard {
  constructor(name, place) {
    super(name);
    this.place = place; // in the file
    this.ranks = []; // [[when, rank]], of the last moments
    this.item = $("skin").content.firstElementChild.cloneNode(true);
    for (const link of this.item.querySelectorAll("a")) link.href = `?${name}`;
    this.find("h2 a").textContent = name;
    this.find(".total").setAttribute("aria-label", `force on ${name}`);
  }

  find(selector) {
    return this.item.querySelector(selector);
  }

  greet(hello) {
    super.greet(hello);
    this.mat = new Mat(this.find("canvas"), hello.rows, hello.cols, hello.populated);
    this.resize();
    if (shape) openSpace(true); // another board may have another shape
  }

  resize() {
    const width = this.find(".picture").clientWidth;
    if (this.mat && width) this.mat.resize(width, Math.max(SIZE, SHARE * window.innerHeight));
    this.drawn = null;
  }

  draw(high) {
    const { head, arrays } = this.latest;
    if (!this.mat?.context || (this.drawn === this.latest && this.high === high)) return;
    this.mat.draw(arrays.a, 0, high, rising, colours);
    this.mat.mark(head.findings, colours);
    if (arrays.a) this.mat.contacts(head.contacts, new Map());
    [this.drawn, this.high] = [this.latest, high];
  }

  /** Whether what is shown of it is not what it feels now. */
  isOld(now) {
    if (this.stop(now) === null) return true;
    const { head, at } = this.latest;
    return head.age !== undefined && head.age + (now - at) / 1000 > OLD;
  }

  /** What is shown of it in space; nothing that is old. */
  inSpace(now) {
    if (this.isOld(now)) return {};
    const { head, arrays } = this.latest;
    return { values: arrays.a, push: head.push, limit: head.limit };
  }

  /** The texts; how bad it is. */
  show(now) {
    const stop = this.stop(now);
    const line = this.line(now, this.log.find((e) => e.kind === "stop" && e.end === null));
    const head = this.latest?.head;
    const says = stop === false ? head.says.map(([, , text]) => text).join("; ") : "";
    const kind = stop === null ? "unknown" : stop ? "stopped" : says ? "suspect" : "free";
    const mark = { unknown: "? ", stopped: "■ ", suspect: "! ", free: "✓ " }[kind];
    const text = mark + (says ? `${line}, but ${says}` : line);
    if (this.find(".state").textContent !== text) this.find(".state").textContent = text;
    const look = `skin ${kind}${this.isOld(now) ? " old" : ""}`;
    if (this.item.className !== look) this.item.className = look;
    this.find(".simulated").hidden = !head?.simulated;
    const force = (head?.contacts ?? []).reduce((sum, contact) => sum + contact.force, 0);
    showTotal(this.find(".total"), force, head?.limit ?? null, head?.force ?? 0);
    const rank = RANKS.indexOf(kind);
    this.ranks = this.ranks.filter(([when]) => when > now - HELD);
    if (head) this.ranks.push([now, rank]);
    if (kind === "stopped") return rank - 1; // before those that were stopped a moment ago
    return Math.min(rank, ...this.ranks.map(([, before]) => before));
  }
}

class Body extends Heard {
  greet(hello) {
    super.greet(hello);
    $("controls").hidden = !hello.controls;
    const names = cards.map((card) => card.name);
    if (names.join() === hello.skins.join()) return;
    if (names.length) location.reload(); // another robot's
    cards = hello.skins.map((name, place) => new Card(name, place));
    $("skins").replaceChildren(...cards.map((card) => card.item));
    $("source").firstElementChild.textContent = `${cards.length} skins`;
  }
}

let cards = [];
const chart = new Chart(document.querySelector("#force canvas"));
const log = new Log(document.querySelector("#log table"), (entry) => {
  if (!entry.skin) return;
  sessionStorage.setItem("moment", entry.stamp);
  location.href = `?${entry.skin}`;
});
fill($("range"), RANGES, "10");
document.querySelector("#force .help").textContent =
  "Of the skin that is pressed hardest. Red: the robot was stopped. Dashed: the force that stops it.";
let covers = []; // cards of those that are shown in space
let shape = null; // they, once that is wanted
const body = new Body("");
twice($("reset"), "reset? then again", () => body.connection.ask("reset"));
toggle($("details"), "details", "less", () => { textsAt = 0; });
window.onresize = resize;
$("flat").onclick = () => openSpace(!shape);

function resize() {
  chart.resize();
  cards.forEach((card) => card.resize());
  shape?.resize($("space").clientWidth, IN_SPACE);
}

/** The covers whose place is known. */
const placed = () => cards.filter((card) => card.hello?.position);

async function openSpace(open) {
  const { Space } = await import("./space.js");
  $("space").hidden = !open;
  $("flat").setAttribute("aria-pressed", open);
  $("flat").textContent = open ? "cards only" : "in space";
  covers = open ? placed() : [];
  shape = open ? new Space(document.querySelector("#space canvas"), covers.map(({ name, hello }) => ({ ...hello, name }))) : null;
  resize();
}

/** The worst first; of equal ones that of the file. What has the focus keeps it. */
function arrange(ranks) {
  const sorted = [...cards].sort((a, b) => ranks.get(a) - ranks.get(b) || a.place - b.place);
  const items = sorted.map((card) => card.item);
  if (items.every((item, k) => item === $("skins").children[k])) return;
  const focused = document.activeElement;
  $("skins").replaceChildren(...items);
  focused?.focus();
}

/** What happened to each skin, and stops of the body that none of them was in. */
function entries() {
  const ofSkins = cards.flatMap((card) => card.log.map((entry) => ({ ...entry, skin: card.name })));
  const stops = ofSkins.filter((entry) => entry.kind === "stop");
  const during = (one, other) => one.begin <= (other.end ?? Infinity) + STEP && other.begin <= (one.end ?? Infinity) + STEP;
  const alone = body.log.filter((entry) => entry.kind === "stop" && !stops.some((stop) => during(stop, entry)));
  return [...ofSkins, ...alone].sort((a, b) => b.begin - a.begin);
}

/** Largest force of a skin, and whether the body stopped, for each tenth of a second. */
function history(from) {
  const points = new Map();
  for (const one of [body, ...cards]) {
    for (const { t, force, stop } of one.history.of(from)) {
      const at = Math.floor(t / STEP);
      const point = points.get(at) ?? { t: at * STEP, force: 0, stop: false };
      point.force = Math.max(point.force, force);
      point.stop ||= one === body && stop;
      points.set(at, point);
    }
  }
  return [...points.values()].sort((a, b) => a.t - b.t);
}

function showEvents(now) {
  const known = entries();
  const text = JSON.stringify(known);
  if (text !== logged) log.take(known, false);
  logged = text;
  if (!body.latest) return;
  const [to, range] = [body.time(now), Number($("range").value)];
  log.tick(to);
  const limits = cards.map((card) => card.latest?.head.limit ?? Infinity);
  const limit = Math.min(...limits);
  chart.draw(history(to - range), to - range, to, ago(to), Number.isFinite(limit) ? limit : null, null, colours);
}

function showTexts(now) {
  const stop = body.stop(now);
  showStop(stop, body.line(now), stop ? body.latest.head.reason : "");
  showOld(body.lost ? `${body.lost}: what is shown is old; trying again` : "");
  $("flat").hidden = !placed().length;
  arrange(new Map(cards.map((card) => [card, card.show(now)])));
}

let textsAt = 0; // ms
let logged = ""; // what the log shows

function frame(now) {
  requestAnimationFrame(frame);
  const heard = cards.filter((card) => card.latest);
  const most = Math.max(...heard.map((card) => largest(card.latest.arrays.a)), 0);
  const high = scales.hold("a", most, LEAST, now);
  for (const card of heard) card.draw(high);
  shape?.draw(covers.map((card) => card.inSpace(now)), high, colours);
  const limits = heard.map((card) => card.latest.head.cell_limit).filter((limit) => limit !== null);
  const limit = limits.length ? Math.min(...limits) : null;
  showScale(document.querySelector(".legend"), rising, 0, high, "N per cell", limit);
  if (now - textsAt > TEXTS) {
    textsAt = now;
    showTexts(now);
    showEvents(now);
  }
  for (const one of [body, ...cards]) one.ask(now);
}
requestAnimationFrame(frame);
