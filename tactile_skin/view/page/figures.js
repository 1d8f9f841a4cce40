// SPDX-License-Identifier: Apache-2.0
// The pictures of the mat with their scales: which is how large, in which unit, what it shows.

import { rising, signed } from "./colours.js";
import { Mat } from "./mat.js";
import { largest, Scales, showScale } from "./scale.js";

const NAMES = ["a", "reading", "b", "std", "misfit"];
const NARROW = 1000; // px of the page, below which one stands under the other
const ROOMY = 1340; // px of the page, below which three do not stand next to each other
const MAIN = { narrow: 0.58, landscape: 0.6 }; // of the page's width that the large picture takes
const MIDDLE = 0.52; // at most, the same of other shapes, and
const LEAST = 660; // px that it is high at least, if it is not too wide then
const READING = 0.23; // of the width, the raw reading
const ABOVE = 250; // px of the window's height that other things take
const TRAIL = 1; // s for which a contact is followed
const KILO = 1000; // Pa in a kPa

const $ = (id) => document.getElementById(id);

export class Figures {
  /** @param pick called with the cell {row, col} that is pointed at, or null. */
  constructor(hello, pick) {
    this.hello = hello;
    this.scales = new Scales();
    this.trails = new Map(); // id of a contact -> [[row, col, t], ...]
    this.mats = {};
    for (const name of NAMES) {
      const figure = $(name);
      const canvas = figure.querySelector(".picture canvas");
      const mat = new Mat(canvas, hello.rows, hello.cols, hello.populated);
      this.mats[name] = mat;
      canvas.onpointermove = canvas.onpointerdown = (event) => pick(mat.under(event));
      canvas.onpointerleave = () => pick(null);
      const button = figure.querySelector(".enlarge");
      button.setAttribute("aria-label", `enlarge ${canvas.getAttribute("aria-label")}`);
      canvas.onclick = button.onclick = () => this.enlarge(figure.classList.contains("large") ? null : figure);
    }
    this.resize();
  }

  /** Show one figure on all of the window; null: none. */
  enlarge(figure) {
    for (const other of document.querySelectorAll("figure")) {
      const large = other === figure;
      other.classList.toggle("large", large);
      other.querySelector(".enlarge").textContent = large ? "make small" : "enlarge";
    }
    document.body.classList.toggle("enlarged", figure !== null);
    this.resize();
  }

  resize() {
    const [width, height] = [document.documentElement.clientWidth, window.innerHeight];
    const { rows, cols } = this.hello;
    const main = $("desk").clientWidth;
    const wide = width >= NARROW;
    const slim = rows > 1.5 * cols ? "portrait" : cols >= 2 * rows ? "landscape" : width < ROOMY ? "narrow" : "";
    const shape = wide ? slim : "";
    $("desk").dataset.shape = shape;
    const most = (MAIN[shape] ?? MIDDLE) * main;
    const tall = Math.max(height - ABOVE, LEAST);
    for (const [name, mat] of Object.entries(this.mats)) {
      const figure = $(name);
      const inside = figure.querySelector(".picture").clientWidth;
      if (figure.classList.contains("large")) mat.resize(width - 40, height - 190);
      else if (!wide) mat.resize(Math.min(inside || main, main), Math.max(0.8 * height, 300));
      else if (name === "a") mat.resize(most, tall);
      else if (name === "reading" && shape === "landscape") mat.resize(most, tall);
      else if (name === "reading" && shape === "narrow") mat.resize(inside, tall);
      else if (name === "reading") mat.resize(READING * main, shape ? tall : READING * main);
      else mat.resize(inside || main / 3, 0.4 * main);
      const across = `${(mat.cell * cols) / mat.ratio}px`;
      figure.querySelector(".legend").style.width = `max(${across}, 200px)`;
    }
  }

  /** Where the contacts were. */
  follow({ stamp, contacts }) {
    for (const { id, row, col } of contacts) {
      const trail = this.trails.get(id) ?? [];
      if (trail.at(-1)?.[2] === stamp) continue;
      trail.push([row, col, stamp]);
      this.trails.set(id, trail);
    }
    for (const [id, trail] of this.trails) {
      const kept = trail.filter(([, , t]) => t <= stamp && t > stamp - TRAIL);
      if (kept.length) this.trails.set(id, kept);
      else this.trails.delete(id);
    }
  }

  /** Forget the largest values of a unit, or a method, that is no longer shown. */
  forget() {
    this.scales = new Scales();
  }

  /** Newtons of each cell in the unit that is chosen. */
  inUnit(values) {
    if ($("unit").value === "N" || !values) return values;
    return values.map((force, k) => force / this.hello.area[k] / KILO);
  }

  /** A force of one cell, in the unit that is chosen. */
  ofCell(force) {
    const { area, populated } = this.hello;
    return $("unit").value === "N" ? force : force / area[populated.indexOf(1)] / KILO;
  }

  /**
   * @param findings [{rows, cols}, ...]: lines and cells to mark.
   * @param chosen cell, or null.
   */
  draw({ head, arrays }, findings, chosen, colours, now) {
    const unit = $("unit").value === "N" ? "N per cell" : "kPa";
    const a = this.inUnit(arrays.a);
    const b = this.inUnit(arrays.b);
    const std = this.inUnit(arrays.std);
    const given = Number($("scale").value);
    const force = given ? this.ofCell(given) : this.scales.hold("a", largest(a), this.ofCell(0.5), now);
    const scales = {
      a: [a, rising, 0, force, unit],
      reading: [arrays.reading, rising, 0, this.scales.hold("reading", largest(arrays.reading), 100, now), "ADC steps"],
    };
    if (!$("explained").hidden) {
      const misfit = this.scales.hold("misfit", largest(arrays.misfit?.map(Math.abs)), 5, now);
      const [most, spread] = [largest(b), largest(std)];
      scales.b = [b, rising, 0, this.scales.hold("b", most, this.ofCell(0.5), now), unit];
      scales.std = [std, rising, 0, this.scales.hold("std", spread, this.ofCell(0.01), now), unit];
      scales.misfit = [arrays.misfit, signed(colours.middle), -misfit, misfit, "ADC steps"];
    }
    this.scale = { high: force, values: a };
    const flat = $("space").hidden;
    for (const [name, [values, table, low, high, text]] of Object.entries(scales)) {
      const mat = this.mats[name];
      const limit = name === "a" && head.cell_limit !== null ? this.ofCell(head.cell_limit) : null;
      showScale(document.querySelector(`#${name} .legend`), table, low, high, text, limit);
      if (name === "a" && !flat) continue;
      mat.draw(values, low, high, table, colours);
      mat.mark(findings, colours);
      if (chosen) mat.choose(chosen, colours);
    }
    if (a && flat) {
      this.mats.a.contacts(head.contacts, this.trails);
      if (head.push) this.mats.a.push(head.push);
    }
  }
}
