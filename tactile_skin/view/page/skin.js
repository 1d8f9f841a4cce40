// SPDX-License-Identifier: Apache-2.0
// The page of a skin: takes snapshots, draws them, asks for the next.

import { ago, Chart, RANGES } from "./chart.js";
import { Connection } from "./connection.js";
import * as facts from "./facts.js";
import { Figures } from "./figures.js";
import { History } from "./history.js";
import { Log } from "./log.js";
import { pageColours } from "./mat.js";
import { fill, toggle, twice } from "./buttons.js";
import { Work } from "./work.js";
import { clock, fixed, state } from "./words.js";

const OLD = 1; // s from which on data are old
const TEXTS = 100; // ms between two changes of the texts
const CHART = 30; // ms between two draws of the chart
const $ = (id) => document.getElementById(id);

const colours = pageColours();
const chart = new Chart(document.querySelector("#force canvas"));
const log = new Log(document.querySelector("#log table"), (entry) => visit(entry.stamp));
let hello = null;
let figures = null;
let space = null; // the cover in space, once it was opened
let work = null;
let history = new History();

let latest = null; // the last snapshot: {head, arrays, at: when it came [ms]}
let shown = null; // the one in the pictures
let last = null; // the one before, while it is drawn
let drawn = 0; // number of the latest that was drawn
let newsAt = 0; // when the last new one came [ms]
let frozen = false; // pictures are held, or the recording stands
let moment = 0; // stamp of a moment to show [s]; 0: none is asked for
let lostWhy = "";
let chosen = null; // {row, col}
let latencies = []; // [[when, s]]
let draws = []; // ms, of the last second
let time = 0; // s, in a recording

// --- set up ---

function setUp(said) {
  hello = said;
  latest = shown = last = null; // of another connection, or another board
  if (space) {
    openSpace(false);
    space = null;
  }
  const recorded = hello.recording;
  history = new History(hello.history);
  figures = new Figures(hello, choose);
  const methods = hello.methods.map((name) => [name, name]);
  const own = recorded ? "as recorded" : "as published";
  fill($("method-a"), [["published", own], ...methods], $("method-a").value || "published");
  fill($("method-b"), methods, $("method-b").value || "naive");
  const ends = [0.5, 1, 2, 5, 10].filter((end) => end <= hello.max_force * 1.1);
  fill($("scale"), [["", "automatic"], ...ends.map((end) => [end, `0 to ${end} N`])], $("scale").value);
  fill($("speed"), [0.1, 0.25, 0.5, 1, 2, 5].map((x) => [x, `${x} ×`]), "1");
  fill($("range"), RANGES, $("range").value || "10");
  $("play").hidden = $("at").hidden = !recorded;
  $("range").hidden = $("buttons").hidden = Boolean(recorded);
  $("flat").hidden = !hello.position;
  $("all").hidden = !hello.skin;
  $("controls").classList.toggle("off", !hello.controls);
  if (hello.skin) document.title = `${hello.skin}, tactile_skin`;
  for (const name of ["tare", "reset"]) $(name).disabled = !hello.controls;
  if (!hello.controls && !recorded) $("said").textContent = "off: launch with view_controls:=true";
  if (recorded) $("at").max = recorded.duration;
  work = new Work((name, text) => connection.ask(name, text), hello.controls);
  compared();
  resize();
  const stamp = Number(sessionStorage.getItem("moment")); // that the page of all was asked for
  sessionStorage.removeItem("moment");
  if (stamp) visit(stamp);
}

function compared() {
  const method = $("method-b").value;
  document.querySelector("#b h2").textContent = method === "naive" ? "naive" : `by ${method}`;
  figures?.forget();
  revisit();
}

$("scale").onchange = $("unit").onchange = () => {
  figures.forget();
  choose(chosen);
};
$("method-a").onchange = $("method-b").onchange = compared;
$("range").onchange = () => { chartAt = 0; };
twice($("tare"), "hands off? then again", () => connection.ask("tare"));
twice($("reset"), "reset? then again", () => connection.ask("reset"));
toggle($("details"), "details", "less", () => { textsAt = 0; });
toggle($("explain"), "explain", "explain less", (open) => {
  $("explained").hidden = !open;
  resize();
  revisit();
});
$("flat").onclick = () => openSpace($("flat").getAttribute("aria-pressed") !== "true");
$("at").oninput = () => seek(Number($("at").value));
$("pause").onclick = () => freeze(!frozen);
chart.canvas.onclick = (event) => {
  if (!hello) return;
  const t = chart.timeAt(event);
  if (hello.recording) seek(t);
  else visit(t);
};

function freeze(whether) {
  frozen = whether;
  if (!frozen) moment = 0;
  const go = hello?.recording ? "play" : "back to now";
  $("pause").textContent = frozen ? go : "pause";
  $("pause").setAttribute("aria-pressed", frozen);
}

function seek(t) {
  time = Math.min(hello.recording.duration, Math.max(0, t));
  $("at").value = time;
}

/** Show the moment of a stamp [s]: of a recording, or what is kept of a running skin. */
function visit(stamp) {
  freeze(true);
  if (hello.recording) seek(stamp > hello.recording.start / 2 ? stamp - hello.recording.start : stamp);
  else moment = stamp;
}

/** What is held may have other pictures by now. */
function revisit() {
  if (frozen && shown && !hello.recording) moment = shown.head.stamp;
}

function choose(cell) {
  chosen = cell;
  touchedAt = performance.now();
}

async function openSpace(open) {
  if (open && !space) {
    const { Space } = await import("./space.js");
    space = new Space(document.querySelector("#space canvas"), [hello]);
  }
  $("flat").setAttribute("aria-pressed", open);
  $("flat").textContent = open ? "flat" : "in space";
  $("space").hidden = !open;
  document.querySelector("#a .picture").hidden = open;
  resize();
}

document.onkeydown = (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || !hello) return;
  const at = event.target.tagName;
  if (event.key === " " && !["BUTTON", "SUMMARY", "SELECT", "INPUT"].includes(at)) {
    freeze(!frozen);
  } else if (event.key === "e" && at !== "SELECT" && at !== "INPUT") {
    $("explain").click();
  } else if (event.key === "b" && at !== "SELECT" && at !== "INPUT") {
    const select = $("method-b");
    select.selectedIndex = (select.selectedIndex + 1) % select.options.length;
    compared();
  } else if (event.key === "Escape") {
    figures.enlarge(null);
  } else if ((event.key === "," || event.key === ".") && hello.recording) {
    freeze(true);
    seek(time + (event.key === "," ? -1 : 1) * hello.recording.interval);
  } else if (event.key.startsWith("Arrow") && event.target === $("a")) {
    const { row, col } = chosen || { row: hello.rows >> 1, col: hello.cols >> 1 };
    const [down, right] = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
    choose({
      row: Math.min(hello.rows - 1, Math.max(0, row + down)),
      col: Math.min(hello.cols - 1, Math.max(0, col + right)),
    });
  } else {
    return;
  }
  event.preventDefault();
};

function resize() {
  figures?.resize();
  chart.resize();
  if (space && !$("space").hidden) space.resize(...figures.mats.a.size);
  last = null;
  touchedAt = performance.now();
}
window.onresize = resize;

// --- the connection ---

const connection = new Connection({
  hello(said) {
    askedFor = "";
    setUp(said);
  },
  snapshot(head, arrays) {
    const now = performance.now();
    lostWhy = "";
    if (head.log) log.take(head.log, Boolean(hello.recording));
    if (head.work) work.take(head.work, colours);
    if (head.at && !hello.recording) { // a moment
      if (frozen) shown = { head, arrays, at: now };
      touchedAt = now;
      return;
    }
    if (head.number !== latest?.head.number) newsAt = now;
    latest = { head, arrays, at: now };
    if (!hello.recording) history.push(head);
    if (head.latency !== undefined) latencies.push([now, 1000 * head.latency]);
    while (latencies.length && latencies[0][0] < now - 5000) latencies.shift();
  },
  said({ success, message }) {
    $("said").textContent = success ? message : `refused: ${message}`;
  },
  lost(why) {
    lostWhy = why || "no connection to the skin's page server";
  },
});

// --- drawing ---

function drawPictures(now) {
  figures.follow(shown.head);
  figures.draw(shown, [...shown.head.findings, ...work.findings], chosen, colours, now);
  if (space && !$("space").hidden) showSpace();
}

function showSpace() {
  const { values, high } = figures.scale;
  space.draw([{ values, push: shown.head.push, limit: shown.head.limit }], high, colours);
}

function drawChart(now) {
  const { limit } = latest.head;
  if (hello.recording) {
    const all = hello.recording.duration;
    chart.draw(history.points, 0, all, (t) => `${t.toFixed(1)} s`, limit, time, colours);
    return;
  }
  const to = stampNow(now);
  const range = Number($("range").value);
  const cursor = frozen && shown ? shown.head.stamp : null;
  chart.draw(history.of(to - range), to - range, to, ago(to), limit, cursor, colours);
}

/** The time of the skin now [s]. */
const stampNow = (now) => latest.head.stamp + (latest.head.age ?? 0) + (now - latest.at) / 1000;

function cellText({ arrays }) {
  if (!chosen) return "point at a cell, or choose one with the arrow keys";
  const k = chosen.row * hello.cols + chosen.col;
  const of = (values, digits, unit) => fixed(values?.[k], digits, unit);
  const unit = $("unit").value === "N" ? " N" : " kPa";
  const spread = arrays.std ? ` ± ${of(figures.inUnit(arrays.std), 2, "")}` : "";
  const parts = [`pressure ${of(figures.scale?.values, 2, spread + unit)}`];
  parts.push(`reading ${of(arrays.reading, 1, " steps")}`);
  if (arrays.b) parts.push(`${$("method-b").value} ${of(figures.inUnit(arrays.b), 2, unit)}`);
  if (arrays.misfit) parts.push(`unexplained ${of(arrays.misfit, 1, " steps")}`);
  const missing = hello.populated[k] ? "" : ", no cell";
  return `row ${chosen.row}, column ${chosen.col}${missing}: ${parts.join(", ")}`.replaceAll("-", "−");
}

function showTexts(now) {
  const { head } = latest;
  const silent = silentWhy(now);
  const why = silent || (hello.recording ? "no stop was recorded" : "no stop_on_push is heard");
  const stop = silent ? null : head.stop;
  const line = state(stop, head, hello.recording ? at(log.entries) : log.stop, why);
  facts.showStop(stop, hello.recording ? `recorded: ${line}` : line, stop ? head.reason : "");
  const held = frozen && shown && !hello.recording ? ` · showing ${clock(shown.head.stamp)}` : "";
  facts.say($("source").firstElementChild, `${hello.title}${held}`);
  $("source").lastElementChild.hidden = !head.simulated;
  const picture = shown || latest;
  facts.showContacts(picture.head.contacts);
  facts.showPush(picture.head.push, colours);
  const total = picture.head.contacts.reduce((sum, c) => sum + c.force, 0);
  facts.showTotal($("total"), total, head.limit, picture.head.force);
  facts.showReports([
    ...Object.entries(picture.head.errors).map(([side, text]) => [side === "a" ? "pressure" : "comparison", 1, text]),
    ...head.says,
  ]);
  work.tick();
  log.tick(hello.recording ? hello.recording.duration : stampNow(now));
  const sorted = latencies.map(([, s]) => s).sort((x, y) => x - y);
  const live = [
    ["drawn", fixedRate(now)],
    ["last byte to drawn, p50", fixed(facts.share(sorted, 0.5), 1, " ms")],
    ["p99", fixed(facts.share(sorted, 0.99), 1, " ms")],
  ];
  facts.showNumbers([
    ["method", picture.head.method],
    ["unexplained, RMS", fixed(picture.head.unexplained, 2, " ADC steps")],
    ["noise of a reading", fixed(head.noise, 2, " ADC steps")],
    ["readings", fixed(head.rate, 1, "/s")],
    ["lost on the wire", `${head.lost}`],
    ["damaged (CRC)", `${head.crc_errors}`],
    ["dropped in queues", `${head.dropped}`],
    ...(hello.recording ? [["time", fixed(time, 2, " s")]] : live),
  ]);
  const cell = $("cell");
  facts.say(cell, cellText(picture));
  cell.classList.toggle("chosen", chosen !== null);
}

/** The stop that lasts at the time of the recording. */
const at = (entries) =>
  entries.find((e) => e.kind === "stop" && e.begin <= time + 0.001 && (e.end ?? Infinity) > time);

const fixedRate = (now) => {
  draws = draws.filter((at) => at > now - 1000);
  return `${draws.length}/s`;
};

/** Why nothing is known of the skin now; empty if it is heard, which it is ten times a second. */
function silentWhy(now) {
  if (hello.recording && !lostWhy) return "";
  const seconds = (now - newsAt) / 1000;
  return lostWhy || (seconds > OLD ? `the skin has said nothing for ${seconds.toFixed(0)} s` : "");
}

/** Why what is shown is old; empty if it is not. */
function oldWhy(now) {
  if (lostWhy) return `${lostWhy}: what is shown is old; trying again`;
  if (!latest) return "waiting for the first reading";
  if (hello.recording) return "";
  if (latest.head.age === undefined) return "no reading yet";
  const age = latest.head.age + (now - latest.at) / 1000;
  return age > OLD ? `the last reading is ${age.toFixed(0)} s old` : "";
}

/** Of a recording that stands, only what is new is asked for; of a running skin, a moment once. */
function ask() {
  const next = {
    a: $("method-a").value,
    b: $("explained").hidden ? "" : $("method-b").value,
    at: hello.recording ? time : moment,
  };
  const key = JSON.stringify(next);
  if (hello.recording && key === askedFor) return;
  if (connection.want({ ...next, after: latest?.head.number ?? 0, drawn })) {
    askedFor = key;
    moment = 0;
  }
}

let askedFor = "";
let textsAt = 0;
let count = 0; // of all draws
let [drawnAt, chartAt, touchedAt] = [0, 0, 0]; // ms
let before = performance.now();

function frame(now) {
  requestAnimationFrame(frame);
  if (hello) ask();
  const seconds = (now - before) / 1000;
  before = now;
  if (hello?.recording && !frozen) {
    const next = time + seconds * Number($("speed").value);
    seek(next);
    if (next > hello.recording.duration) freeze(true);
  }
  if (hello && latest) {
    const fresh = latest !== last;
    if (fresh && (!frozen || hello.recording || !shown)) shown = latest;
    if (latest.head.number !== drawn) {
      draws.push(now);
      document.body.dataset.draws = ++count;
    }
    if (fresh || touchedAt > drawnAt) {
      drawPictures(now);
      drawnAt = now;
    }
    if (now - chartAt > CHART || hello.recording) {
      drawChart(now);
      chartAt = now;
    }
    drawn = latest.head.number;
    last = latest;
  }
  if (now - textsAt > TEXTS) {
    textsAt = now;
    facts.showOld(oldWhy(now));
    if (hello && latest) showTexts(now);
  }
}
requestAnimationFrame(frame);
