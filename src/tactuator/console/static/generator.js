// The generator: tone, noise, sweep or a reference file, at a level in dB SL.
import { make } from "./dom.js";
import { Drop } from "./drop.js";
import { term } from "./words.js";

const KINDS = { tone: "tone", noise: "noise over the band", sweep: "sweep, up and down", file: "reference file" };
const FIELDS = { tone: ["frequency"], noise: [], sweep: ["frequency", "to", "seconds"], file: ["file"] };

export class GeneratorPanel {
  constructor(rig, channels) {
    Object.assign(this, { rig, channels, key: "" });
    const changed = () => { this.fields(); if (this.rig.standing?.wave) this.play(); };
    const number = (id, value, more = {}) => make("input", { type: "number", step: "any", id, value, onchange: changed, ...more });
    this.kind = make("select", { id: "wave", onchange: changed }, ...Object.entries(KINDS).map(([value, text]) => make("option", { value }, text)));
    this.level = number("wave-level", "20", { step: "1" });
    this.inputs = { frequency: number("wave-hz", "100"), to: number("wave-to", "300"), seconds: number("wave-s", "5"), file: null };
    this.on = channels.map((one, k) => make("input", { type: "checkbox", id: `wave-on-${one.name}`, checked: k === 0 ? "" : null, onchange: changed }));
    this.start = make("button", { type: "button", id: "play", class: "first", onclick: () => (this.rig.standing.wave ? this.rig.do("stop") : this.play()) }, "Play");
    this.most = make("small", { id: "wave-most" });
    this.now = make("p", { id: "wave-now", role: "status" });
    const labels = { frequency: "Hz", to: "to Hz", seconds: "s one way" };
    const drop = new Drop(rig.link, { label: "reference that render wrote", accept: ".wav,.h5,.hdf5", taken: (key) => { this.key = key; } });
    drop.input.id = "wave-file";
    this.boxes = Object.fromEntries(Object.entries(this.inputs).map(([name, input]) => [name, input ? make("label", {}, `${labels[name]} `, input) : drop.box]));
    this.box = make("div", { class: "panel" }, make("h2", {}, "Generator"),
      make("div", { class: "bar" }, make("label", {}, "wave ", this.kind), make("label", {}, "level ", this.level), term("sensation level", "dB SL"), this.most, ...Object.values(this.boxes)),
      make("div", { class: "bar" }, ...channels.map((one, k) => make("label", {}, this.on[k], ` ${one.name}`)), this.start), this.now);
    this.fields();
  }

  fields() {
    for (const [name, box] of Object.entries(this.boxes)) box.hidden = !FIELDS[this.kind.value].includes(name);
    const most = this.rig.standing?.most_db_sl[this.kind.value];
    this.most.textContent = most === undefined ? "" : `at most ${most}`;
  }

  play() {
    const { frequency, to, seconds } = this.inputs, channels = this.channels.filter((_, k) => this.on[k].checked).map((one) => one.name);
    return this.rig.do("wave", { kind: this.kind.value, level_db_sl: Number(this.level.value), channels, frequency_hz: Number(frequency.value), to_hz: Number(to.value), sweep_s: Number(seconds.value), file: this.kind.value === "file" ? this.key : "" });
  }

  standing() {
    const { rig } = this, { wave, mode } = rig.standing;
    this.start.disabled = !rig.mayPlay || mode !== "live";
    this.start.textContent = wave ? "Silence" : "Play";
    this.now.textContent = wave ? `${wave.kind} at ${wave.level_db_sl} dB SL on ${wave.channels.join(", ")}${wave.kind === "tone" ? `, ${wave.frequency_hz} Hz` : ""}` : rig.experiment ? "an experiment has the rig" : mode === "live" ? "silent" : "not live: “Live” begins";
    this.fields();
  }
}
