// The loop's curves over frequency and over time; bands are the least and greatest of the family.
import { Chart } from "./chart.js";

const HUES = ["nominal", "load", "load2"];
const RANGES = { gain_db: [-60, 60], s_db: [-50, 15], t_db: [-60, 15] };

export class Plots {
  constructor(basis) {
    const { limits } = basis.ground, bars = (pairs) => pairs.map(([hz, db]) => ({ hz, db }));
    const over = (title, height, name, marks = []) => new Chart(`${title} (dB) over frequency (Hz)`, { height, log: true, unit: "dB", range: RANGES[name], marks, sync: "loop", legend: false, role: name === "gain_db" ? "group" : "img" });
    const inTime = (title) => new Chart(`${title} over time (ms)`, { height: 104, unit: "V", sync: "time", legend: false });
    this.basis = basis;
    this.names = basis.loads.map((load) => (load === "none" ? "no load" : load));
    this.open = over("Open loop |L|", 160, "gain_db");
    this.sense = over("Sensitivity |S|", 112, "s_db", [...bars(limits.s_db), ...(limits.s_peak_db === null ? [] : [{ hz: null, db: limits.s_peak_db }])]);
    this.closed = over("Complementary sensitivity |T|", 112, "t_db", [...bars(limits.t_db), { hz: null, db: limits.t_peak_db }]);
    this.asked = inTime("Step of 1 V (V)");
    this.pushed = inTime("Press of 1 V (V)");
    this.all = [this.open, this.sense, this.closed, this.asked, this.pushed];
  }

  // kept: curves of kept designs. A loop that is unstable has no steps.
  show(frame, kept) {
    const { frequency_hz: x, time_s: t } = this.basis, family = (at, band) => (band ? [{ name: "family", hue: "shade", quiet: true, x: at, band }] : []);
    for (const [chart, name] of [[this.open, "gain_db"], [this.sense, "s_db"], [this.closed, "t_db"]]) {
      chart.show([...family(x, frame.envelope?.[name]), ...frame.curves.map((one, i) => ({ name: this.names[i], hue: HUES[i] ?? "load", x, y: one[name], dash: i ? [7, 4] : [] })),
        ...kept.map((one) => ({ name: "", hue: "kept", x, y: one[name], dash: [2, 3], width: 1.2 }))]);
    }
    for (const name of ["asked", "pushed"]) {
      const { curves, envelope } = frame.steps[name], ends = (envelope ?? curves.filter(Boolean)).flat().filter((one) => Math.abs(one) < (name === "asked" ? 3 : 1e3));
      const low = Math.min(0, ...ends), high = Math.max(name === "asked" ? 1.2 : 1e-3, ...ends);
      this[name].range = [low - 0.05 * (high - low), high + 0.05 * (high - low)];
      this[name].show([...family(t, envelope), ...curves.map((y, i) => ({ name: this.names[i], hue: HUES[i] ?? "load", x: y ? t : [], y, dash: i ? [7, 4] : [] }))]);
    }
  }

  resize() { this.all.forEach((one) => one.resize()); }
  restyle() { this.all.forEach((one) => one.restyle()); }
}
