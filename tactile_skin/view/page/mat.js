// SPDX-License-Identifier: Apache-2.0
// One picture of the mat: exact cells, numbered lines, what is drawn on them.

const FONT = "11px system-ui, sans-serif";
const MARGIN = { left: 20, top: 16, right: 4, bottom: 4 }; // px around the cells

const LABEL = 22; // px that the number of a line and a gap take

const COLOURS = [
  "panel", "text", "faint", "line", "absent", "middle", "bad", "wrong", "stopped", "force",
];
const dark = matchMedia("(prefers-color-scheme: dark)");

/** The colours of the page that canvases need, by the names of style.css; they follow its mode. */
export function pageColours() {
  const colours = {};
  const read = () => {
    const style = getComputedStyle(document.documentElement);
    for (const name of COLOURS) colours[name] = style.getPropertyValue(`--${name}`).trim();
  };
  read();
  dark.addEventListener("change", read);
  return colours;
}

export class Mat {
  /**
   * @param canvas to draw on.
   * @param rows, cols of the mat.
   * @param populated (rows * cols) 1 where there is a cell.
   */
  constructor(canvas, rows, cols, populated) {
    Object.assign(this, { canvas, rows, cols, populated });
    this.cells = document.createElement("canvas");
    this.cells.width = cols;
    this.cells.height = rows;
    this.image = this.cells.getContext("2d").createImageData(cols, rows);
    this.pixels = new Uint32Array(this.image.data.buffer);
  }

  /** All cells of one size in device pixels, so that none is drawn larger than another. */
  resize(width, height) {
    const ratio = window.devicePixelRatio || 1;
    this.fits = [width, height];
    const across = (width - MARGIN.left - MARGIN.right) * ratio;
    const down = (height - MARGIN.top - MARGIN.bottom) * ratio;
    this.cell = Math.max(2, Math.floor(Math.min(across / this.cols, down / this.rows)));
    this.left = Math.round(MARGIN.left * ratio);
    this.top = Math.round(MARGIN.top * ratio);
    const w = this.left + this.cell * this.cols + Math.round(MARGIN.right * ratio);
    const h = this.top + this.cell * this.rows + Math.round(MARGIN.bottom * ratio);
    Object.assign(this.canvas, { width: w, height: h });
    this.size = [w / ratio, h / ratio]; // of the canvas [px]
    this.canvas.style.width = `${w / ratio}px`;
    this.canvas.style.height = `${h / ratio}px`;
    this.ratio = ratio;
    this.context = this.canvas.getContext("2d", { alpha: false });
    this.framed = ""; // colour of the numbers, once they are drawn
  }

  /** What does not change: the numbers of the lines. From then on only cells are drawn on. */
  frame(colours) {
    if (this.framed) this.resize(...this.fits);
    const ctx = this.context;
    ctx.fillStyle = colours.panel;
    ctx.fillRect(0, 0, this.canvas.width, this.canvas.height);
    this.number(ctx, colours);
    ctx.beginPath();
    ctx.rect(this.left, this.top, this.cell * this.cols, this.cell * this.rows);
    ctx.clip();
    this.framed = colours.panel;
  }

  /** Centre of a cell, or of a place between cells, in canvas pixels. */
  place(row, col) {
    return [this.left + (col + 0.5) * this.cell, this.top + (row + 0.5) * this.cell];
  }

  /** The cell under a pointer, or null. */
  under(event) {
    const box = this.canvas.getBoundingClientRect();
    const col = Math.floor(((event.clientX - box.left) * this.ratio - this.left) / this.cell);
    const row = Math.floor(((event.clientY - box.top) * this.ratio - this.top) / this.cell);
    const inside = row >= 0 && row < this.rows && col >= 0 && col < this.cols;
    return inside ? { row, col } : null;
  }

  /**
   * @param values (rows * cols); NaN: not read. Undefined: there is no picture.
   * @param low, high ends of the scale.
   * @param table 256 colours (colours.js).
   * @param colours of the page.
   */
  draw(values, low, high, table, colours) {
    if (this.framed !== colours.panel) this.frame(colours);
    const ctx = this.context;
    if (!values) {
      ctx.fillStyle = colours.panel;
      ctx.fillRect(0, 0, this.canvas.width, this.canvas.height);
      this.words(ctx, "no picture", colours);
      return;
    }
    const colour = new Uint32Array(table.buffer);
    const scale = 255 / (high - low);
    for (let k = 0; k < values.length; k++) {
      const at = Math.round((values[k] - low) * scale);
      // NaN becomes 0 there; cells that are not or were not read are left transparent
      this.pixels[k] = values[k] === values[k] && this.populated[k]
        ? colour[at < 0 ? 0 : at > 255 ? 255 : at]
        : 0;
    }
    this.cells.getContext("2d").putImageData(this.image, 0, 0);
    ctx.fillStyle = colours.absent;
    ctx.fillRect(this.left, this.top, this.cell * this.cols, this.cell * this.rows);
    ctx.imageSmoothingEnabled = false;
    ctx.drawImage(
      this.cells, this.left, this.top, this.cell * this.cols, this.cell * this.rows,
    );
  }

  number(ctx, colours) {
    ctx.fillStyle = colours.faint;
    ctx.font = FONT.replace("11px", `${12 * this.ratio}px`);
    const step = [1, 5, 10, 20, 50].find((n) => n * this.cell >= LABEL * this.ratio) || 100;
    ctx.textAlign = "center";
    ctx.textBaseline = "bottom";
    for (let c = 0; c < this.cols; c += step) {
      ctx.fillText(c, this.place(0, c)[0], this.top - 2 * this.ratio);
    }
    ctx.textAlign = "right";
    ctx.textBaseline = "middle";
    for (let r = 0; r < this.rows; r += step) {
      ctx.fillText(r, this.left - 4 * this.ratio, this.place(r, 0)[1]);
    }
  }

  words(ctx, text, colours) {
    ctx.fillStyle = colours.faint;
    ctx.font = FONT.replace("11px", `${12 * this.ratio}px`);
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    ctx.fillText(text, ...this.place(this.rows / 2 - 0.5, this.cols / 2 - 0.5));
  }

  /** Lines and crossings that something is wrong with: dashed around each. */
  mark(findings, colours) {
    const ctx = this.context;
    ctx.strokeStyle = colours.bad;
    ctx.lineWidth = 2 * this.ratio;
    ctx.setLineDash([5 * this.ratio, 3 * this.ratio]);
    const { left, top, cell, rows, cols, ratio } = this;
    const around = (x, y, w, h) => ctx.strokeRect(x + ratio, y + ratio, w - 2 * ratio, h - 2 * ratio);
    for (const found of findings) {
      const crossing = found.rows.length === 1 && found.cols.length === 1;
      for (const r of found.rows) {
        if (crossing) around(left + found.cols[0] * cell, top + r * cell, cell, cell);
        else around(left, top + r * cell, cell * cols, cell);
      }
      if (!crossing) {
        for (const c of found.cols) around(left + c * cell, top, cell, cell * rows);
      }
    }
    ctx.setLineDash([]);
  }

  /** The chosen cell. */
  choose(cell, colours) {
    const ctx = this.context;
    const [x, y] = [this.left + cell.col * this.cell, this.top + cell.row * this.cell];
    ctx.lineWidth = 3 * this.ratio;
    ctx.strokeStyle = colours.panel;
    ctx.strokeRect(x, y, this.cell, this.cell);
    ctx.lineWidth = 1.5 * this.ratio;
    ctx.strokeStyle = colours.text;
    ctx.strokeRect(x, y, this.cell, this.cell);
  }

  /**
   * Each contact: where it was, its id and force, its gesture if there is a name, and where it is in
   * half a second at its velocity.
   * @param trails id -> [[row, col], ...], the oldest first.
   */
  contacts(contacts, trails) {
    const ctx = this.context;
    const size = 13 * this.ratio;
    ctx.font = `600 ${size}px system-ui, sans-serif`;
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    for (const contact of contacts) {
      const from = this.place(contact.row, contact.col);
      this.trail(trails.get(contact.id) ?? []);
      const way = [0.5 * contact.way[1] * this.cell, 0.5 * contact.way[0] * this.cell];
      if (Math.hypot(...way) > 4 * this.ratio) {
        this.arrow(from, [from[0] + way[0], from[1] + way[1]], "#ffffff");
      }
      ctx.lineWidth = 3 * this.ratio;
      ctx.lineJoin = "round";
      ctx.strokeStyle = "#000000";
      ctx.fillStyle = "#ffffff";
      const lines = [`${contact.id}: ${contact.force.toFixed(1)} N`, contact.gesture];
      const y = Math.max(from[1] - 2.2 * size, this.top + size);
      lines.forEach((text, k) => {
        const half = ctx.measureText(text).width / 2;
        const x = Math.min(Math.max(from[0], this.left + half), this.canvas.width - half - 6);
        const at = [x, k ? from[1] + 2.2 * size : y];
        ctx.strokeText(text, ...at);
        ctx.fillText(text, ...at);
      });
    }
  }

  /** Places in turn, the latest of which is bright. */
  trail(places) {
    const ctx = this.context;
    ctx.lineCap = "round";
    for (let k = 1; k < places.length; k++) {
      ctx.globalAlpha = k / places.length;
      for (const [colour, width] of [["#000000", 5], ["#ffffff", 3]]) {
        ctx.strokeStyle = colour;
        ctx.lineWidth = width * this.ratio;
        ctx.beginPath();
        ctx.moveTo(...this.place(...places[k - 1]));
        ctx.lineTo(...this.place(...places[k]));
        ctx.stroke();
      }
    }
    ctx.globalAlpha = 1;
    ctx.lineCap = "butt";
  }

  /** The push: a ring around its centre, and what of it lies along the mat. */
  push(push) {
    const ctx = this.context;
    const centre = this.place(push.row, push.col);
    for (const [colour, width] of [["#000000", 4], ["#ff5fa2", 2]]) {
      ctx.strokeStyle = colour;
      ctx.lineWidth = width * this.ratio;
      ctx.beginPath();
      ctx.arc(...centre, 12 * this.ratio, 0, 2 * Math.PI);
      ctx.stroke();
    }
    const length = 3 * this.cell;
    const way = [push.way[1] * length, push.way[0] * length];
    if (Math.hypot(...way) > 6 * this.ratio) {
      this.arrow(centre, [centre[0] + way[0], centre[1] + way[1]], "#ff5fa2");
    }
  }

  arrow(from, to, colour) {
    const ctx = this.context;
    const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
    const head = 7 * this.ratio;
    for (const [paint, width] of [["#000000", 4], [colour, 2]]) {
      ctx.strokeStyle = paint;
      ctx.lineWidth = width * this.ratio;
      ctx.beginPath();
      ctx.moveTo(...from);
      ctx.lineTo(...to);
      for (const side of [-0.5, 0.5]) {
        ctx.moveTo(...to);
        ctx.lineTo(to[0] - head * Math.cos(angle + side), to[1] - head * Math.sin(angle + side));
      }
      ctx.stroke();
    }
  }
}
