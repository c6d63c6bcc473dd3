// The generator: tone, noise, sweep or a reference file, at a level in dB SL.
import { lasting, make, numberIn, put } from "./dom.js";
import { Drop } from "./drop.js";
import { term } from "./words.js";

const KINDS = { tone: "tone", noise: "noise over the band", sweep: "sweep, up and down", file: "reference file" };
const FIELDS = { tone: ["frequency"], noise: [], sweep: ["frequency", "to", "seconds"], file: ["file"] };

// The file, and level and fingers of a file and of other waves: they outlive the view.
const kept = { key: "", name: "", of: {} };

export class GeneratorPanel {
  constructor(rig, channels) {
    Object.assign(this, { rig, channels });
    const changed = () => { this.fields(); if (this.rig.standing?.wave) this.play(); };
    const number = (id, value, more = {}) => lasting(make("input", { type: "number", step: "any", id, value, onchange: changed, ...more }));
    this.kind = lasting(make("select", { id: "wave", onchange: () => { this.turn(); changed(); } }, ...Object.entries(KINDS).map(([value, text]) => make("option", { value }, text))));
    this.level = number("wave-level", "20", { step: "1" });
    this.inputs = { frequency: number("wave-hz", "100", { min: "0.1" }), to: number("wave-to", "300", { min: "0.1" }), seconds: number("wave-s", "5", { min: "0.1" }), file: null };
    this.on = channels.map((one, k) => lasting(make("input", { type: "checkbox", id: `wave-on-${one.name}`, checked: k === 0 ? "" : null, onchange: changed })));
    this.start = make("button", { type: "button", id: "play", class: "first", onclick: () => (this.rig.standing.wave ? this.rig.do("stop") : this.play()) }, "Play");
    this.most = make("small", { id: "wave-most" });
    this.now = make("p", { id: "wave-now", role: "status" });
    const labels = { frequency: "Hz", to: "to Hz", seconds: "s one way" };
    const drop = new Drop(rig.link, { label: "reference that render wrote", accept: ".wav,.h5,.hdf5", taken: (key, name) => this.take(key, name) });
    drop.input.id = "wave-file";
    drop.name.textContent = kept.name;
    this.boxes = Object.fromEntries(Object.entries(this.inputs).map(([name, input]) => [name, input ? make("label", {}, `${labels[name]} `, input) : drop.box]));
    this.box = make("div", { class: "panel" }, make("h2", {}, "Generator"),
      make("div", { class: "bar" }, make("label", {}, "wave ", this.kind), make("label", {}, "level ", this.level), term("sensation level", "dB SL"), this.most, ...Object.values(this.boxes)),
      make("div", { class: "bar" }, ...channels.map((one, k) => make("label", {}, this.on[k], ` ${one.name}`)), this.start), this.now);
    this.isFile = this.kind.value === "file";
    this.fields();
  }

  // A file has its own level and fingers, a tone those that were put in.
  turn() {
    const file = this.kind.value === "file", now = [this.level.value, this.on.map((box) => box.checked)];
    if (file === this.isFile) return;
    kept.of[this.isFile] = now;
    this.isFile = file;
    this.set(...(kept.of[file] ?? now));
  }

  set(level, on) {
    put(this.level, level);
    this.on.forEach((box, k) => { box.checked = on[k]; });
    for (const field of [this.level, ...this.on]) field.remember();
  }

  async take(key, name) {
    const { peaks } = await this.rig.link.ask("peaks", { file: key }), most = Math.max(...Object.values(peaks));
    Object.assign(kept, { key, name });
    this.set(most > 0 ? (20 * Math.log10(most)).toFixed(2) : "0", this.channels.map(({ name: channel }) => peaks[channel] > 0));
  }

  fields() {
    for (const [name, box] of Object.entries(this.boxes)) box.hidden = !FIELDS[this.kind.value].includes(name);
    const most = this.rig.standing?.most_db_sl[this.kind.value];
    this.most.textContent = most === undefined ? "" : `at most ${most}`;
    this.level.max = most ?? "";
  }

  // Fields that are hidden are none of this wave's.
  play() {
    const { frequency, to, seconds } = this.inputs, kind = this.kind.value, names = { level_db_sl: this.level, ...(FIELDS[kind].includes("frequency") ? { frequency_hz: frequency } : {}), ...(kind === "sweep" ? { to_hz: to, sweep_s: seconds } : {}) };
    const numbers = Object.fromEntries(Object.entries(names).map(([name, field]) => [name, numberIn(field)]));
    if (Object.values(numbers).some(Number.isNaN)) return null;
    return this.rig.do("wave", { wave: { kind, ...numbers, channels: this.channels.filter((_, k) => this.on[k].checked).map((one) => one.name), file: kind === "file" ? kept.key : "" } });
  }

  standing() {
    const { rig } = this, { wave, mode } = rig.standing;
    this.start.disabled = !rig.mayPlay || mode !== "live";
    this.start.textContent = wave ? "Silence" : "Play";
    this.now.textContent = wave ? `${wave.kind} at ${Number(wave.level_db_sl.toFixed(1))} dB SL on ${wave.channels.join(", ")}${wave.kind === "tone" ? `, ${wave.frequency_hz} Hz` : ""}` : rig.has || mode === "live" ? "silent" : "not live: “Live” begins";
    this.fields();
  }
}
