// SPDX-License-Identifier: Apache-2.0
// Covers in space: each cell where it is on the robot, coloured by its pressure, and the pushes.
//
// Painted from far to near on a plain canvas: a robot's computer often has no graphics processor,
// and there a frame of WebGL costs twice as much as these few hundred squares.

import { rising } from "./colours.js";

const CELL = 0.46; // of the pitch, from the middle of a cell to its edge
const BACKING = 0.6; // the same of what is behind it, which overlaps: nothing is seen through a gap
const MANY = 1024; // cells, of which a gap between two would be thinner than a pixel: they overlap
const TURN = 0.008; // rad for each px that is dragged
const STEP = 0.12; // rad for each arrow key
const STEEPEST = 1.5; // rad that the camera looks down or up
const ZOOM = 1.1; // for each turn of the wheel
const FAR = 2.6; // times the size of all covers that the camera is away at first
const NEAREST = 1.2; // the same, after the wheel
const FARTHEST = 20; // the same
const VIEW = Math.tan(0.35); // half of the height that is seen, at a distance of 1
const NEAR = 1e-3; // m before the camera, from which on a point is seen
const TILES = 6; // of the floor, from its middle to its end
const TILE = 0.5; // times the size of all covers
const FLOOR = "rgb(128 128 128 / 35%)"; // colour of its lines
const ARROW = 0.6; // length of the arrow at the force that stops, times the size of all covers
const FONT = 13; // px, of a name
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
  /**
   * @param hellos of the server, of each cover: position and normal (rows * cols * 3) of each cell
   *   [m], and the name that is written above it, empty: none.
   */
  constructor(canvas, hellos) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.close = hellos.reduce((sum, { rows, cols }) => sum + rows * cols, 0) >= MANY;
    this.covers = hellos.map((hello, n) => cover(hello, n, this.close ? BACKING : CELL));
    this.squares = this.covers.flatMap(({ squares }) => squares);
    const { middle, size, lowest } = extent(this.squares, Math.max(...hellos.map(({ pitch }) => pitch)));
    Object.assign(this, { middle, size, lowest });
    const facing = hellos.flatMap(({ normal }) => normal).reduce((sum, x, k) => {
      sum[k % 3] += x;
      return sum;
    }, [0, 0, 0]);
    this.azimuth = Math.atan2(facing[1], facing[0]) + 0.5;
    this.height = 0.4;
    this.away = FAR * this.size;
    this.turned = true;
    this.listen();
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

  /** Project all squares; order the sides of the covers, and the squares of each, from far to near. */
  look() {
    const { azimuth, height, away } = this;
    const level = Math.cos(height);
    const from = [Math.cos(azimuth) * level, Math.sin(azimuth) * level, Math.sin(height)];
    this.camera = add(this.middle, from, away);
    this.axes = [cross(UP, from), cross(from, cross(UP, from)), from].map((axis) => scaled(axis, 1));
    const sides = new Map();
    for (const [k, { n, middle, out, front, back }] of this.squares.entries()) {
      const way = add(this.camera, middle, -1);
      const side = `${n}, ${dot(out, way) > 0 ? "outside" : "inside"}`;
      if (!sides.has(side)) sides.set(side, []);
      sides.get(side).push({ k, far: dot(way, this.axes[2]), front: this.seen(front), back: this.seen(back) });
    }
    const farther = (a, b) => b.far - a.far;
    this.sides = [...sides.values()]
      .map((cells) => ({ cells: cells.sort(farther), far: cells.reduce((sum, { far }) => sum + far, 0) / cells.length }))
      .sort(farther);
    const [x, y] = this.middle;
    const reach = TILES * TILE * this.size;
    this.floor = [...Array(2 * TILES + 1).keys()].flatMap((k) => {
      const off = (k - TILES) * TILE * this.size;
      const ends = [-reach, reach];
      return [ends.map((end) => [x + off, y + end]), ends.map((end) => [x + end, y + off])];
    }).map((line) => this.seen(line.map((at) => [...at, this.lowest])));
    this.turned = false;
    this.canvas.dataset.turned = this.azimuth.toFixed(2);
  }

  /** Points [m] -> points on the canvas [px]. */
  seen(points) {
    const { width, height } = this.canvas;
    return points.map((point) => {
      const at = add(point, this.camera, -1);
      const zoom = height / 2 / VIEW / Math.max(NEAR, -dot(at, this.axes[2]));
      return [width / 2 + zoom * dot(at, this.axes[0]), height / 2 - zoom * dot(at, this.axes[1])];
    });
  }

  /**
   * @param shown of each cover: {values, push, limit}, the force on each cell [N], the push and the
   *   force that stops.
   * @param high of the scale [N].
   */
  draw(shown, high, colours) {
    const now = this.squares.map(({ n, cell }) => {
      const value = shown[n].values?.[cell];
      if (value === undefined || value !== value) return colours.absent;
      return LEVELS[Math.min(255, Math.max(0, Math.round((255 * value) / high)))];
    });
    const pushes = shown.flatMap(({ push, limit }) => (push ? [{ ...push, limit }] : []));
    // where nothing changed, nothing is drawn
    const key = JSON.stringify([pushes, colours.panel]);
    if (!this.turned && key === this.key && now.every((colour, k) => colour === this.now[k])) return;
    Object.assign(this, { key, now });
    if (this.turned) this.look();
    const { context, canvas } = this;
    context.fillStyle = colours.panel;
    context.fillRect(0, 0, canvas.width, canvas.height);
    this.ground();
    const before = ({ direction, at }) => dot(direction, add(at, this.camera, -1)) > 0;
    pushes.filter((push) => !before(push)).forEach((push) => this.arrow(push));
    for (const { cells } of this.sides) {
      if (!this.close) this.paint(cells.map(({ back }) => back), colours.panel);
      for (const { k, front } of cells) this.paint([front], now[k]);
    }
    pushes.filter(before).forEach((push) => this.arrow(push));
    this.label(colours);
  }

  /** The name of each cover, above it. */
  label(colours) {
    const { context } = this;
    context.font = `600 ${FONT * window.devicePixelRatio}px system-ui, sans-serif`;
    context.textAlign = "center";
    [context.lineJoin, context.lineWidth] = ["round", 4 * window.devicePixelRatio];
    [context.strokeStyle, context.fillStyle] = [colours.panel, colours.text];
    for (const { name, top } of this.covers) {
      const [[x, y]] = this.seen([top]);
      context.strokeText(name, x, y);
      context.fillText(name, x, y);
    }
  }

  /** Fill shapes, each a list of points [px]. */
  paint(shapes, colour) {
    const { context } = this;
    context.fillStyle = colour;
    for (const shape of shapes) {
      context.beginPath();
      for (const [x, y] of shape) context.lineTo(x, y);
      context.fill();
    }
  }

  /** The floor under the covers, as lines of its tiles. */
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
  arrow({ at, direction, force, limit }) {
    const length = this.size * Math.min(1, Math.max(0.2, (ARROW * force) / (limit ?? FULL)));
    const side = scaled(cross(direction, Math.abs(direction[2]) < 0.9 ? UP : [1, 0, 0]), 1);
    const other = cross(direction, side);
    const rings = OUTLINE.map(([behind, radius]) => [...Array(AROUND).keys()].map((k) => {
      const angle = (2 * Math.PI * k) / AROUND;
      const around = add(scaled(side, Math.cos(angle)), other, Math.sin(angle));
      return add(add(at, direction, -behind * length), around, radius * length);
    }));
    this.paint(rings.slice(1).flatMap((ring, r) => ring.map((point, k) => {
      const next = (k + 1) % AROUND;
      return this.seen([rings[r][k], point, ring[next], rings[r][next]]);
    })), PAINT);
  }
}

/** A square for each cell of cover n, in the plane that its normal stands on, and of its backing. */
function cover({ rows, cols, populated, position, normal, pitch, name }, n, half) {
  const at = (k) => position.slice(3 * k, 3 * k + 3);
  const squares = [...Array(rows * cols).keys()].filter((k) => populated[k]).map((k) => {
    const [row, col, out] = [Math.floor(k / cols), k % cols, normal.slice(3 * k, 3 * k + 3)];
    let along = add(at(row * cols + Math.min(col + 1, cols - 1)), at(row * cols + Math.max(col - 1, 0)), -1);
    along = add(along, out, -dot(along, out));
    if (Math.hypot(...along) < 1e-6) along = cross(UP, out);
    along = scaled(along, pitch);
    const up = cross(out, along);
    const square = (a) => [[-a, -a], [a, -a], [a, a], [-a, a]].map(([x, y]) => add(add(at(k), along, x), up, y));
    return { n, cell: k, middle: at(k), out, front: square(half), back: square(BACKING) };
  });
  const { middle, highest } = extent(squares, pitch);
  return { name: name ?? "", squares, top: [middle[0], middle[1], highest] };
}

/** Middle, size and height of squares [m]; `around` is added where they end. */
function extent(squares, around) {
  const axes = [0, 1, 2].map((axis) => squares.map(({ middle }) => middle[axis]));
  const [low, high] = [Math.min, Math.max].map((end) => axes.map((axis) => end(...axis)));
  return {
    middle: add(low, high).map((x) => x / 2),
    size: Math.max(Math.hypot(...add(high, low, -1)) / 2, around),
    lowest: low[2] - around,
    highest: high[2] + around,
  };
}
