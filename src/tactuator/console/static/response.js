// The response, measured at the rig point by point: what is felt, less what was asked; what of it the model expects.
import { Chart } from "./chart.js";
import { command, digits, make, say } from "./dom.js";
import { Loader } from "./loader.js";
import { connected } from "./rig.js";
import { term } from "./words.js";

const LOADS = ["nominal", "load", "load2", "sense"];

export default class Response {
  constructor(view, link, state) { Object.assign(this, { view, link, state, kept: [], points: null, expected: null }); }

  async open() {
    this.rig = await connected(this.view, "Response", (rig) => { this.rig = rig; this.build(); }, () => this.standing(), (message) => this.pushed(message));
  }

  close() { this.rig?.close(); }

  build() {
    const { display, channels } = this.rig.standing;
    this.channels = channels;
    this.loader = new Loader(this.rig, this.link, this.state);
    const number = (id, value, text, more = {}) => make("label", {}, `${text} `, make("input", { type: "number", step: "any", id, value, ...more }));
    const loads = ["none", ...new Set(channels.flatMap((one) => one.loads))];
    this.inputs = { level: number("level", "30", "level", { onchange: () => this.expect() }), confidence: number("confidence", "0.25", "until ±, dB"), longest: number("longest", "30", "s a point at most"), mains: number("mains", "60", "mains, Hz") };
    this.load = make("select", { id: "measured-load" }, ...loads.map((one) => make("option", { value: one }, one === "none" ? "free" : one)));
    this.hz = make("input", { id: "frequencies", placeholder: "30 over the band", size: "18" });
    this.on = channels.map((one) => make("input", { type: "checkbox", id: `measure-${one.name}`, checked: "" }));
    this.shown = make("select", { id: "shown", onchange: () => this.draw() }, ...channels.map((one) => make("option", { value: one.name }, one.name)));
    this.begin = make("button", { type: "button", id: "measure", class: "first", onclick: () => this.measure() }, "Measure");
    this.save = make("a", { id: "save-response", download: "response.csv", hidden: "" }, "Save response.csv");
    this.bits = { progress: make("p", { id: "measured", role: "status" }), command: make("div"), table: make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Points" }) };
    this.chart = new Chart("Felt level (dB SL) over frequency (Hz): asked as a line within a just-noticeable difference, measured as points, what the model expects dashed", { height: 300, log: true, unit: "dB SL" });
    this.view.replaceChildren(make("h1", {}, `Response of ${display}`), this.rig.bar, this.loader.box,
      make("div", { class: "panel" }, make("h2", {}, "Measure"), make("div", { class: "bar" }, ...channels.map((one, k) => make("label", {}, this.on[k], ` ${one.name}`)), make("label", {}, "finger ", this.load), this.inputs.level, term("sensation level", "dB SL"), this.inputs.confidence, this.inputs.longest, this.inputs.mains),
        make("div", { class: "bar" }, make("label", {}, "frequencies, Hz, commas between ", this.hz), this.begin, this.save), this.bits.command, this.bits.progress),
      make("div", { class: "panel" }, make("h2", {}, "Level over frequency"), make("label", {}, "channel ", this.shown), this.chart.box, this.bits.table));
  }

  value(name) { return Number(this.inputs[name].querySelector("input").value); }

  async measure() {
    const frequencies = this.hz.value.split(",").filter((one) => one.trim() !== "").map(Number);
    const answer = await this.rig.do("measure", { channels: this.channels.filter((_, k) => this.on[k].checked).map((one) => one.name), level_db_sl: this.value("level"), load: this.load.value,
      frequency_hz: frequencies, confidence_db: this.value("confidence"), longest_s: this.value("longest"), mains_hz: this.value("mains") });
    if (!answer) return;
    if (this.points?.done) this.kept = [...this.kept, this.points].slice(-3);
    this.points = null;
    this.bits.command.replaceChildren(command(answer.command));
    this.bits.progress.textContent = "the first point is measured";
  }

  pushed(message) {
    if (!message.points) return;
    this.points = message.points;
    const { done, total, over, csv } = this.points;
    this.bits.progress.textContent = over ? `${done} points: measured` : `${done} of ${total} points`;
    if (over) say("measured");
    // the file is made here, so that it can be saved when the server is gone
    if (this.save.href) URL.revokeObjectURL(this.save.href);
    this.save.href = URL.createObjectURL(new Blob([csv], { type: "text/csv" }));
    this.save.hidden = false;
    this.draw();
  }

  async expect() {
    if (!this.rig.open || !this.rig.standing.loaded) return;
    const found = await this.rig.do("expected", { level_db_sl: this.value("level") });
    if (found) { this.expected = found; this.draw(); }
  }

  standing() {
    const { rig } = this, { mode, loaded } = rig.standing;
    this.loader.standing();
    this.begin.disabled = !rig.mayPlay || !loaded || mode !== "idle";
    if (mode !== "measuring" && this.points && !this.points.over && this.mode === "measuring") this.bits.progress.textContent = `${this.points.done} of ${this.points.total} points, then it ended`;
    this.mode = mode;
    if (loaded && loaded !== this.known) { this.known = loaded; this.expect(); }
  }

  draw() {
    const channel = this.shown.value, curves = (this.expected?.curves ?? []).filter((one) => one.channel === channel), loads = curves.map((one) => one.load);
    const hue = (load) => LOADS[Math.max(0, loads.indexOf(load)) % LOADS.length], named = (load) => (load === "none" ? "free" : load);
    const lines = curves.map((one) => ({ name: `the model expects, ${named(one.load)}`, hue: hue(one.load), x: this.expected.frequency_hz, y: one.level_db_sl, dash: one.load === "none" ? [3, 3] : [7, 4] }));
    const found = [...this.kept, this.points].filter(Boolean).flatMap((one) => one.document.responses).filter((one) => one.channel === channel);
    const points = found.map((one) => ({ name: `felt, ${named(one.load)}`, hue: hue(one.load), x: one.frequency_hz, y: one.level_db_sl, points: true }));
    this.chart.show([...this.asked(found), ...lines, ...points]);
    const rows = found.length ? found.at(-1) : null, cell = (text) => make("td", { class: "number" }, text), told = (value) => (value === null ? "—" : value.toFixed(2));
    this.bits.table.replaceChildren(rows === null ? "" : make("table", {}, make("caption", {}, `${channel}, ${named(rows.load)}, ${digits(rows.asked_db_sl)} dB SL asked: the largest error first`),
      make("thead", {}, make("tr", {}, ...["Hz", "felt, dB SL", "felt less asked, dB", "JND", "± dB", "of this, from the model", "cut"].map((text) => make("th", { scope: "col", class: "number" }, text)))),
      make("tbody", {}, ...rows.worst_first.map((k) => make("tr", {}, cell(digits(rows.frequency_hz[k])), cell(told(rows.level_db_sl[k])), cell(told(rows.error_db[k])), cell(rows.error_jnd[k] === null ? "—" : rows.error_jnd[k].toFixed(1)), cell(rows.confidence_db[k] === null ? "—" : digits(rows.confidence_db[k])), cell(told(rows.model_db[k])), cell(rows.saturated[k] ? "yes" : ""))))));
  }

  // the level that was asked for, of the points or else of the input, with what can just be told from it
  asked(found) {
    if (!this.expected) return [];
    const { frequency_hz, asked_db_sl, jnd_db } = this.expected, level = found.at(-1)?.asked_db_sl ?? asked_db_sl, all = (value) => frequency_hz.map(() => value);
    return [{ name: `within a just-noticeable difference (${digits(jnd_db)} dB)`, x: frequency_hz, y: all(level), hue: "load", band: [all(level - jnd_db), all(level + jnd_db)] },
      { name: `asked, ${digits(level)} dB SL`, x: frequency_hz, y: all(level), hue: "faint", width: 1.2 }];
  }

  resize() { this.chart?.draw(); }
  restyle() { this.chart?.draw(); }
}
