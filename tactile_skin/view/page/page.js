// The page: takes snapshots, draws them, asks for the next.

import { Chart } from "./chart.js";
import { Connection } from "./connection.js";
import { rising, roundUp, signed } from "./colours.js";
import * as facts from "./facts.js";
import { Mat, pageColours } from "./mat.js";

const HISTORY = 10; // s of force that the chart shows
const OLD = 1; // s from which on data are old
const HELD = 3000; // ms for which a scale does not shrink
const TEXTS = 100; // ms between two changes of the texts
const CHART = 30; // ms between two draws of the chart
const PICTURES = ["reading", "b", "a", "std", "misfit"];
const $ = (id) => document.getElementById(id);

const colours = pageColours();
let hello = null;
let mats = {};
let legends = {};
const chart = new Chart(document.querySelector("#force canvas"));

let latest = null; // the last snapshot: {head, arrays, at: when it came [ms]}
let shown = null; // the one in the pictures
let last = null; // the one before, while it is drawn
let drawn = 0; // number of the latest that was drawn
let newsAt = 0; // when the last new one came [ms]
let frozen = false; // pictures are held, or the recording stands
let lostWhy = "";
let chosen = null; // {row, col}
let history = []; // [{t, force, stop}]
let latencies = []; // [[when, s]]
let draws = []; // ms, of the last second
let wanted = { a: "published", b: "naive" };
let time = 0; // s, in a recording
let wholeTime = []; // of a recording: [{t, force, stop}]
const peaks = {}; // name -> [[when, largest]]

// --- set up ---

function fill(select, options, value) {
  select.replaceChildren(...options.map(([key, text]) => new Option(text, key)));
  select.value = value;
}

function setUp(said) {
  hello = said;
  for (const name of PICTURES) {
    const figure = $(name);
    const canvas = figure.querySelector("canvas");
    mats[name] = new Mat(canvas, hello.rows, hello.cols, hello.populated);
    legends[name] = figure.querySelector(".legend");
    canvas.onpointermove = canvas.onpointerdown = (event) => choose(mats[name].under(event));
    canvas.onpointerleave = () => choose(null);
  }
  const methods = hello.methods.map((name) => [name, name]);
  for (const side of ["a", "b"]) {
    const select = document.querySelector(`#${side} select`);
    fill(select, [["published", ""], ...methods], wanted[side]);
    for (const option of select.options) option.text = `${side.toUpperCase()}: ${option.text}`;
    select.onchange = () => {
      wanted[side] = select.value;
      delete peaks.force;
      delete peaks.std;
      touchedAt = performance.now();
    };
  }
  const ends = [0.5, 1, 2, 5, 10].filter((end) => end <= hello.max_force * 1.1);
  fill($("scale"), [["", "automatic"], ...ends.map((end) => [end, `0 to ${end} N`])], $("scale").value);
  fill($("speed"), [0.1, 0.25, 0.5, 1, 2, 5].map((x) => [x, `${x} ×`]), "1");
  const recorded = hello.recording;
  $("source").textContent = hello.title;
  $("play").hidden = $("at").hidden = !recorded;
  $("buttons").hidden = Boolean(recorded);
  for (const name of ["tare", "reset"]) {
    $(name).disabled = !hello.controls;
  }
  if (!hello.controls && !recorded) $("said").textContent = "off: launch with view_controls:=true";
  resize();
  if (recorded) {
    $("at").max = recorded.duration;
    wholeTime = recorded.times.map((t, k) => ({ t, force: recorded.force[k], stop: recorded.stop[k] }));
  }
}

$("scale").onchange = () => choose(chosen);
facts.twice($("tare"), "hands off? then again", () => connection.ask("tare"));
facts.twice($("reset"), "reset? then again", () => connection.ask("reset"));
$("at").oninput = () => seek(Number($("at").value));
$("pause").onclick = () => freeze(!frozen);
chart.canvas.onclick = (event) => {
  if (hello?.recording) seek(chart.timeAt(event, 0, hello.recording.duration));
};

function freeze(whether) {
  frozen = whether;
  const play = hello?.recording ? "play" : "go on";
  $("pause").textContent = frozen ? play : "pause";
  $("pause").setAttribute("aria-pressed", frozen);
}

function seek(t) {
  time = Math.min(hello.recording.duration, Math.max(0, t));
  $("at").value = time;
}

function choose(cell) {
  chosen = cell;
  touchedAt = performance.now();
}

document.onkeydown = (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || !hello) return;
  const at = event.target.tagName;
  if (event.key === " " && at !== "BUTTON" && at !== "SUMMARY" && at !== "SELECT") {
    freeze(!frozen);
  } else if (event.key === "b" && at !== "SELECT") {
    const select = document.querySelector("#b select");
    select.selectedIndex = (select.selectedIndex + 1) % select.options.length;
    select.onchange();
  } else if ((event.key === "," || event.key === ".") && hello.recording) {
    freeze(true);
    seek(time + (event.key === "," ? -1 : 1) * hello.recording.interval);
  } else if (event.key.startsWith("Arrow") && event.target === $("mats")) {
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
  for (const [name, mat] of Object.entries(mats)) {
    mat.resize();
    legends[name].style.width = `${(mat.cell * mat.cols) / mat.ratio}px`;
  }
  chart.resize();
  last = null;
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
    if (head.number !== latest?.head.number) newsAt = now;
    latest = { head, arrays, at: now };
    lostWhy = "";
    const force = head.contacts.reduce((sum, c) => sum + c.force, 0);
    if (!hello.recording && head.stamp !== history.at(-1)?.t) {
      if (head.stamp < history.at(-1)?.t) history = [];
      history.push({ t: head.stamp, force, stop: head.stop });
      while (history[0].t < head.stamp - HISTORY - 1) history.shift();
    }
    if (head.latency !== undefined) latencies.push([now, 1000 * head.latency]);
    while (latencies.length && latencies[0][0] < now - 5000) latencies.shift();
  },
  said({ success, message }) {
    $("said").textContent = `${success ? "" : "refused: "}${message}`;
  },
  lost(why) {
    lostWhy = why || "no connection to the skin's page server";
  },
});

// --- drawing ---

/** A scale's end that follows the largest value at once, and shrinks after a while. */
function hold(name, largest, least, now) {
  const kept = (peaks[name] ??= []);
  while (kept.length && kept.at(-1)[1] <= largest) kept.pop();
  kept.push([now, largest]);
  while (kept[0][0] < now - HELD) kept.shift();
  return roundUp(Math.max(least, kept[0][1]));
}

function largest(values) {
  let most = 0;
  for (const x of values || []) if (x > most) most = x;
  return most;
}

function showLegend(name, table, low, high, unit) {
  const legend = legends[name];
  const key = `${low} ${high} ${unit} ${colours.middle}`;
  if (legend.dataset.key === key) return;
  legend.dataset.key = key;
  const bar = document.createElement("canvas");
  [bar.width, bar.height] = [256, 1];
  bar.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(table), 256, 1), 0, 0);
  const ends = document.createElement("div");
  const tidy = (x) => String(Number(x.toPrecision(3))).replace("-", "−");
  for (const x of [low, (low + high) / 2, high]) {
    const end = document.createElement("span");
    end.textContent = tidy(x);
    ends.append(end);
  }
  const of = document.createElement("p");
  of.textContent = unit;
  legend.replaceChildren(bar, ends, of);
}

function drawPictures({ head, arrays }, now) {
  const both = Math.max(largest(arrays.a), largest(arrays.b));
  const force = Number($("scale").value) || hold("force", both, 0.5, now);
  const reading = hold("reading", largest(arrays.reading), 100, now);
  const std = hold("std", largest(arrays.std), 0.01, now);
  const misfit = hold("misfit", largest(arrays.misfit?.map(Math.abs)), 5, now);
  const both_ways = signed(colours.middle);
  const scales = {
    reading: [rising, 0, reading, "ADC steps"],
    b: [rising, 0, force, "N per cell"],
    a: [rising, 0, force, "N per cell"],
    std: [rising, 0, std, "N per cell"],
    misfit: [both_ways, -misfit, misfit, "ADC steps"],
  };
  for (const name of PICTURES) {
    const [table, low, high, unit] = scales[name];
    const mat = mats[name];
    mat.draw(arrays[name], low, high, table, colours);
    mat.mark(head.findings, colours);
    if (chosen) mat.choose(chosen, colours);
    showLegend(name, table, low, high, unit);
  }
  if (arrays.a) {
    mats.a.contacts(head.contacts);
    if (head.push) mats.a.push(head.push);
  }
}

function drawChart(now) {
  if (hello.recording) {
    const whole = hello.recording.duration;
    chart.draw(wholeTime, 0, whole, (t) => `${t.toFixed(1)} s`, time, colours);
  } else {
    const to = latest.head.stamp + (now - latest.at) / 1000;
    chart.draw(history, to - HISTORY, to, (t) => `${(t - to).toFixed(0)} s`.replace("-", "−"), null, colours);
  }
}

/** The skin's method may change while it runs. */
function showMethod(method) {
  const text = `as ${hello.recording ? "recorded" : "published"}: ${method}`;
  for (const side of ["a", "b"]) {
    const option = document.querySelector(`#${side} option`);
    const label = `${side.toUpperCase()}: ${text}`;
    if (option.text !== label) option.text = label;
  }
}

function cellText({ arrays, head }) {
  if (!chosen) return "point at a cell, or choose one with the arrow keys";
  const k = chosen.row * hello.cols + chosen.col;
  const of = (name, digits, unit) => facts.fixed(arrays[name]?.[k], digits, unit);
  const [a, b] = [wanted.a, wanted.b].map((m) => (m === "published" ? (hello.recording ? "recorded" : "published") : m));
  const missing = hello.populated[k] ? "" : ", no cell";
  return (
    `row ${chosen.row}, column ${chosen.col}${missing}: reading ${of("reading", 1, " steps")}, ` +
    `B (${b}) ${of("b", 2, " N")}, A (${a}) ${of("a", 2, "")} ± ${of("std", 2, " N")}, ` +
    `misfit ${of("misfit", 1, " steps")}`
  ).replaceAll("-", "−");
}

function showTexts(now) {
  const { head } = latest;
  const silent = silentWhy(now);
  const why = silent || (hello.recording ? "no stop was recorded" : "no stop_on_push is heard");
  facts.showStop(silent ? null : head.stop, head.reason, Boolean(hello.recording), why);
  $("source").textContent = head.simulated ? `${hello.title}, simulated board` : hello.title;
  const picture = frozen ? shown : latest;
  showMethod(picture.head.method);
  facts.showContacts(picture.head.contacts);
  facts.showPush(picture.head.push, colours);
  facts.showReports([
    ...Object.entries(picture.head.errors).map(([side, text]) => [`picture ${side.toUpperCase()}`, 1, text]),
    ...head.says,
  ]);
  const sorted = latencies.map(([, s]) => s).sort((x, y) => x - y);
  const total = picture.head.contacts.reduce((sum, c) => sum + c.force, 0);
  const live = [
    ["drawn", fixedRate(now)],
    ["last byte to drawn, p50", facts.fixed(facts.share(sorted, 0.5), 1, " ms")],
    ["p99", facts.fixed(facts.share(sorted, 0.99), 1, " ms")],
  ];
  facts.showNumbers([
    ["force of all contacts", facts.fixed(total, 1, " N")],
    ["readings", facts.fixed(head.rate, 1, "/s")],
    ["residual", facts.fixed(head.residual, 2, " ADC steps")],
    ["noise of a reading", facts.fixed(head.noise, 2, " ADC steps")],
    ["lost on the wire", `${head.lost}`],
    ["damaged (CRC)", `${head.crc_errors}`],
    ["dropped in queues", `${head.dropped}`],
    ...(hello.recording ? [["time", facts.fixed(time, 2, " s")]] : live),
  ]);
  const cell = $("cell");
  cell.textContent = cellText(shown || latest);
  cell.classList.toggle("chosen", chosen !== null);
}

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

/** Of a recording that stands, only what is new is asked for. */
function ask() {
  const next = { ...wanted, at: time };
  const key = JSON.stringify(next);
  if (hello.recording && key === askedFor) return;
  if (connection.want({ ...next, after: latest?.head.number ?? 0, drawn })) askedFor = key;
}

let askedFor = "";
let textsAt = 0;
let count = 0; // of all draws
let [drawnAt, chartAt, touchedAt] = [0, 0, 0]; // ms
let before = performance.now();

function frame(now) {
  requestAnimationFrame(frame);
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
      drawPictures(shown, now);
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
  if (hello) ask();
}
requestAnimationFrame(frame);
