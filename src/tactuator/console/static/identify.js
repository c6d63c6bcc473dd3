// The view Identify: a record is dropped, its columns are guessed, a model is found; order and hold are chosen from what was tried.
import { address, write } from "./address.js";
import { Chart } from "./chart.js";
import { command, counted, make, numberIn, refusal, saved, say } from "./dom.js";
import { Drop } from "./drop.js";
import { table } from "./figures.js";
import { term } from "./words.js";

export default class Identify {
  constructor(view, link, state) { Object.assign(this, { view, link, state, own: state.own, charts: [], validate: [] }); }

  async open() {
    const { view, link } = this;
    this.drop = new Drop(link, { label: "Record or response", accept: ".csv,.txt,.tsv,.dat,.mat,.wav,.flac,.h5,.hdf5", hint: "Drop a file here, or choose one: columns of time, command and position (or of frequency and magnitude) as CSV, MATLAB, HDF5 or sound.", example: "bench.csv",
      taken: (key, name) => { this.own = this.state.own = { record: key, name }; this.validate = []; return this.look(); } });
    this.unseen = new Drop(link, { label: "Validation record", multiple: true, hint: "A record of the same mechanism that the fit does not see. The model is held against it.",
      taken: (key, name) => { this.validate = [...this.validate, { key, name }]; this.keep(); return this.model(); } });
    this.bits = { columns: make("div"), model: make("div") };
    view.replaceChildren(make("h1", {}, "Identify a mechanism"),
      make("p", { class: "intro" }, "A record of command and position gives a model of the ", term("plant"), " (", term("identification"), "), with the band in which it may be wrong."),
      make("div", { class: "panel" }, this.drop.box, this.bits.columns), this.bits.model);
    if (this.own.record) {
      this.drop.name.textContent = this.own.name ?? "";
      this.validate = (this.own.validate ?? "").split(",").filter(Boolean).map((one) => { const [key, name] = one.split(":"); return { key, name: decodeURIComponent(name ?? key) }; });
      await this.look().catch((error) => this.drop.refuse(error.message));
    }
  }

  keep() {
    this.own.validate = this.validate.map(({ key, name }) => `${key}:${encodeURIComponent(name)}`).join(",");
    write(this.state);
  }

  asked() { const { record, input, output, time } = this.own; return { record, ...(input && output ? { input, output } : {}), ...(time ? { time } : {}), ...(Number(this.own.rate) > 0 ? { rate_hz: Number(this.own.rate) } : {}) }; }

  // Columns: those that were taken, to be changed here.
  async look() {
    this.bits.model.replaceChildren();
    this.bits.columns.replaceChildren();
    write(this.state);
    const found = await this.link.ask("identify.look", this.asked());
    if (found.points) {
      this.bits.columns.replaceChildren(make("p", {}, `A frequency response of ${found.points} points; columns ${found.columns.join(", ")}. The model is found from it as it is: `, term("candidate", "candidates"), " and validation are for records."), this.orders());
      this.drop.refuse("");
      await this.model();
      return;
    }
    const choose = (which, chosen) => make("select", { id: `column-${which}`, onchange: (event) => { this.own[which] = event.target.value; this.own.order = this.own.zeros = this.own.hold = ""; if (this.own.input && this.own.output) this.again(); } },
      ...(chosen ? [] : [make("option", { value: "" }, "choose")]), ...found.columns.map((name) => make("option", { value: name, selected: name === chosen ? "" : null }, name)));
    const rate = make("input", { id: "rate", type: "number", min: "0.001", step: "any", value: this.own.rate ?? "", placeholder: found.rate_hz ? `${Number(found.rate_hz.toPrecision(6))}` : "", onchange: () => { const to = numberIn(rate, true); if (!Number.isNaN(to)) { this.own.rate = to === null ? "" : rate.value; this.again(); } } });
    const input = this.own.input || found.input, output = this.own.output || found.output;
    Object.assign(this.own, { input: input ?? "", output: output ?? "" });
    const [unitU, unitY] = found.units ?? ["", ""];
    this.bits.columns.replaceChildren(make("div", { class: "factor" },
      make("div", {}, make("label", { for: "column-input" }, `command${unitU ? `, ${unitU}` : ""}`), choose("input", input)),
      make("div", {}, make("label", { for: "column-output" }, `position${unitY ? `, ${unitY}` : ""}`), choose("output", output)),
      found.said || this.own.time ? make("div", {}, make("label", { for: "column-time" }, "time"), choose("time", this.own.time)) : "",
      make("div", {}, make("label", { for: "rate" }, "rate in Hz, where the file has none"), rate)),
    ...(found.rate_hz ? [make("p", {}, `${found.duration_s.toPrecision(4)} s at ${Number(found.rate_hz.toPrecision(6))} Hz; columns ${found.columns.join(", ")}.`)] : []),
    ...(found.remarks ?? []).map((text) => make("p", {}, text)));
    if (found.said) { this.drop.refuse(found.said); return; }
    this.drop.refuse("");
    await this.model();
  }

  // The order of a response's model: the data's own choice, or one that is given.
  orders() {
    const select = make("select", { id: "order", onchange: () => { this.own.order = select.value; this.again(); } },
      ...["", 1, 2, 3, 4, 5, 6, 7, 8].map((one) => make("option", { value: one, selected: `${one}` === (this.own.order ?? "") ? "" : null }, one === "" ? "let the data choose" : `${one}`)));
    return make("label", {}, "poles ", select);
  }

  again() { return this.look().catch((error) => this.drop.refuse(error.message)); }

  async model() {
    const { order, zeros, hold } = this.own, busy = make("p", { role: "status" }, "Identifying");
    this.bits.model.prepend(busy);
    this.bits.model.setAttribute("aria-busy", "true");
    const end = counted("Identifying", (words) => { busy.textContent = words; });
    try {
      const found = await this.link.ask("identify.model", { ...this.asked(), ...(order ? { order: Number(order) } : {}), ...(zeros ? { zeros: Number(zeros) } : {}), hold: hold || "auto", validate_on: this.validate.map(({ key }) => key) });
      write(this.state);
      this.show(found);
      say(`Model of ${found.order} poles${found.trusted ? "" : ", not to be trusted"}.`);
    } finally { end(); busy.remove(); this.bits.model.setAttribute("aria-busy", "false"); }
  }

  show(found) {
    this.view.classList.add("known");
    const { response, residual, departure } = found, own = response.own;
    const magnitude = new Chart("Magnitude (dB) over frequency (Hz)", { log: true }), phase = new Chart("Phase (degrees) over frequency (Hz)", { log: true, height: 170 });
    const left = new Chart(residual ? "Spectrum of position and residual (dB re 1 unit²/Hz) over frequency (Hz)" : "Departure of the response from the model (dB) over frequency (Hz)", { log: true, height: 190 });
    this.charts = [magnitude, phase, left];
    const edges = (middle, half) => [middle.map((one, i) => one - half[i]), middle.map((one, i) => one + half[i])];
    const of = (chart, name, band) => [
      { name: "95 % band", hue: "shade", x: response.frequency_hz, band: edges(response[name], response[band]) },
      { name: residual ? "the record’s own, hold included" : "the response that was dropped", hue: "faint", x: own[name].length ? own.frequency_hz : [], y: own[name], points: true },
      { name: "model", hue: "nominal", x: response.frequency_hz, y: response[name] }];
    const again = make("button", { type: "button", onclick: () => { this.own.order = this.own.zeros = this.own.hold = ""; this.again(); } }, "Let the data choose");
    this.bits.model.replaceChildren(
      ...(found.trusted ? [] : [make("div", { class: "crossed", role: "alert" }, "The model is not to be trusted: ", make("ul", {}, ...found.distrust.map((text) => make("li", {}, text))))]),
      make("div", { class: "bar" }, saved("Save model.json", "model.json", found.text), make("button", { type: "button", id: "describe", onclick: () => this.describe(found.text) }, "Begin a display with it"), make("span", { class: "gap" }), command(found.command)),
      make("div", { class: "loop" },
        make("div", {}, make("div", { class: "panel" }, make("h2", {}, "Response"), ...this.charts.map((one) => one.box), ...(residual ? [make("p", {}, term("residual"), `: ${residual.white ? "white" : "not white"}, ${residual.free ? "free" : "not free"} of the command.`)] : []))),
        make("div", {}, ...(residual ? [make("div", { class: "panel" }, make("h2", {}, "What was tried"), this.candidates(found), this.own.order || this.own.hold ? again : "")] : []),
          make("div", { class: "panel" }, make("h2", {}, "Model"), make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Model" }, table("What was found", ["what", "value", "±95 %"], found.rows), table("What it is trusted by", ["what", "value", "limit", "decides"], found.trust)), ...found.remarks.map((text) => make("p", {}, `Note: ${text}.`))),
          ...(residual ? [make("div", { class: "panel" }, make("h2", {}, "Validation"), this.unseen.box, ...this.validate.map(({ name }, i) => make("div", { class: "factor" }, make("b", {}, name),
            make("button", { type: "button", "aria-label": `Forget ${name}`, onclick: () => { this.validate.splice(i, 1); this.keep(); this.model().catch((error) => this.unseen.refuse(error.message)); } }, "Forget"))))] : []))));
    magnitude.show(of(magnitude, "magnitude_db", "band_db"));
    phase.show(of(phase, "phase_deg", "band_deg"));
    if (departure) left.show([{ name: "measured over model", hue: "sense", x: departure.frequency_hz, y: departure.db, points: true }]);
    else left.show([{ name: "position", hue: "nominal", x: residual.frequency_hz, y: residual.position_db }, { name: "residual", hue: "sense", x: residual.frequency_hz, y: residual.residual_db }]);
  }

  async describe(text) {
    try { location.hash = address({ view: "display", own: { model: (await this.drop.send(new File([text], "model.json"))).key } }); } catch (error) { refusal(error); }
  }

  // A row of what was tried: its button takes its order and hold.
  candidates(found) {
    const take = ({ poles, zeros, hold }) => { Object.assign(this.own, { order: String(poles), zeros: String(zeros), hold }); this.again(); };
    const rows = found.tried.map((one) => make("tr", { class: one.taken ? "taken" : null },
      make("th", { scope: "row" }, make("button", { type: "button", "aria-pressed": String(one.taken), onclick: () => take(one) }, `${one.poles} pole${one.poles === 1 ? "" : "s"}, ${one.zeros} zero${one.zeros === 1 ? "" : "s"}, ${one.hold}`)),
      ...[one.dead_time ? "yes" : "no", one.behind].map((text) => make("td", { class: "number" }, String(text)))));
    const head = [["order and ", term("hold")], [term("dead time")], [term("candidate", "behind")]].map((texts) => make("th", { scope: "col" }, ...texts));
    return make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "What was tried" }, make("table", { id: "tried" }, make("thead", {}, make("tr", {}, ...head)), make("tbody", {}, ...rows)));
  }

  close() { this.view.classList.remove("known"); }
  resize() { this.charts.forEach((one) => one.resize()); }
  restyle() { this.charts.forEach((one) => one.restyle()); }
}
