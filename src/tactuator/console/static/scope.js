// The scope: what a rig does, as it does it, with a generator and a finger.
import { Chart } from "./chart.js";
import { banner, digits, make, numberIn, refusal, saved } from "./dom.js";
import { Finger } from "./finger.js";
import { GeneratorPanel } from "./generator.js";
import { Loader } from "./loader.js";
import { connected } from "./rig.js";
import { HUES, Traces, frameOf } from "./traces.js";

const SPANS = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30];
const MODES = { roll: "rolling", auto: "trigger or roll", normal: "trigger only", single: "single shot" };
const ROWS = [{ title: "reference", unit: "thresholds" }, { title: "command", unit: "V" }, { title: "position", unit: "V of the sensor" }];
const LEVELS = 300, SECOND_MS = 1200, NOTHING_DB = -119, AT_LIMIT = 0.97, SCALES = [0.01, 0.1, 1, 10, 100, 1000];

export default class Scope {
  constructor(view, link, state) {
    Object.assign(this, { view, link, state, frames: [], levels: [], held: null, last: null, hidden: new Set(), limit: { from: null, at: 0, when: -Infinity } });
    window.scopeFrames = this.frames; // the time at which each was drawn, for the benchmark
    window.scopeLast = null;
  }

  async open() {
    this.rig = await connected(this.view, "Scope", (rig) => { this.rig = rig; this.build(); }, () => this.standing(), (message) => this.pushed(message));
  }

  close() {
    if (this.wanted && this.rig.open) this.rig.link.ask("look", { look: { ...this.wanted, mode: "off" } }).catch(() => {});
    this.rig?.close();
  }

  build() {
    this.built = true;
    const { display, channels, rate_hz: rate } = this.rig.standing;
    this.channels = channels.map((one) => ({ ...one, shown: true }));
    this.rate = rate;
    this.traces = new Traces(ROWS, () => Math.max(270, innerHeight - 484), "Reference, command and position of every channel over time");
    this.traces.moved = () => this.readings();
    this.strip = new Traces([{ title: "level at the sensor, last half minute", unit: "dB SL" }], () => 90, "Level at the sensor of every channel over the last half minute");
    this.spectrum = new Chart("Sensor’s spectrum (dB SL) over frequency (Hz)", { high: () => Math.max(170, innerHeight - 644), log: true, unit: "dB SL", range: [-40, 60], marks: [{ hz: null, db: 0 }], legend: false });
        this.live = make("button", { type: "button", id: "live", class: "first", onclick: () => this.rig.do("live") }, "Live");
    this.loader = new Loader(this.rig, this.link, this.state, make("h1", {}, `Scope of ${display}`), this.live);
    this.generator = new GeneratorPanel(this.rig, channels);
    this.finger = new Finger(this.rig, channels);
    this.bits = { tiles: make("dl", { class: "tiles", id: "levels" }), cursors: make("p", { id: "cursor-values", "aria-live": "off" }), counts: make("p", { id: "counts" }) };
    this.view.replaceChildren(make("div", { class: "workbench" }, this.loader.box, this.rig.bar, this.traceBar(),
      make("div", { class: "screen" }, make("div", { class: "panel" }, this.traces.box, this.bits.cursors, this.bits.counts), make("div", { class: "panel" }, this.bits.tiles, this.spectrum.box, this.strip.box)),
      make("div", { class: "drives" }, this.generator.box, this.finger.box)));
    this.view.onkeydown = (event) => { if (event.key === " " && !["INPUT", "SELECT", "BUTTON", "A", "TEXTAREA"].includes(event.target.tagName)) { event.preventDefault(); this.pause(); } };
    this.tiles(null);
    this.look();
  }

  traceBar() {
    const option = (value, text, chosen) => make("option", { value, selected: value === chosen ? "" : null }, text), again = () => { this.held = null; this.look(); };
    const select = (id, entries, chosen, onchange = again) => make("select", { id, onchange }, ...entries.map(([value, text]) => option(value, text, chosen)));
    const labelled = (text, node) => make("label", {}, `${text} `, node);
    this.span = select("span", SPANS.map((one) => [String(one), one < 1 ? `${one * 1000} ms` : `${one} s`]), "0.2");
    this.mode = select("mode", Object.entries(MODES), "roll", () => { this.trigger.hidden = this.mode.value === "roll"; again(); });
    this.source = select("trigger-channel", this.channels.map((one) => [one.name, one.name]), this.channels[0].name);
    this.signal = select("trigger-signal", this.rig.standing.signals.map((one) => [one, one]), "position");
    this.edge = select("trigger-edge", [["rising", "rising"], ["falling", "falling"]], "rising");
    this.level = make("input", { type: "number", id: "trigger-level", step: "any", value: "0", onchange: again });
    this.paused = make("button", { type: "button", id: "pause", "aria-pressed": "false", onclick: () => this.pause(), title: "Space" }, "Pause");
    const shoot = make("button", { type: "button", id: "single", onclick: () => { this.mode.value = "single"; this.trigger.hidden = false; again(); } }, "Single shot");
    const cursors = make("button", { type: "button", id: "cursors", "aria-pressed": "false", onclick: () => { const on = cursors.getAttribute("aria-pressed") === "false"; cursors.setAttribute("aria-pressed", String(on)); this.traces.setCursors(on); this.readings(); } }, "Cursors");
    const save = make("button", { type: "button", id: "save-record", onclick: () => this.save() }, "Save as a record");
    const apart = select("apart", [["", "laid over"], ["1", "apart"]], "", () => { this.traces.apart = apart.value !== ""; this.redraw(); });
    const scales = ROWS.map(({ title }, i) => select(`scale-${title}`, [["", "auto"], ...SCALES.map((one) => [String(one), `±${one}`])], "", (event) => { this.traces.scales[i] = Number(event.target.value) || null; this.redraw(); }));
    const names = this.channels.map((one, k) => make("button", { type: "button", class: `legend-${k % HUES.length}`, "aria-pressed": "true", onclick: (event) => { one.shown = !one.shown; event.target.setAttribute("aria-pressed", String(one.shown)); this.redraw(); } }, one.name));
    this.trigger = make("span", { class: "bar", hidden: "" }, labelled("trigger on", this.source), labelled("signal", this.signal), labelled("level", this.level), labelled("edge", this.edge));
    return make("div", { class: "bar strip" }, this.paused, shoot, cursors, save, labelled("span", this.span), labelled("picture", this.mode), this.trigger, ...names, labelled("channels", apart), ...scales.map((one, i) => labelled(i ? ROWS[i].title : "scale: reference", one)));
  }

  get seconds() { return Number(this.span.value); }

  look() {
    const hold = this.held !== null, mode = hold ? "hold" : this.mode.value, level = numberIn(this.level);
    if (!this.rig.open || Number.isNaN(level)) return;
    this.wanted = { span_s: this.seconds, columns: this.traces.columns, mode, channel: this.source.value, signal: this.signal.value, level, edge: this.edge.value, share: 0.2, end: hold ? this.held : 0 };
    this.rig.link.ask("look", { look: this.wanted }).catch(refusal);
  }

  pause() {
    this.held = this.held === null ? this.last?.end ?? 0 : null;
    this.paused.setAttribute("aria-pressed", String(this.held !== null));
    this.paused.dataset.row = this.held ?? "";
    this.paused.textContent = this.held === null ? "Pause" : "Go on";
    this.look();
  }

  pushed(message) {
    if (message.levels !== undefined) this.felt(message.levels);
    if (message.frame === undefined) return false;
    this.waiting = frameOf(message.frame);
    if (!this.asked) { this.asked = true; requestAnimationFrame(() => { this.asked = false; this.draw(this.waiting); }); }
    return true;
  }

  draw(frame) {
    this.last = window.scopeLast = frame;
    const { limit } = this;
    limit.from ??= frame.limited;
    if (frame.limited > limit.at && limit.at >= limit.from) limit.when = performance.now();
    limit.at = frame.limited;
    this.redraw();
    this.frames.push(performance.now());
    this.rig.drawn(frame.number);
    if (frame.done && this.held === null && this.wanted.mode === "single" && !this.shot) { this.shot = true; this.paused.textContent = "Again"; }
  }

  redraw() {
    const frame = this.last;
    if (!frame) return;
    const rows = this.seconds * this.rate, triggered = !Number.isNaN(frame.crossing) && this.held === null;
    const stop = triggered ? frame.crossing + 0.8 * rows : this.held ?? frame.end;
    this.traces.show(frame, this.channels, this.rate, stop - rows, stop, triggered ? frame.crossing : stop);
    this.bits.counts.textContent = `${frame.end} samples a channel · ${frame.lost} lost · ${frame.dropped} pictures left out · ${this.limit.at - this.limit.from} at a limit since Live`;
    this.bits.counts.append(...(this.saturated ? [" · ", make("strong", { class: "crossed" }, "saturated")] : []));
    this.readings();
  }

  get saturated() { return performance.now() - this.limit.when < SECOND_MS; }

  // At the two cursors, and at the pointer.
  readings() {
    const { traces } = this, read = [], k = Math.max(0, this.channels.findIndex((one) => one.name === this.source.value));
    if (!traces.frame) return;
    const at = (share) => ROWS.map(({ title, unit }, i) => `${title} ${digits(traces.value(share, i, k))} ${unit.split(" ")[0]}`).join(", ");
    if (traces.cursors) {
      const [first, second] = traces.cursors, apart = traces.time(second) - traces.time(first);
      read.push(`cursors: ${digits(apart * 1000)} ms apart, ${digits(1 / Math.abs(apart))} Hz · ${this.channels[k].name}: ${at(first)} and ${at(second)}`);
    }
    if (traces.hover !== null) read.push(`pointer: ${digits(traces.time(traces.hover) * 1000)} ms, ${this.channels[k].name}: ${at(traces.hover)}`);
    this.bits.cursors.textContent = read.join(" · ");
  }

  felt(levels) {
    if (!levels || !["live", "listening", "presenting"].includes(this.rig.standing.mode)) return;
    if (performance.now() - this.still < SECOND_MS) { this.tiles(null); return; } // that second holds what was played before
    const { level_db_sl: level, spectrum_db_sl: spectrum } = levels;
    this.levels.push(level);
    if (this.levels.length > LEVELS) this.levels.shift();
    this.tiles(levels);
    this.spectrum.show(this.channels.flatMap((one, k) => (one.shown ? [{ name: one.name, hue: HUES[k % HUES.length], x: this.frequency, y: spectrum[k] }] : [])));
    const columns = this.levels.length, data = new Float32Array(columns * this.channels.length);
    this.levels.forEach((values, c) => values.forEach((value, k) => { data[k * columns + c] = value; }));
    this.strip.show({ first: LEVELS - columns, step: 1, columns, values: 1, data }, this.channels, 8, 0, LEVELS, LEVELS);
  }

  // What is played is shown as a level; with nothing played, the signal is the sensor's own and is not felt.
  tiles(levels) {
    const { wave, mode } = this.rig.standing, nothing = { live: "the first second", measuring: "the view Response measures" }[mode] ?? "nothing is played";
    this.bits.tiles.replaceChildren(...this.channels.map((one, k) => {
      const plays = wave?.channels.includes(one.name), tone = levels?.tone_db_sl[k] ?? null;
      if (!levels) return make("div", {}, make("dt", {}, one.name), make("dd", {}, "—", make("small", {}, nothing)));
      const mean = levels.command_mean_v[k], read = `mean command ${mean.toFixed(3)} V`;
      if (levels.level_db_sl[k] < NOTHING_DB || Math.abs(mean) > AT_LIMIT * one.range_v) return make("div", { class: "not-met" }, make("dt", {}, one.name), make("dd", {}, "saturated", make("small", {}, "no level is true there"), make("small", {}, read)));
      const strongest = `${digits(levels.peak_hz[k])} Hz: ${levels.peak_db_sl[k].toFixed(1)} dB SL`, all = `${levels.level_db_sl[k].toFixed(1)} dB SL`;
      return make("div", { class: plays ? "met" : "" }, make("dt", {}, one.name), make("dd", {}, plays && tone !== null ? `${tone.toFixed(1)} dB SL` : all,
        make("small", {}, plays ? tone === null ? "all that is played" : `at the tone; all ${all}` : "sensor hum and noise"), make("small", {}, strongest), make("small", {}, read)));
    }));
  }

  standing() {
    const { rig, live } = this, one = rig.standing, began = one.mode !== this.before?.mode, sounds = Boolean(one.wave);
    this.frequency = one.frequency_hz; // that of the controller's curve
    if (began || (this.before?.sounds && !sounds)) this.still = one.mode === "live" && !sounds ? performance.now() : -Infinity;
    if (began) { this.tiles(null); if (one.mode === "live") this.limit = { from: null, at: 0, when: -Infinity }; }
    this.before = { mode: one.mode, sounds };
    if (!this.last) this.bits.counts.textContent = rig.has ? `Nothing runs yet: ${rig.has}.` : one.loaded ? "Nothing runs yet: Live begins." : "Nothing runs yet: load a controller, then Live.";
    live.textContent = one.mode === "live" ? "● Live" : "Live";
    live.setAttribute("aria-pressed", String(one.mode === "live"));
    live.disabled = !rig.open || rig.watches || rig.loading > 0 || !one.loaded || ["live", "gone"].includes(one.mode);
    this.loader.standing();
    this.generator.standing();
    this.finger.standing();
    if (rig.open && !this.connected) this.look();
    this.connected = rig.open;
  }

  async save() {
    const end = this.held ?? this.last?.end ?? 0, channel = this.source.value;
    try {
      const { text, name } = await this.rig.link.ask("save", { channel, span_s: this.seconds, end });
      saved("", name, text, "text/csv").click();
      banner("");
    } catch (error) { refusal(error); }
  }

  resize() { if (this.built) { this.redraw(); this.spectrum.resize(); this.look(); } }
  restyle() { if (this.built) { this.redraw(); this.spectrum.restyle(); } }
}
