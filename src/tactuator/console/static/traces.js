// Traces over time on a canvas: for each column of the picture the least and the greatest of its samples.
import { COARSE, colour, digits, draggable, draw, large, make } from "./dom.js";

const HEADER = 64;
export const HUES = ["nominal", "load", "load2", "sense"];

// A frame of the server, see HEADER in scope.py.
export function frameOf(buffer) {
  const ints = new Uint32Array(buffer, 0, 4), rows = new Float64Array(buffer, 16, 4), counts = new Uint32Array(buffer, 48, 4);
  const [number, columns, series, values] = ints, [first, step, end, crossing] = rows, [dropped, lost, limited, done] = counts;
  return { number, columns, series, values, first, step, end, crossing, dropped, lost, limited, done: done === 1, data: new Float32Array(buffer, HEADER) };
}

// A number of the series 1, 2, 5 times a power of ten that is not less.
function nice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((one) => one * power).find((one) => one >= value * (1 - 1e-9));
}

export class Traces {
  // rows: [{ title, unit }], one for each signal; high: called for the height of them all, in units of the page's text.
  constructor(rows, high, label) {
    Object.assign(this, { rows, high, ranges: new Map(), scales: rows.map(() => null), apart: false, cursors: null, lines: [], hover: null, drawn: [] });
    this.canvas = make("canvas", { role: "img", "aria-label": label });
    this.marks = draw("svg", { class: "cursors" });
    this.pointer = draw("path", { class: "pointer" });
    this.marks.append(this.pointer);
    this.box = make("div", { class: "traces" }, this.canvas, this.marks);
    this.box.onpointermove = (event) => { this.hover = (event.clientX - this.box.getBoundingClientRect().left - this.left) / (this.width - this.left); this.place(); };
    this.box.onpointerleave = () => { this.hover = null; this.place(); };
    this.measure();
  }

  // Sizes that follow the page's text.
  measure() {
    const size = large();
    Object.assign(this, { size, total: this.high() * size, left: Math.round(56 * size), below: 20 * size });
  }

  get columns() { return Math.max(10, Math.min(2000, this.width - this.left)); }
  get width() { return Math.max(240, Math.floor(this.box.clientWidth || 600)); }

  fit() {
    this.measure();
    const { width } = this, height = this.total + this.below, ratio = devicePixelRatio || 1;
    if (this.canvas.width !== Math.round(width * ratio) || this.canvas.height !== Math.round(height * ratio)) {
      this.canvas.width = Math.round(width * ratio); this.canvas.height = Math.round(height * ratio);
      this.canvas.style.height = `${height}px`;
      this.marks.setAttribute("viewBox", `0 0 ${width} ${height}`);
    }
    const context = this.canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return context;
  }

  // The content of each row: a signal of all channels laid over each other, or of one channel.
  layout() {
    const shown = this.channels.map((one, k) => ({ ...one, k })).filter((one) => one.shown);
    const rows = this.rows.flatMap(({ title, unit }, signal) => (this.apart ? shown.map((one) => ({ signal, of: [one], title: `${one.name}, ${title} (${unit})` })) : [{ signal, of: shown, title: `${title} (${unit})` }]));
    const high = this.total / Math.max(1, rows.length);
    return rows.map((row, i) => ({ ...row, top: i * high + 14 * this.size, bottom: (i + 1) * high - 4 }));
  }

  // start, stop: rows of the picture's edges; zero: the row that is time 0.
  show(frame, channels, rate, start, stop, zero) {
    Object.assign(this, { frame, channels, rate, start, stop, zero });
    const context = this.fit();
    context.font = `${11 * this.size}px system-ui`;
    this.drawn = this.layout();
    this.drawn.forEach((row) => this.row(context, row));
    this.axis(context);
    this.place();
  }

  x(row) { return this.left + (row - this.start) / (this.stop - this.start) * (this.width - this.left); }

  row(context, { title, signal, of, top, bottom }) {
    const { frame, size } = this, [low, high] = this.range(title, signal, of), y = (value) => bottom - (value - low) / (high - low) * (bottom - top);
    context.fillStyle = colour("faint");
    context.fillText(title, this.left + 2, top - 4 * size);
    context.textAlign = "right";
    for (const value of bottom - top < 50 * size ? [low, high] : [low, (low + high) / 2, high]) {
      context.fillText(digits(value), this.left - 6, Math.min(bottom, Math.max(top + 8 * size, y(value) + 4 * size)));
      context.fillStyle = colour("grid"); context.fillRect(this.left, y(value), this.width - this.left, 1); context.fillStyle = colour("faint");
    }
    context.textAlign = "left";
    context.save();
    context.beginPath(); context.rect(this.left, top - 2, this.width - this.left, bottom - top + 4); context.clip();
    of.forEach(({ k }) => {
      context.strokeStyle = colour(HUES[k % HUES.length]); context.lineWidth = 1.4 * size;
      context.beginPath();
      const base = (signal * this.channels.length + k) * frame.columns * frame.values;
      for (let c = 0; c < frame.columns; c += 1) {
        const x = this.x(frame.first + (c + 0.5) * frame.step), least = frame.data[base + c * frame.values], most = frame.data[base + c * frame.values + frame.values - 1];
        if (Number.isNaN(least)) continue;
        context.lineTo(x, y(least));
        if (frame.values > 1) context.lineTo(x, y(most));
      }
      context.stroke();
    });
    context.restore();
  }

  // The scale of a row: the one that was chosen for its signal, or what its traces need.
  range(row, signal, of) {
    if (this.scales[signal]) return [-this.scales[signal], this.scales[signal]];
    this.ranges.set(row, this.needed(this.ranges.get(row), signal, of));
    return this.ranges.get(row);
  }

  needed(before, signal, of) {
    const { frame } = this;
    let low = Infinity, high = -Infinity;
    of.forEach(({ k }) => {
      const base = (signal * this.channels.length + k) * frame.columns * frame.values;
      for (let at = base; at < base + frame.columns * frame.values; at += 1) { const value = frame.data[at]; if (value < low) low = value; if (value > high) high = value; }
    });
    if (!(high >= low)) return before ?? [-1, 1];
    const middle = Math.abs(low + high) < 0.6 * (high - low) || high - low < 1e-9 ? 0 : (low + high) / 2;
    let half = nice(Math.max(high - middle, middle - low, 1e-3));
    if (before && low >= before[0] && high <= before[1] && half > 0.3 * (before[1] - before[0]) / 2) return before;
    for (;; half = nice(1.01 * half)) { // ticks are round numbers
      const centre = Math.round(2 * middle / half) * half / 2;
      if (low >= centre - half && high <= centre + half) return [centre - half, centre + half];
    }
  }

  axis(context) {
    const span = (this.stop - this.start) / this.rate, step = nice(span / 6), from = (this.start - this.zero) / this.rate, unit = span < 1 ? [1000, "ms"] : [1, "s"];
    const bottom = this.total;
    context.fillStyle = colour("faint"); context.textAlign = "center";
    for (let t = Math.ceil(from / step) * step; t <= from + span + 1e-9; t += step) {
      const x = this.x(this.zero + t * this.rate);
      context.fillStyle = colour("grid");
      for (const row of this.drawn) context.fillRect(x, row.top, 1, row.bottom - row.top); // what is written between the rows stays free
      context.fillStyle = colour("faint");
      if (x > this.left + 12 * this.size && x < this.width - 24 * this.size) context.fillText(`${Number((t * unit[0]).toPrecision(6))} ${unit[1]}`, x, bottom + 14 * this.size);
    }
    context.textAlign = "left";
    if (this.zero > this.start && this.zero < this.stop) { context.fillStyle = colour("limit"); context.fillRect(this.x(this.zero), 0, 1.5, bottom); }
  }

  // Two cursors, as shares of the picture; moved: called after each move.
  setCursors(on) {
    this.cursors = on ? this.cursors ?? [0.3, 0.7] : null;
    this.lines.forEach((line) => line.remove());
    this.lines = (this.cursors ?? []).map((_, k) => {
      const line = draw("g", { role: "slider", tabindex: "0", "aria-label": `cursor ${k + 1}`, class: "cursor" }, draw("rect", { width: COARSE ? 28 : 14, x: COARSE ? -14 : -7, y: 0, height: "100%", class: "grip" }), draw("path"));
      line.onkeydown = (event) => {
        const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
        if (by === undefined) return;
        event.preventDefault();
        this.move(k, this.cursors[k] + by * (event.shiftKey ? 0.05 : 1 / this.columns));
      };
      draggable(line, (event) => { line.setPointerCapture(event.pointerId); line.onpointermove = (to) => this.move(k, (to.clientX - this.box.getBoundingClientRect().left - this.left) / (this.width - this.left)); });
      line.onpointerup = () => { line.onpointermove = null; };
      this.marks.append(line);
      return line;
    });
    this.place();
  }

  move(k, share) { this.cursors[k] = Math.min(1, Math.max(0, share)); this.place(); }

  // Lines over the traces alone: what is written between the rows stays free.
  place() {
    if (!this.frame) return;
    const upright = this.drawn.map(({ top, bottom }) => `M0 ${top}V${bottom}`).join(""), x = (share) => this.left + share * (this.width - this.left), inside = this.hover !== null && this.hover >= 0 && this.hover <= 1;
    this.pointer.setAttribute("d", inside ? upright : "");
    this.pointer.setAttribute("transform", `translate(${x(this.hover ?? 0)} 0)`);
    (this.cursors ?? []).forEach((share, k) => {
      this.lines[k].lastChild.setAttribute("d", upright);
      this.lines[k].setAttribute("transform", `translate(${x(share)} 0)`);
      this.lines[k].setAttribute("aria-valuenow", share.toFixed(4));
      this.lines[k].setAttribute("aria-valuetext", `${digits(this.time(share) * 1000)} ms`);
    });
    this.moved?.();
  }

  time(share) { return (this.start + share * (this.stop - this.start) - this.zero) / this.rate; }

  // The middle of what a channel's signal is at a share of the picture.
  value(share, signal, channel) {
    const { frame } = this, column = Math.floor((this.start + share * (this.stop - this.start) - frame.first) / frame.step);
    if (column < 0 || column >= frame.columns) return NaN;
    const base = (signal * this.channels.length + channel) * frame.columns * frame.values + column * frame.values;
    return (frame.data[base] + frame.data[base + frame.values - 1]) / 2;
  }
}
