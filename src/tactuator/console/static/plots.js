// Curves over frequency and over time, drawn by uPlot; bands are the least and greatest of the family.
import { colour, large, make } from "./dom.js";

const { uPlot } = window;
const HUES = ["nominal", "load", "load2"];

export class Plot {
  constructor(title, height, scaleX, x) {
    Object.assign(this, { height, scaleX, x, marks: [] });
    this.box = make("div", { class: "plot" });
    this.title = make("h3", {}, title);
    this.box.append(this.title);
  }

  // series: [{ name, hue, dash, width, values, band }]; band: [least, greatest].
  show(series, range) {
    this.last = series;
    const data = [this.x, ...series.flatMap((one) => (one.band ? [one.band[0], one.band[1]] : [one.values]))];
    const key = series.map((one) => one.name).join();
    if (this.plot && this.key === key) { this.range = range; this.plot.setData(data); return; }
    this.plot?.destroy();
    this.key = key; this.range = range;
    const lines = [{}], bands = [];
    for (const one of series) {
      const stroke = colour(one.hue);
      if (one.band) {
        bands.push({ series: [lines.length + 1, lines.length], fill: colour("shade") });
        lines.push({ stroke: "transparent", points: { show: false } }, { stroke: "transparent", points: { show: false } });
      } else lines.push({ label: one.name, stroke, width: one.width ?? 1.8, dash: one.dash ?? [], points: { show: false } });
    }
    const size = large(), axis = { stroke: colour("faint"), grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("line"), width: 1, size: 4 }, font: `${11 * size}px system-ui` };
    const log = this.scaleX === "hz";
    const powers = (_, splits) => splits.map((one) => (one === null ? "" : Number.isInteger(Math.log10(one) * 1e6 | 0) && Math.abs(Math.log10(one) % 1) < 1e-9 ? String(one) : ""));
    this.plot = new uPlot({
      width: Math.max(200, this.box.clientWidth || 500), height: this.height * size, legend: { show: false }, cursor: { show: false }, bands,
      scales: { x: { time: false, distr: log ? 3 : 1, range: [this.x[0] || 0, this.x.at(-1)] }, y: { range: (_, low, high) => this.range ?? [low, high] } },
      axes: [{ ...axis, size: 28 * size, values: log ? powers : (_, splits) => splits.map((one) => `${Math.round(one * 1000)}`) }, { ...axis, size: 44 * size }],
      series: lines,
      hooks: { draw: [(plot) => { this.limits(plot); this.drawn?.(); }] },
    }, data, this.box);
  }

  limits(plot) {
    const { ctx } = plot;
    ctx.save();
    ctx.strokeStyle = colour("limit");
    for (const { hz, db } of this.marks) {
      const y = plot.valToPos(db, "y", true);
      if (y < plot.bbox.top || y > plot.bbox.top + plot.bbox.height) continue;
      const [from, to] = hz === null ? [plot.bbox.left, plot.bbox.left + plot.bbox.width] : [plot.valToPos(hz / 1.15, "x", true), plot.valToPos(hz * 1.15, "x", true)];
      ctx.lineWidth = (hz === null ? 1 : 4) * devicePixelRatio;
      ctx.setLineDash(hz === null ? [6, 4] : []);
      ctx.beginPath(); ctx.moveTo(from, y); ctx.lineTo(to, y); ctx.stroke();
    }
    ctx.restore();
  }

  resize() { if (this.plot && this.box.clientWidth) this.plot.setSize({ width: this.box.clientWidth, height: this.height * large() }); }
  restyle() { this.key = null; if (this.last) this.show(this.last, this.range); }
}

const each = (frame, loads, pick, dashes = true) => frame.curves.map((one, i) => ({ name: `${pick} ${loads[i]}`, hue: HUES[i] ?? "load", values: one[pick], dash: dashes && i ? [7, 4] : [] }));
const band = (envelope, name) => (envelope ? [{ name: `${name} family`, hue: "shade", band: envelope[name] }] : []);

export class Plots {
  constructor(basis) {
    const { limits } = basis.ground;
    this.basis = basis;
    this.open = new Plot("Open loop |L| (dB) over frequency (Hz)", 230, "hz", basis.frequency_hz);
    this.sense = new Plot("Sensitivity |S| (dB) over frequency (Hz)", 190, "hz", basis.frequency_hz);
    this.closed = new Plot("Complementary sensitivity |T| (dB) over frequency (Hz)", 190, "hz", basis.frequency_hz);
    this.asked = new Plot("Step of 1 V at the loop’s input: position (V) over time (ms)", 150, "s", basis.time_s);
    this.pushed = new Plot("Press, as 1 V added to the command: position (V) over time (ms)", 150, "s", basis.time_s);
    const bars = (pairs) => pairs.map(([hz, db]) => ({ hz, db }));
    this.sense.marks = [...bars(limits.s_db), ...(limits.s_peak_db === null ? [] : [{ hz: null, db: limits.s_peak_db }])];
    this.closed.marks = [...bars(limits.t_db), { hz: null, db: limits.t_peak_db }];
    this.all = [this.open, this.sense, this.closed, this.asked, this.pushed];
  }

  show(frame, kept) {
    const { loads } = this.basis, old = (pick) => kept.map((one, i) => ({ name: `kept ${i} ${pick}`, hue: "kept", values: one[pick], dash: [2, 3], width: 1.2 }));
    this.open.show([...band(frame.envelope, "gain_db"), ...each(frame, loads, "gain_db"), ...old("gain_db")], [-60, 60]);
    this.sense.show([...band(frame.envelope, "s_db"), ...each(frame, loads, "s_db"), ...old("s_db")], [-50, 15]);
    this.closed.show([...band(frame.envelope, "t_db"), ...each(frame, loads, "t_db"), ...old("t_db")], [-60, 15]);
    for (const name of ["asked", "pushed"]) {
      const { curves, envelope } = frame.steps[name];
      const lines = curves.map((values, i) => ({ name: loads[i], hue: HUES[i] ?? "load", values, dash: i ? [7, 4] : [] }));
      const ends = (envelope ?? curves).flat().filter((one) => Math.abs(one) < (name === "asked" ? 3 : 1e3));
      const low = Math.min(0, ...ends), high = Math.max(name === "asked" ? 1.2 : 1e-3, ...ends);
      this[name].show([...(envelope ? [{ name: "family", hue: "shade", band: envelope }] : []), ...lines], [low - 0.05 * (high - low), high + 0.05 * (high - low)]);
    }
  }

  resize() { this.all.forEach((one) => one.resize()); }
  restyle() { this.all.forEach((one) => one.restyle()); }
}
