// SPDX-License-Identifier: Apache-2.0
// The cover in space: each cell where it is on the robot, coloured by its pressure, and the push.

import {
  BufferAttribute, BufferGeometry, Color, ColorManagement, ConeGeometry, CylinderGeometry,
  DoubleSide, GridHelper, Group, LinearSRGBColorSpace, Mesh, MeshBasicMaterial, PerspectiveCamera,
  Scene, Vector3, WebGLRenderer,
} from "./three.module.min.js";

import { rgb, rising } from "./colours.js";

const CELL = 0.46; // of the pitch, from the middle of a cell to its edge
const BACKING = 0.52; // the same of what is behind it: nothing is seen through a gap
const MANY = 1024; // cells, from which on a gap between two is thinner than a pixel: there is none
const TURN = 0.008; // rad for each px that is dragged
const STEP = 0.12; // rad for each arrow key
const STEEPEST = 1.5; // rad that the camera looks down or up
const ZOOM = 1.1; // for each turn of the wheel
const FAR = 2.6; // times the size of the cover that the camera is away at first
const ARROW = 0.6; // length of the arrow at the force that stops, times the size of the cover
const FULL = 30; // N of the longest arrow, where nobody says what stops
const AXIS = new Vector3(0, 1, 0); // of a cylinder and a cone of three.js
const UP = new Vector3(0, 0, 1); // of the robot: x forward, y left, z up
ColorManagement.enabled = false; // colours are drawn as they are given: nothing is lit or mixed

export class Space {
  /** @param hello of the server: position and normal (rows * cols * 3) of each cell [m]. */
  constructor(canvas, hello) {
    this.canvas = canvas;
    this.hello = hello;
    this.renderer = new WebGLRenderer({ canvas, antialias: false, powerPreference: "low-power" });
    this.renderer.outputColorSpace = LinearSRGBColorSpace; // as above
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(40, 1, 0.01, 100);
    this.camera.up.copy(UP);
    this.scene.add(this.cover());
    this.arrow = arrow();
    this.scene.add(this.arrow);
    this.ground();
    const facing = new Vector3();
    for (let k = 0; k < hello.normal.length; k += 3) facing.add(new Vector3().fromArray(hello.normal, k));
    this.azimuth = Math.atan2(facing.y, facing.x) + 0.5;
    this.height = 0.4;
    this.away = FAR * this.size;
    this.turned = true;
    this.listen();
  }

  /** A square for each cell, in the plane that its normal stands on, and a backing for all gaps. */
  cover() {
    const { rows, cols, populated, position, normal, pitch } = this.hello;
    const at = (k) => new Vector3().fromArray(position, 3 * k);
    this.cells = [...Array(rows * cols).keys()].filter((k) => populated[k]);
    const [corners, behind, sides] = [[], [], []];
    const [low, high] = [new Vector3(Infinity, Infinity, Infinity), new Vector3(-Infinity, -Infinity, -Infinity)];
    for (const k of this.cells) {
      const [row, col] = [Math.floor(k / cols), k % cols];
      const out = new Vector3().fromArray(normal, 3 * k);
      const [next, before] = [Math.min(col + 1, cols - 1), Math.max(col - 1, 0)];
      const along = at(row * cols + next).sub(at(row * cols + before));
      along.addScaledVector(out, -along.dot(out));
      if (along.lengthSq() < 1e-12) along.crossVectors(UP, out);
      along.setLength(pitch);
      const up = new Vector3().crossVectors(out, along);
      const middle = at(k);
      low.min(middle);
      high.max(middle);
      const corner = (a, b) => middle.clone().addScaledVector(along, a).addScaledVector(up, b).toArray();
      const square = (a) => [...corner(-a, -a), ...corner(a, -a), ...corner(a, a), ...corner(-a, a)];
      const first = corners.length / 3;
      corners.push(...square(rows * cols < MANY ? CELL : 0.5));
      behind.push(...square(BACKING));
      sides.push(first, first + 1, first + 2, first, first + 2, first + 3);
    }
    this.middle = low.clone().add(high).divideScalar(2);
    this.lowest = low.z - pitch;
    this.size = Math.max(high.distanceTo(low) / 2, pitch);
    const [squares, backing] = [corners, behind].map((at) =>
      new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(at), 3)).setIndex(sides));
    this.colours = new BufferAttribute(new Uint8Array(4 * (corners.length / 3)), 4, true);
    squares.setAttribute("color", this.colours);
    const deeper = { polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2 };
    this.backing = new MeshBasicMaterial({ side: DoubleSide, ...deeper });
    return new Group().add(
      new Mesh(squares, new MeshBasicMaterial({ vertexColors: true, side: DoubleSide })),
      new Mesh(backing, this.backing),
    );
  }

  /** The floor under the cover. */
  ground() {
    this.grid = new GridHelper(6 * this.size, 12, 0x808080, 0x808080);
    this.grid.rotateX(Math.PI / 2);
    this.grid.position.set(this.middle.x, this.middle.y, this.lowest);
    this.grid.material.transparent = true;
    this.grid.material.opacity = 0.35;
    this.scene.add(this.grid);
  }

  listen() {
    const { canvas } = this;
    canvas.onpointerdown = (event) => canvas.setPointerCapture(event.pointerId);
    canvas.onpointermove = (event) => {
      if (event.buttons) this.turn(-TURN * event.movementX, TURN * event.movementY);
    };
    canvas.onwheel = (event) => {
      this.away = Math.min(20, Math.max(1.2, (this.away / this.size) * ZOOM ** Math.sign(event.deltaY))) * this.size;
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
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.turned = true;
  }

  look() {
    const { azimuth, height, away } = this;
    const level = Math.cos(height);
    this.camera.position.set(Math.cos(azimuth) * level, Math.sin(azimuth) * level, Math.sin(height));
    this.camera.position.multiplyScalar(away).add(this.middle);
    this.camera.lookAt(this.middle);
    this.camera.updateProjectionMatrix();
    this.turned = false;
    this.canvas.dataset.turned = this.azimuth.toFixed(2);
  }

  /** @param scale {high, values}: of the flat picture. */
  draw({ head }, scale, colours) {
    const now = new Uint32Array(4 * this.cells.length);
    const table = new Uint32Array(rising.buffer);
    const absent = new Uint32Array(new Uint8Array([...rgb(colours.absent), 255]).buffer)[0];
    this.cells.forEach((k, n) => {
      const value = scale.values?.[k];
      const at = Math.min(255, Math.max(0, Math.round((255 * value) / scale.high)));
      now.fill(value === value && value !== undefined ? table[at] : absent, 4 * n, 4 * n + 4);
    });
    // where nothing changed, nothing is drawn
    const key = [head.push?.at, head.push?.direction, head.push?.force, head.limit, colours.panel].join();
    const before = new Uint32Array(this.colours.array.buffer);
    if (!this.turned && key === this.key && now.every((colour, k) => colour === before[k])) return;
    this.key = key;
    before.set(now);
    this.colours.needsUpdate = true;
    if (this.turned) this.look();
    this.scene.background = this.backing.color = new Color(colours.panel);
    this.arrow.visible = Boolean(head.push);
    if (head.push) this.point(head.push, head.limit ?? FULL);
    this.renderer.render(this.scene, this.camera);
  }

  /** The arrow ends where the push presses. */
  point(push, limit) {
    const direction = new Vector3(...push.direction);
    const length = this.size * Math.min(1, Math.max(0.2, (ARROW * push.force) / limit));
    this.arrow.position.set(...push.at);
    this.arrow.quaternion.setFromUnitVectors(AXIS, direction);
    this.arrow.scale.setScalar(length);
  }
}

/** Of length 1 along AXIS; its tip is in the origin. */
function arrow() {
  const paint = new MeshBasicMaterial({ color: 0xff2f87 });
  const shaft = new Mesh(new CylinderGeometry(0.03, 0.03, 0.75, 12), paint);
  const head = new Mesh(new ConeGeometry(0.09, 0.25, 16), paint);
  shaft.position.y = -0.625;
  head.position.y = -0.125;
  return new Group().add(shaft, head);
}
