// A chart by uPlot of lines, points and bands that may stand at places of their own; its legend says what is what.
import { colour, large, make } from "./dom.js";

const { uPlot } = window;
const FEW = 1e-9;

// series: { name, hue, x, y, dash, width, points, band: [least, greatest] }; range: [low, high] of y, or null.
export class Chart {
  constructor(title, { height = 220, log = false, unit = "", range = null, role = "img" } = {}) {
    Object.assign(this, { height, log, unit, range, series: [] });
    this.legend = make("ul", { class: "legend" });
    this.host = make("div", { class: "plot", role, "aria-label": title });
    this.box = make("div", { class: "chart" }, make("h3", {}, title), this.legend, this.host);
  }

  show(series) {
    this.series = series.filter((one) => one.x.length > 0);
    this.draw();
  }

  draw() {
    this.plot?.destroy();
    this.plot = null;
    if (!this.series.length) return;
    const places = [...new Set(this.series.flatMap((one) => one.x))].sort((a, b) => a - b);
    const index = new Map(places.map((x, i) => [x, i]));
    const spread = (x, y) => { const column = new Array(places.length).fill(undefined); x.forEach((at, i) => { column[index.get(at)] = y[i]; }); return column; };
    const data = [places], lines = [{}], bands = [];
    for (const { name, hue, x, y, dash, width, points, band } of this.series) {
      if (band) {
        data.push(spread(x, band[0]), spread(x, band[1]));
        bands.push({ series: [lines.length + 1, lines.length], fill: colour("shade") });
        lines.push(...[0, 1].map(() => ({ stroke: "transparent", points: { show: false }, spanGaps: true })));
        continue;
      }
      data.push(spread(x, y));
      const stroke = colour(hue);
      lines.push(points ? { label: name, stroke, paths: () => null, points: { show: true, size: 4, stroke, fill: stroke } }
        : { label: name, stroke, width: width ?? 1.8, dash: dash ?? [], points: { show: false }, spanGaps: true });
    }
    const size = large(), axis = { stroke: colour("faint"), grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("line"), width: 1, size: 4 }, font: `${11 * size}px system-ui` };
    const tens = (_, splits) => splits.map((one) => (one !== null && Math.abs(Math.log10(one) - Math.round(Math.log10(one))) < FEW ? String(Number(one.toPrecision(1))) : ""));
    this.plot = new uPlot({
      width: Math.max(200, this.host.clientWidth || 500), height: this.height * size, legend: { show: false }, cursor: { show: false }, bands,
      scales: { x: { time: false, distr: this.log ? 3 : 1, range: [places[0], places.at(-1)] }, y: { range: (_, low, high) => this.range ?? widened(low, high) } },
      axes: [{ ...axis, size: 28 * size, ...(this.log ? { values: tens } : {}) }, { ...axis, size: 52 * size }], series: lines,
      hooks: { draw: [() => this.drawn?.()] },
    }, data, this.host);
    this.legend.replaceChildren(...this.series.filter((one) => one.name).map(({ name, hue, dash, points, band }) => entry(name, hue, dash, points, band)));
  }

  resize() { if (this.plot && this.host.clientWidth) this.plot.setSize({ width: this.host.clientWidth, height: this.height * large() }); }
  restyle() { this.draw(); }
}

const widened = (low, high) => { const more = 0.06 * (high - low) || 1; return [low - more, high + more]; };

function entry(name, hue, dash, points, band) {
  const li = make("li", {}), mark = band ? `<rect width="26" height="10" fill="var(--shade)" stroke="var(--load)"/>`
    : points ? `<circle cx="13" cy="5" r="3" fill="var(--${hue})"/>` : `<path d="M0 5H26" fill="none" stroke="var(--${hue})" stroke-width="2.4" stroke-dasharray="${(dash ?? []).join(" ")}"/>`;
  li.innerHTML = `<svg viewBox="0 0 26 10" aria-hidden="true">${mark}</svg>`;
  li.append(name);
  return li;
}
