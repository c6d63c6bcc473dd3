// A chart by uPlot of lines, points, bands and limits, each with its own x; a crosshair reads it, a legend names it.
import { colour, digits, large, make } from "./dom.js";

const { uPlot } = window;
const NAMED = [1, 2, 5, 10], FEW = 1e-6, FAR = 40, DECADE = 95;

// series: { name, hue, x, y, dash, width, points, bars: half lengths, band: [least, greatest], quiet: not in the legend }.
// range: [low, high] of y, or null; marks: limits { hz (null: everywhere), db }; sync: charts of one key share their crosshair.
export class Chart {
  // high: called for the height, where it follows the window.
  constructor(title, { height = 220, high = () => height, log = false, unit = "", range = null, role = "img", marks = [], sync = null, legend = true } = {}) {
    Object.assign(this, { high, log, unit, range, marks, sync, series: [], still: false });
    this.legend = make("ul", { class: "legend", hidden: legend ? null : "" });
    this.out = make("output", { class: "readout", "aria-hidden": "true" });
    this.host = make("div", { class: "plot", role, "aria-label": title });
    this.box = make("div", { class: "chart" }, make("div", { class: "head" }, make("h3", {}, title), this.out), this.host, this.legend);
    this.host.style.minHeight = `${high()}px`; // what is below does not move when the curves come
  }

  show(series) {
    this.series = series.filter((one) => one.x.length > 0);
    this.draw();
  }

  // The columns: every series at all places, undefined where it has none.
  columns() {
    const places = this.places = [...new Set(this.series.flatMap((one) => one.x))].sort((a, b) => a - b), index = new Map(places.map((x, i) => [x, i]));
    const spread = (x, y) => { const column = new Array(places.length).fill(undefined); x.forEach((at, i) => { column[index.get(at)] = y[i]; }); return column; };
    return [places, ...this.series.flatMap(({ x, y, band }) => (band ?? [y]).map((one) => spread(x, one)))];
  }

  draw() {
    const key = JSON.stringify(this.series.map(({ name, hue, dash, width, points, band }) => [name, hue, dash, width, points, Boolean(band)]));
    if (this.plot && this.key === key && this.series.length) { this.plot.setData(this.columns()); return; }
    this.plot?.destroy();
    this.plot = null; this.key = key;
    this.legend.replaceChildren(...this.series.filter((one) => one.name && !one.quiet).map(entry));
    if (!this.series.length) return;
    const data = this.columns(), lines = [{}], bands = [], clear = { stroke: "transparent", points: { show: false }, spanGaps: true };
    for (const { name, hue, dash, width, points, band } of this.series) {
      const stroke = colour(hue);
      if (band) { bands.push({ series: [lines.length + 1, lines.length], fill: colour("shade") }); lines.push(clear, { ...clear }); } else lines.push(points ? { label: name, stroke, paths: () => null, points: { show: true, size: 5, stroke, fill: stroke } }
        : { label: name, stroke, width: width ?? 1.8, dash: dash ?? [], points: { show: false }, spanGaps: true });
    }
    const size = large(), axis = { stroke: colour("faint"), grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("line"), width: 1, size: 4 }, font: `${11 * size}px system-ui` };
    const [low, high] = this.ends(), roomy = this.host.clientWidth / Math.log10(high / low || 10) > DECADE * size; // narrow: the powers of ten alone
    const named = (value) => (roomy ? NAMED : [1, 10]).some((one) => Math.abs(value / 10 ** Math.floor(Math.log10(value) + FEW) - one) < FEW);
    const texts = this.log ? (_, splits) => splits.map((one) => (one !== null && named(one) ? String(Number(one.toPrecision(2))) : "")) : (_, splits) => splits.map((one) => `${Math.round(one * 1000)}`);
    this.plot = new uPlot({
      width: Math.max(200, this.host.clientWidth || 500), height: this.high() * size, legend: { show: false }, bands, padding: [8, 14, 0, 0],
      cursor: { points: { show: false }, drag: { x: false, y: false }, ...(this.sync ? { sync: { key: this.sync, setSeries: false, scales: ["x", null] } } : {}) },
      scales: { x: { time: false, distr: this.log ? 3 : 1, range: () => this.ends() }, y: { range: (_, low, high) => this.limits(low, high) } },
      axes: [{ ...axis, size: 28 * size, values: texts, ...(this.log ? { filter: (_, splits) => splits } : {}) }, { ...axis, size: 48 * size }], series: lines,
      hooks: { draw: [(plot) => { this.drawMarks(plot); this.drawBars(plot); this.drawn?.(); }], setCursor: [(plot) => this.read(plot)] },
    }, data, this.host);
  }

  ends() { const [low, high] = [this.places[0] || (this.log ? 1 : 0), this.places.at(-1)]; return high > low ? [low, high] : [low / 2, 2 * low || 1]; }

  // The range of y; it does not change while something is held.
  limits(low, high) {
    if (this.still && this.held) return this.held;
    const more = 0.06 * (high - low) || 1;
    this.held = this.range ?? [low - more, high + more];
    return this.held;
  }

  // What the curves have at the crosshair: the value that lies nearest, of each that has a name.
  read(plot) {
    const { idx, left } = plot.cursor;
    if (idx === null || idx === undefined || left < 0) { this.out.textContent = ""; return; }
    const x = this.places[idx], found = [];
    let column = 1;
    for (const { name, band, quiet } of this.series) {
      const values = plot.data[column], near = Array.from({ length: FAR }, (_, i) => i).flatMap((i) => [idx - i, idx + i]).find((i) => values[i] !== undefined && values[i] !== null);
      column += band ? 2 : 1;
      if (name && !band && !quiet && near !== undefined) found.push(`${name.split(/[,:(]/)[0]} ${digits(values[near])}`);
    }
    this.out.textContent = `${this.log ? `${digits(x)} Hz` : `${digits(x * 1000)} ms`}: ${found.join(" · ")} ${this.unit}`;
    this.out.title = this.out.textContent;
  }

  drawMarks(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.strokeStyle = colour("limit");
    for (const { hz, db } of this.marks) {
      const y = plot.valToPos(db, "y", true);
      if (y < bbox.top || y > bbox.top + bbox.height) continue;
      const [from, to] = hz === null ? [bbox.left, bbox.left + bbox.width] : [plot.valToPos(hz / 1.15, "x", true), plot.valToPos(hz * 1.15, "x", true)];
      ctx.lineWidth = (hz === null ? 1 : 4) * devicePixelRatio;
      ctx.setLineDash(hz === null ? [6, 4] : []);
      ctx.beginPath(); ctx.moveTo(from, y); ctx.lineTo(to, y); ctx.stroke();
    }
    ctx.restore();
  }

  drawBars(plot) {
    const { ctx } = plot;
    ctx.save();
    for (const { x, y, bars, hue } of this.series) {
      if (!bars) continue;
      ctx.strokeStyle = colour(hue); ctx.lineWidth = 1.4 * devicePixelRatio;
      x.forEach((at, i) => {
        if (bars[i] === null || y[i] === null) return;
        const px = plot.valToPos(at, "x", true), [low, high] = [-1, 1].map((side) => plot.valToPos(y[i] + side * bars[i], "y", true)), cap = 3 * devicePixelRatio;
        ctx.beginPath(); ctx.moveTo(px, low); ctx.lineTo(px, high);
        for (const end of [low, high]) { ctx.moveTo(px - cap, end); ctx.lineTo(px + cap, end); }
        ctx.stroke();
      });
    }
    ctx.restore();
  }

  resize() {
    this.host.style.minHeight = `${this.high()}px`;
    if (this.plot && this.host.clientWidth) this.plot.setSize({ width: this.host.clientWidth, height: this.high() * large() });
  }
  restyle() { this.key = null; this.draw(); }
}

function entry({ name, hue, dash, points, band }) {
  const li = make("li", {}), mark = band ? `<rect width="26" height="10" fill="var(--shade)" stroke="var(--load)"/>`
    : points ? `<circle cx="13" cy="5" r="3" fill="var(--${hue})"/>` : `<path d="M0 5H26" fill="none" stroke="var(--${hue})" stroke-width="2.4" stroke-dasharray="${(dash ?? []).join(" ")}"/>`;
  li.innerHTML = `<svg viewBox="0 0 26 10" aria-hidden="true">${mark}</svg>`;
  li.append(name);
  return li;
}
