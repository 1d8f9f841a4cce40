// SPDX-License-Identifier: Apache-2.0
// The cover in space: each cell where it is on the robot, coloured by its pressure, and the push.
//
// Painted from far to near on a plain canvas: a robot's computer often has no graphics processor,
// and there a frame of WebGL costs twice as much as these few hundred squares.

import { rgb, rising } from "./colours.js";

const CELL = 0.46; // of the pitch, from the middle of a cell to its edge
const BACKING = 0.52; // the same of what is behind it: nothing is seen through a gap
const MANY = 1024; // cells, from which on a gap between two is thinner than a pixel: there is none
const TURN = 0.008; // rad for each px that is dragged
const STEP = 0.12; // rad for each arrow key
const STEEPEST = 1.5; // rad that the camera looks down or up
const ZOOM = 1.1; // for each turn of the wheel
const FAR = 2.6; // times the size of the cover that the camera is away at first
const NEAREST = 1.2; // the same, after the wheel
const FARTHEST = 20; // the same
const VIEW = Math.tan(0.35); // half of the height that is seen, at a distance of 1
const NEAR = 1e-3; // m before the camera, from which on a point is seen
const TILES = 6; // of the floor, from its middle to its end
const TILE = 0.5; // times the size of the cover
const FLOOR = "rgb(128 128 128 / 35%)"; // colour of its lines
const ARROW = 0.6; // length of the arrow at the force that stops, times the size of the cover
const FULL = 30; // N of the longest arrow, where nobody says what stops
const PAINT = "#ff2f87"; // of the arrow
// Outline of the arrow, of length 1 and with its tip in the origin: [distance from the tip, radius]
const OUTLINE = [[0, 0], [0.25, 0.09], [0.25, 0.03], [1, 0.03], [1, 0]];
const AROUND = 12; // sides of the arrow
const UP = [0, 0, 1]; // of the robot: x forward, y left, z up
const LEVELS = [...Array(256).keys()].map((k) => `rgb(${rising.slice(4 * k, 4 * k + 3).join()})`);

const add = (a, b, times = 1) => a.map((x, k) => x + times * b[k]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, length) => a.map((x) => (x * length) / (Math.hypot(...a) || 1));

export class Space {
  /** @param hello of the server: position and normal (rows * cols * 3) of each cell [m]. */
  constructor(canvas, hello) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.cover(hello);
    const facing = [0, 1, 2].map((axis) => hello.normal.reduce((sum, x, k) => sum + (k % 3 === axis ? x : 0), 0));
    this.azimuth = Math.atan2(facing[1], facing[0]) + 0.5;
    this.height = 0.4;
    this.away = FAR * this.size;
    this.turned = true;
    this.listen();
  }

  /** Corners of a square for each cell, in the plane that its normal stands on, and of its backing. */
  cover({ rows, cols, populated, position, normal, pitch }) {
    const at = (k) => position.slice(3 * k, 3 * k + 3);
    this.cells = [...Array(rows * cols).keys()].filter((k) => populated[k]);
    this.squares = this.cells.map((k) => {
      const [row, col, out] = [Math.floor(k / cols), k % cols, normal.slice(3 * k, 3 * k + 3)];
      let along = add(at(row * cols + Math.min(col + 1, cols - 1)), at(row * cols + Math.max(col - 1, 0)), -1);
      along = add(along, out, -dot(along, out));
      if (Math.hypot(...along) < 1e-6) along = cross(UP, out);
      along = scaled(along, pitch);
      const up = cross(out, along);
      const square = (a) => [[-a, -a], [a, -a], [a, a], [-a, a]].map(([x, y]) => add(add(at(k), along, x), up, y));
      return { middle: at(k), front: square(rows * cols < MANY ? CELL : 0.5), back: square(BACKING) };
    });
    const middles = this.squares.map(({ middle }) => middle);
    const [low, high] = [Math.min, Math.max].map((end) => [0, 1, 2].map((k) => end(...middles.map((at) => at[k]))));
    this.middle = scaled(add(low, high), Math.hypot(...add(low, high)) / 2);
    this.size = Math.max(Math.hypot(...add(high, low, -1)) / 2, pitch);
    this.lowest = low[2] - pitch;
  }

  listen() {
    const { canvas } = this;
    canvas.onpointerdown = (event) => canvas.setPointerCapture(event.pointerId);
    canvas.onpointermove = (event) => {
      if (event.buttons) this.turn(-TURN * event.movementX, TURN * event.movementY);
    };
    canvas.onwheel = (event) => {
      const away = (this.away / this.size) * ZOOM ** Math.sign(event.deltaY);
      this.away = Math.min(FARTHEST, Math.max(NEAREST, away)) * this.size;
      this.turned = true;
      event.preventDefault();
    };
    canvas.onkeydown = (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!way) return;
      this.turn(STEP * way[0], STEP * way[1]);
      event.preventDefault();
      event.stopPropagation();
    };
  }

  turn(around, up) {
    this.azimuth += around;
    this.height = Math.min(STEEPEST, Math.max(-STEEPEST, this.height + up));
    this.turned = true;
  }

  resize(width, height) {
    const ratio = window.devicePixelRatio;
    Object.assign(this.canvas, { width: width * ratio, height: height * ratio });
    Object.assign(this.canvas.style, { width: `${width}px`, height: `${height}px` });
    this.turned = true;
  }

  /** Project all squares, and order them from far to near. */
  look() {
    const { azimuth, height, away } = this;
    const level = Math.cos(height);
    const from = [Math.cos(azimuth) * level, Math.sin(azimuth) * level, Math.sin(height)];
    this.camera = add(this.middle, from, away);
    this.axes = [cross(UP, from), cross(from, cross(UP, from)), from].map((axis) => scaled(axis, 1));
    const far = ({ middle }) => -dot(add(middle, this.camera, -1), this.axes[2]);
    this.painted = this.squares
      .map((square, n) => ({ n, far: far(square), front: this.seen(square.front), back: this.seen(square.back) }))
      .sort((a, b) => b.far - a.far);
    const at = (x, y) => [this.middle[0] + x * TILE * this.size, this.middle[1] + y * TILE * this.size, this.lowest];
    this.floor = [...Array(2 * TILES + 1).keys()].flatMap((k) => [
      this.seen([at(k - TILES, -TILES), at(k - TILES, TILES)]), this.seen([at(-TILES, k - TILES), at(TILES, k - TILES)]),
    ]);
    this.turned = false;
    this.canvas.dataset.turned = this.azimuth.toFixed(2);
  }

  /** Points [m] -> points on the canvas [px], always in the same sense around a shape. */
  seen(points) {
    const { width, height } = this.canvas;
    const shape = points.map((point) => {
      const at = add(point, this.camera, -1);
      const zoom = height / 2 / VIEW / Math.max(NEAR, -dot(at, this.axes[2]));
      return [width / 2 + zoom * dot(at, this.axes[0]), height / 2 - zoom * dot(at, this.axes[1])];
    });
    const area = shape.reduce((sum, [x, y], k) => {
      const [next, down] = shape[(k + 1) % shape.length];
      return sum + x * down - next * y;
    }, 0);
    return area < 0 ? shape.reverse() : shape; // what is filled with its neighbour has no hole
  }

  /** @param scale {high, values}: of the flat picture. */
  draw({ head: { push, limit } }, scale, colours) {
    const now = this.cells.map((k) => {
      const value = scale.values?.[k];
      if (value === undefined || value !== value) return colours.absent;
      return LEVELS[Math.min(255, Math.max(0, Math.round((255 * value) / scale.high)))];
    });
    // where nothing changed, nothing is drawn
    const key = [push?.at, push?.direction, push?.force, limit, colours.panel].join();
    if (!this.turned && key === this.key && now.every((colour, k) => colour === this.now[k])) return;
    Object.assign(this, { key, now });
    if (this.turned) this.look();
    const { context, canvas } = this;
    context.fillStyle = colours.panel;
    context.fillRect(0, 0, canvas.width, canvas.height);
    this.ground();
    const facing = push && dot(push.direction, add(push.at, this.camera, -1)) > 0;
    if (push && !facing) this.arrow(push, limit ?? FULL);
    this.paint(this.painted.map(({ back }) => back), colours.panel);
    for (let k = 0; k < this.painted.length;) { // neighbours of one colour at a time
      const colour = now[this.painted[k].n];
      const first = k;
      while (k < this.painted.length && now[this.painted[k].n] === colour) k++;
      this.paint(this.painted.slice(first, k).map(({ front }) => front), colour);
    }
    if (facing) this.arrow(push, limit ?? FULL);
  }

  paint(shapes, colour) {
    const { context } = this;
    context.fillStyle = colour;
    context.beginPath();
    for (const [[x, y], ...others] of shapes) {
      context.moveTo(x, y);
      for (const [x, y] of others) context.lineTo(x, y);
      context.closePath();
    }
    context.fill();
  }
  /** The floor under the cover, as lines of its tiles. */
  ground() {
    const { context } = this;
    context.strokeStyle = FLOOR;
    context.lineWidth = window.devicePixelRatio;
    context.beginPath();
    for (const line of this.floor) {
      for (const [n, [x, y]] of line.entries()) n ? context.lineTo(x, y) : context.moveTo(x, y);
    }
    context.stroke();
  }

  /** The arrow ends where the push presses. */
  arrow(push, limit) {
    const length = this.size * Math.min(1, Math.max(0.2, (ARROW * push.force) / limit));
    const along = push.direction;
    const side = scaled(cross(along, Math.abs(along[2]) < 0.9 ? UP : [1, 0, 0]), 1);
    const other = cross(along, side);
    const rings = OUTLINE.map(([behind, radius]) => [...Array(AROUND).keys()].map((k) => {
      const angle = (2 * Math.PI * k) / AROUND;
      const middle = add(push.at, along, -behind * length);
      return add(add(middle, side, radius * length * Math.cos(angle)), other, radius * length * Math.sin(angle));
    }));
    const shapes = [];
    for (let ring = 1; ring < rings.length; ring++) {
      for (let k = 0; k < AROUND; k++) {
        const next = (k + 1) % AROUND;
        shapes.push(this.seen([rings[ring - 1][k], rings[ring][k], rings[ring][next], rings[ring - 1][next]]));
      }
    }
    this.paint(shapes, PAINT);
  }
}
