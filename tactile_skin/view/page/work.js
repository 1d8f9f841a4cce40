// SPDX-License-Identifier: Apache-2.0
// What is done from the page: recordings, detect, the doctor, the guided calibration.

import { token } from "./connection.js";

const $ = (id) => document.getElementById(id);
const TITLES = { detect: "detect the board", doctor: "doctor", calibrate: "calibration" };
const OHM = [10, 1e6]; // of the curve's axis

export class Work {
  /** @param ask called with what is asked for, and what was typed. */
  constructor(ask, allowed) {
    this.findings = [];
    this.until = null; // ms, of a count-down
    this.allowed = allowed;
    $("record").disabled = !allowed;
    $("record").onclick = () => ask(this.recording ? "finish" : "record");
    for (const name in TITLES) {
      $(name).disabled = !allowed;
      $(name).onclick = () => ask(name);
    }
    $("leave").onclick = () => (this.task ? ask("give up") : this.hide());
    $("back").onclick = () => ask("answer", "b");
    $("question").onsubmit = (event) => {
      event.preventDefault();
      const input = $("question").elements.text;
      ask("answer", input.value);
      input.value = "";
    };
  }

  hide() {
    this.show(false);
    this.findings = [];
  }

  show(whether) {
    $("work").hidden = !whether;
    $("desk").classList.toggle("working", whether);
  }

  /** @param state of the server's Work. */
  take(state, colours) {
    const was = this.task;
    Object.assign(this, { task: state.task, recording: state.recording, findings: state.findings });
    $("record").textContent = state.recording ? "end recording" : "record";
    $("record").classList.toggle("sure", state.recording);
    const links = state.files.map((path) => {
      const link = document.createElement("a");
      [link.href, link.download, link.textContent] = [`${path}${location.search || "?"}&${token}`, path.slice(1), `download ${path.slice(1)}`];
      return link;
    });
    $("files").replaceChildren(...links);
    for (const name in TITLES) $(name).disabled = !this.allowed || state.task !== "";
    this.show(state.lines.length > 0 || state.task !== "");
    if (state.task || !was) this.title = TITLES[state.task] ?? this.title ?? "guided steps";
    $("work").querySelector("h2").textContent = this.title;
    $("leave").textContent = state.task ? "give up" : "close";
    const list = $("work").querySelector(".scrolled");
    list.replaceChildren(...state.lines.map((line) => {
      const item = document.createElement("p");
      item.textContent = line;
      return item;
    }));
    list.scrollTop = list.scrollHeight;
    const asked = state.question !== null;
    if (asked && $("question").hidden !== false) $("question").elements.text.value = "";
    $("question").hidden = !asked;
    $("back").hidden = !state.back;
    $("question").querySelector("p").textContent = state.question ?? "";
    this.until = state.left === null ? null : performance.now() + 1000 * state.left;
    this.curve(state.curve, colours);
    this.tick();
  }

  /** What is left of a count-down. */
  tick() {
    const left = this.until === null ? 0 : Math.ceil((this.until - performance.now()) / 1000);
    const [asked, none] = [!$("question").hidden, this.task ? "measuring" : ""];
    const text = left > 0 ? (asked ? `${left} s` : `hands off: measured in ${left} s`) : asked ? "" : none;
    if ($("left").textContent !== text) $("left").textContent = text;
  }

  /** Resistance over force, both by powers of ten. */
  curve([force, resistance] = [], colours) {
    const canvas = $("curve");
    canvas.hidden = !force;
    if (!force) return;
    const [ratio, w, h, left, bottom] = [window.devicePixelRatio || 1, 360, 170, 60, 24];
    [canvas.width, canvas.height] = [ratio * w, ratio * h];
    const ctx = canvas.getContext("2d");
    ctx.scale(ratio, ratio);
    const known = force.map((f, k) => [f, resistance[k]]).filter(([f]) => f > 0);
    const [low, high] = [known[0][0], known.at(-1)[0]];
    const x = (f) => left + (Math.log(f / low) / Math.log(high / low)) * (w - left - 10);
    const y = (r) => 8 + (Math.log(OHM[1] / r) / Math.log(OHM[1] / OHM[0])) * (h - bottom - 8);
    ctx.fillStyle = colours.panel;
    ctx.fillRect(0, 0, w, h);
    ctx.font = "12px system-ui, sans-serif";
    ctx.fillStyle = colours.faint;
    ctx.strokeStyle = colours.line;
    for (let r = OHM[0]; r <= OHM[1]; r *= 10) {
      ctx.fillText(r >= 1e6 ? `${r / 1e6} MΩ` : r >= 1000 ? `${r / 1000} kΩ` : `${r} Ω`, 8, y(r) + 4);
      ctx.strokeRect(left, y(r), w - left - 10, 0);
    }
    ctx.fillText(`${low.toPrecision(2)} N`, left, h - 6);
    ctx.fillText(`${high.toPrecision(2)} N a cell`, w - 90, h - 6);
    ctx.strokeStyle = colours.force;
    ctx.lineWidth = 2;
    ctx.beginPath();
    known.forEach(([f, r]) => ctx.lineTo(x(f), y(r)));
    ctx.stroke();
  }
}
