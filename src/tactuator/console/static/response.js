// The response, measured at the rig point by point: what is felt, less what was asked; what of it the model expects.
import { Chart } from "./chart.js";
import { command, digits, fault, lasting, make, numberIn, say } from "./dom.js";
import { Loader } from "./loader.js";
import { connected, measured } from "./rig.js";
import { term } from "./words.js";

const HUES = ["nominal", "load", "load2", "sense"];
let line = ""; // the command of the last measurement
const named = (load) => (load === "none" ? "free" : load);

export default class Response {
  constructor(view, link, state) { Object.assign(this, { view, link, state, expected: null }); }

  async open() {
    this.rig = await connected(this.view, "Response", (rig) => { this.rig = rig; this.build(); }, () => this.standing(), (message) => this.pushed(message));
  }

  close() { this.rig?.close(); }

  build() {
    const { display, channels, mains_hz } = this.rig.standing;
    this.channels = channels;
    this.loader = new Loader(this.rig, this.link, this.state, make("h1", {}, `Response of ${display}`));
    const number = (id, value, text, more = {}) => make("label", {}, `${text} `, lasting(make("input", { type: "number", step: "any", id, value, ...more })));
    const loads = ["none", ...new Set(channels.flatMap((one) => one.loads))];
    this.inputs = { level: number("level", "30", "level", { min: "-60", max: "55", onchange: () => this.expect() }), confidence: number("confidence", "0.25", "until ±, dB", { min: "0.001" }), longest: number("longest", "30", "s a point at most", { min: "0.1" }), mains: number("mains", String(mains_hz), "mains, Hz", { min: "1" }) };
    this.load = lasting(make("select", { id: "measured-load" }, ...loads.map((one) => make("option", { value: one }, one === "none" ? "free" : one))));
    this.hz = lasting(make("input", { id: "frequencies", placeholder: "30 over the band", size: "18" }));
    this.on = channels.map((one) => lasting(make("input", { type: "checkbox", id: `measure-${one.name}`, checked: "" })));
    this.shown = lasting(make("select", { id: "shown", onchange: () => this.draw() }, ...channels.map((one) => make("option", { value: one.name }, one.name))));
    this.begin = make("button", { type: "button", id: "measure", class: "first", onclick: () => this.measure() }, "Measure");
    this.needs = make("span", { id: "needs", class: "needs" });
    this.save = make("a", { id: "save-response", download: "response.csv", hidden: "" }, "Save response.csv");
    this.bits = { progress: make("p", { id: "measured", role: "status" }), command: make("div"), table: make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Points" }), within: make("p", { id: "within", class: "within" }), kept: make("div") };
    this.chart = new Chart("Felt level (dB SL) over frequency (Hz)", { high: () => Math.max(300, Math.min(460, innerHeight - 480)), log: true, unit: "dB SL" });
    this.view.replaceChildren(make("div", { class: "workbench" }, this.loader.box, this.rig.bar,
      make("div", { class: "panel settings" }, make("div", { class: "bar strip" }, ...channels.map((one, k) => make("label", {}, this.on[k], ` ${one.name}`)), make("label", {}, "finger ", this.load), this.inputs.level, term("sensation level", "dB SL"), this.inputs.confidence, this.inputs.longest, this.inputs.mains,
        make("label", {}, "frequencies, Hz, commas between ", this.hz), this.begin, this.needs, this.save), this.bits.command, this.bits.progress),
      make("div", { class: "measured" }, make("div", { class: "panel" }, make("div", { class: "bar" }, make("label", {}, "channel ", this.shown), this.bits.within), this.chart.box, this.bits.kept), make("div", { class: "panel" }, this.bits.table))));
    if (this.points) this.fresh();
    if (line) this.bits.command.replaceChildren(command(line));
    if (this.rig.standing.mode === "measuring" && (this.points?.over ?? true)) this.bits.progress.textContent = "The first point is measured.";
  }

  // Measurements stay in the chart, each with its name, while other views are shown.
  get kept() { return [...measured.values()].filter((one) => one.document.responses.length); }
  get points() { return [...measured.values()].at(-1); }
  value(name) { return numberIn(this.inputs[name].querySelector("input")); }

  // The frequencies of the field, or null with the fault at it; none: those of the command.
  frequencies() {
    const texts = this.hz.value.split(",").map((one) => one.trim()).filter(Boolean), wrong = texts.find((one) => !(Number(one) > 0));
    fault(this.hz, wrong === undefined ? "" : `“${wrong}” is no number above 0; expected frequencies in Hz, commas between`);
    return wrong === undefined ? texts.map(Number) : null;
  }

  async measure() {
    const live = this.rig.standing.mode === "live", frequency_hz = this.frequencies();
    const numbers = { level_db_sl: this.value("level"), confidence_db: this.value("confidence"), longest_s: this.value("longest"), mains_hz: this.value("mains") };
    if (frequency_hz === null || Object.values(numbers).some(Number.isNaN)) return;
    const answer = await this.rig.do("measure", { settings: { channels: this.channels.filter((_, k) => this.on[k].checked).map((one) => one.name), load: this.load.value, frequency_hz, ...numbers } });
    if (!answer) return;
    this.asking = true;
    line = answer.command;
    this.bits.command.replaceChildren(command(line));
    this.stopped = live ? "What played live was stopped. " : "";
    this.bits.progress.textContent = `${this.stopped}The first point is measured.`;
  }

  pushed(message) {
    if (!message.points || !this.bits) return;
    this.asking = false;
    this.fresh();
    if (message.points.over) say("measured");
  }

  progress() {
    const { done, total, over } = this.points, ended = this.rig.standing.mode === "measuring" ? "" : ", then it ended";
    this.bits.progress.textContent = `${this.stopped ?? ""}${over ? `${done} point${done === 1 ? "" : "s"}: measured` : `${done} of ${total} points${ended}`}`;
  }

  fresh() {
    for (const one of this.kept) one.name ??= `${one.place}: ${named(one.document.responses[0].load)}, ${digits(one.document.responses[0].asked_db_sl)} dB SL, ${one.controller}`;
    this.progress();
    // the file is made here, so that it can be saved when the server is gone
    if (this.save.href) URL.revokeObjectURL(this.save.href);
    this.save.href = URL.createObjectURL(new Blob([this.points.csv], { type: "text/csv" }));
    this.save.hidden = false;
    this.list();
    this.draw();
  }

  list() {
    const key = this.kept.map((one) => one.place).join();
    if (key === this.listed) return;
    this.listed = key;
    this.bits.kept.replaceChildren(...this.kept.map((one, i) => make("div", { class: "factor" },
      make("label", {}, make("input", { type: "checkbox", checked: one.shown ? "" : null, onchange: (event) => { one.shown = event.target.checked; this.draw(); } }), " in the chart"),
      make("input", { value: one.name, size: "34", "aria-label": `name of measurement ${i + 1}`, onchange: (event) => { one.name = event.target.value; this.draw(); } }))));
  }

  async expect() {
    if (!this.rig.open || !this.rig.standing.loaded) return;
    const level = this.value("level");
    if (Number.isNaN(level)) return;
    const found = await this.rig.do("expected", { level_db_sl: level });
    if (found) { this.expected = found; this.draw(); }
  }

  standing() {
    const { rig } = this, { mode, loaded } = rig.standing;
    this.loader.standing();
    this.begin.disabled = !rig.mayPlay || !loaded || !["idle", "live"].includes(mode);
    this.needs.textContent = loaded ? mode === "live" ? "ends what plays live" : "" : "needs a controller, loaded above";
    if (mode !== "measuring" && this.mode === "measuring") {
      if (this.asking || !this.points) this.bits.progress.textContent = ""; else this.progress();
      this.asking = false;
    }
    this.mode = mode;
    if (loaded && loaded !== this.known) { this.known = loaded; this.expect(); }
  }

  draw() {
    const channel = this.shown.value, curves = (this.expected?.curves ?? []).filter((one) => one.channel === channel);
    const lines = curves.map((one) => ({ name: `the model expects: ${named(one.load)}`, hue: "faint", x: this.expected.frequency_hz, y: one.level_db_sl, dash: one.load === "none" ? [3, 3] : [7, 4] }));
    const found = this.kept.filter((one) => one.shown).flatMap((one) => one.document.responses.filter((each) => each.channel === channel).map((each) => ({ ...each, name: one.name, hue: HUES[(one.place - 1) % HUES.length] })));
    const points = found.map((one) => ({ name: one.name, hue: one.hue, x: one.frequency_hz, y: one.level_db_sl, bars: one.confidence_db, points: true }));
    const rows = found.at(-1) ?? null, hum = this.expected?.hum[channel];
    const beneath = [...(rows ? [{ name: "noise floor at the points", hue: "kept", width: 1.2, x: rows.frequency_hz, y: rows.noise_db_sl }] : []), ...(hum?.frequency_hz.length ? [{ name: "hum the model expects", hue: "limit", x: hum.frequency_hz, y: hum.level_db_sl, points: true }] : [])];
    const joined = points.map((one) => ({ ...one, points: false, bars: null, quiet: true, width: 1 }));
    this.chart.show([...this.asked(found), ...lines, ...beneath, ...joined, ...points]);
    this.bits.within.textContent = rows ? `${rows.name}: ${rows.within}` : "";
    const cut = rows?.saturated.some(Boolean), cell = (text) => make("td", { class: "number" }, text), fixed = (value) => (value === null ? "—" : value.toFixed(2)), heads = ["Hz", "felt, dB SL", "error, dB", "JND", "± dB", "model’s, dB", ...(cut ? ["cut"] : [])];
    this.bits.table.replaceChildren(rows === null ? make("p", {}, "Measured points appear here, with their level error (felt minus requested) and the part of it that the model predicts.") : make("table", { class: "points" }, make("caption", {}, `${channel}, ${rows.name}: the largest level error (felt minus requested) first`),
      make("thead", {}, make("tr", {}, ...heads.map((text) => make("th", { scope: "col", class: "number" }, text)))),
      make("tbody", {}, ...rows.worst_first.map((k) => make("tr", {}, cell(digits(rows.frequency_hz[k])), cell(fixed(rows.level_db_sl[k])), cell(fixed(rows.error_db[k])), cell(rows.error_jnd[k] === null ? "—" : rows.error_jnd[k].toFixed(1)), cell(rows.confidence_db[k] === null ? "—" : rows.confidence_db[k] < 0.01 ? "< 0.01" : fixed(rows.confidence_db[k])), cell(fixed(rows.model_db[k])), ...(cut ? [cell(rows.saturated[k] ? "yes" : "")] : []))))));
  }

  // the requested level, of the points or else of the input, with the just-noticeable difference
  asked(found) {
    if (!this.expected) return [];
    const { frequency_hz, asked_db_sl, jnd_db } = this.expected, level = found.at(-1)?.asked_db_sl ?? asked_db_sl, all = (value) => frequency_hz.map(() => value);
    return [{ name: `within a just-noticeable difference (${digits(jnd_db)} dB)`, x: frequency_hz, y: all(level), hue: "load", band: [all(level - jnd_db), all(level + jnd_db)] },
      { name: `asked, ${digits(level)} dB SL`, x: frequency_hz, y: all(level), hue: "faint", width: 1.2 }];
  }

  resize() { this.chart?.resize(); }
  restyle() { this.chart?.restyle(); }
}
