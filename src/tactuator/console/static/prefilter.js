// The view Prefilter and curve: points of the curve are dragged, the prefilter is fitted anew, its error is drawn.
import { write } from "./address.js";
import { Chart } from "./chart.js";
import { COARSE, banner, command, counted, digits, draggable, draw, make, nearest, refusal, saved, say, undoKeys } from "./dom.js";
import { Drop } from "./drop.js";
import { verdict } from "./figures.js";
import { Value } from "./value.js";
import { term } from "./words.js";

const STEP_DB = 0.5, MANY = 5, FEWEST = 2, MOST = 16;

export default class Prefilter {
  constructor(view, link, state) { Object.assign(this, { view, link, state, own: state.own, past: [], future: [], personal: null, found: null, dragged: null, waiting: false, again_: false }); }

  async open() {
    const { view, link, state } = this;
    this.display = await link.ask("open", { display: state.display });
    const names = this.display.channels.map((one) => one.name);
    if (!names.includes(state.channel)) state.channel = names[0];
    const press = (text, onclick, more = {}) => make("button", { type: "button", onclick, ...more }, text);
    const choose = make("select", { id: "channel", onchange: () => { state.channel = choose.value; this.found = null; this.fit(); } }, ...names.map((name) => make("option", { value: name, selected: name === state.channel ? "" : null }, name)));
    this.buttons = { undo: press("Undo", () => this.step(this.past, this.future)), redo: press("Redo", () => this.step(this.future, this.past)),
      fewer: press("Fewer poles", () => this.turn(-1), { id: "fewer" }), more: press("More poles", () => this.turn(1), { id: "more" }), back: press("The display’s own curve", () => this.change({ points: "", file: "", name: "", poles: "" })) };
    this.count = make("strong", { id: "poles" });
    this.bits = { error: make("p", { class: "limits", role: "status", id: "error", tabindex: "0" }), saving: make("div", { class: "bar" }), verdict: make("div"), command: make("div") };
    this.drop = new Drop(link, { label: "Personal curve", accept: ".csv", hint: "A curve that was measured on one person, or any other: frequency_hz, level_db_re_1um. It is overlaid; “Take it” follows it.",
      taken: async (file, name) => { this.personal = { file, ...(await link.ask("prefilter.curve", { file })) }; this.draw(); this.offer(name); } });
    this.offered = make("div", { class: "bar" });
    this.curve = new Chart("Level at threshold (dB re 1 µm peak) over frequency (Hz)", { log: true, height: 400, role: "group", unit: "dB", sync: "prefilter" });
    this.error = new Chart("Error of the prefilter (dB) over frequency (Hz)", { log: true, height: 170, unit: "dB", sync: "prefilter" });
    this.curve.drawn = () => this.handles();
    this.layer = draw("svg", { class: "handles", role: "group", "aria-label": "Points of the threshold curve" });
    this.layer.onpointermove = (event) => this.drag(event);
    this.layer.onpointerup = this.layer.onpointercancel = () => { this.dragged = null; write(this.state); this.draw(); };
    this.points = [];
    this.value = new Value(this.curve.host);
    view.replaceChildren(make("div", { class: "workbench" },
      make("div", { class: "bar" }, make("h1", {}, "Prefilter and curve of ", this.display.name), make("label", { for: "channel" }, "channel "), choose, ...Object.values(this.buttons), "poles: ", this.count),
      this.bits.error, make("div", { class: "loop" }, make("div", {}, make("div", { class: "panel" }, this.curve.box)),
        make("div", {}, make("div", { class: "panel" }, this.error.box), make("div", { class: "panel" }, this.drop.box, this.offered), make("div", { class: "panel" }, make("h2", {}, "Controller"), this.bits.saving, this.bits.command, this.bits.verdict))),
      make("p", {}, "The ", term("prefilter"), " makes a channel follow the ", term("threshold curve"), ". Drag a point of the curve, move it by the arrow keys, or type its level at the point; the loop stays, the prefilter is fitted anew.")));
    this.bits.saving.replaceChildren(press("Design and save", () => this.save(), { class: "first", id: "design" }));
    undoKeys(view, () => this.step(this.past, this.future), () => this.step(this.future, this.past));
    await this.fit();
  }

  asked() {
    const { points, file, poles } = this.own;
    return { display: this.state.display, ...(points ? { points: JSON.parse(points) } : file ? { file } : {}), ...(poles ? { poles: Number(poles) } : {}) };
  }

  change(to, begun = true) {
    if (begun) { this.past.push({ ...this.own }); this.future = []; }
    Object.assign(this.own, to);
    this.fit();
  }

  step(from, to) {
    if (!from.length) return;
    to.push({ ...this.own });
    this.own = this.state.own = from.pop();
    this.fit();
  }

  turn(by) {
    const poles = Math.min(MOST, Math.max(FEWEST, (Number(this.own.poles) || this.found?.poles || 4) + by));
    this.change({ poles: String(poles) });
  }

  // One fit is under way at a time; what changes meanwhile is asked for together when it is done.
  async fit() {
    this.bits.error.setAttribute("aria-busy", "true");
    if (this.waiting) { this.again_ = true; return; }
    this.waiting = true;
    try {
      do {
        this.again_ = false;
        this.found = await this.link.ask("prefilter.fit", { ...this.asked(), channel: this.state.channel });
        this.good = { ...this.own };
        banner("");
      } while (this.again_);
      if (this.dragged === null) write(this.state);
      this.draw();
    } catch (error) {
      refusal(error);
      if (!error.lost && this.good) { this.own = this.state.own = { ...this.good }; }
    } finally { this.waiting = false; this.bits.error.setAttribute("aria-busy", "false"); }
  }

  draw() {
    const { found } = this;
    if (!found) return;
    const { frequency_hz: hz, wanted_db, given_db, error_db, curve, own, allowed_db: allowed } = found;
    const line = ({ points }) => { const there = points.filter(([at]) => at >= hz[0] && at <= hz.at(-1)); return { x: there.map(([at]) => at), y: there.map(([, level]) => level) }; };
    const drawn = this.own.points || this.own.file;
    this.curve.still = this.dragged !== null;
    this.curve.show([
      { name: `${own.name}, the display’s own`, hue: "kept", dash: [2, 3], ...line(own) },
      ...(this.personal ? [{ name: `${this.personal.name}, ${this.personal.provenance}`, hue: "sense", dash: [7, 3], ...line(this.personal) }] : []),
      { name: "target", hue: "nominal", x: hz, y: wanted_db }, { name: "with the prefilter", hue: "load", dash: [7, 4], x: hz, y: given_db }]);
    const flat = (db) => ({ x: [hz[0], hz.at(-1)], y: [db, db], hue: "limit", dash: [5, 3] });
    const most = Math.max(1.2 * allowed, ...error_db.map(Math.abs));
    this.error.range = [-1.06 * most, 1.06 * most];
    this.error.show([{ name: "error", hue: "nominal", x: hz, y: error_db }, { name: `allowed, ±${allowed} dB`, ...flat(allowed) }, { name: "", ...flat(-allowed) }]);
    const over = Number(found.greatest_db) > allowed;
    const loop = this.display.channels.find((one) => one.name === this.state.channel).loop;
    this.bits.error.replaceChildren(make("strong", { class: "chip" }, loop ? "behind the loop that “design” makes" : "no loop"), ` Greatest error ${found.greatest_db} dB at ${found.worst_hz} Hz, rms ${found.rms_db} dB; allowed: ${allowed} dB.`,
      ...(loop && this.state.shapes[this.state.channel] ? ["  The view Loop shows the error with its own loop."] : []));
    this.bits.error.classList.toggle("over", over);
    this.count.textContent = String(found.poles);
    this.buttons.fewer.disabled = found.poles <= FEWEST; this.buttons.more.disabled = found.poles >= MOST;
    this.buttons.undo.disabled = !this.past.length; this.buttons.redo.disabled = !this.future.length;
    this.buttons.back.disabled = !drawn && !this.own.poles;
    this.bits.command.replaceChildren(command(found.command));
  }

  handles() {
    const { plot } = this.curve, { points } = this.found.curve, [low, high] = this.found.band_hz;
    if (this.layer.parentNode !== plot.over) plot.over.append(this.layer);
    const shown = points.map(([hz, level], index) => ({ hz, level, index })).filter(({ hz }) => hz >= low && hz <= high);
    while (this.points.length > shown.length) this.points.pop().remove();
    while (this.points.length < shown.length) this.points.push(this.handle());
    shown.forEach(({ hz, level, index }, i) => {
      const node = this.points[i];
      node.index = index;
      node.setAttribute("cx", plot.valToPos(hz, "x")); node.setAttribute("cy", plot.valToPos(level, "y"));
      node.setAttribute("aria-label", `Threshold at ${digits(hz)} Hz`);
      node.setAttribute("aria-valuenow", level.toFixed(1));
      node.setAttribute("aria-valuetext", `${level.toFixed(1)} dB re 1 µm`);
    });
    this.value.show();
  }

  handle() {
    const node = draw("circle", { class: "handle", r: COARSE ? 9 : 7, tabindex: 0, role: "slider", "aria-valuemin": -200, "aria-valuemax": 200, "aria-orientation": "vertical" });
    const level = (of = node) => this.found.curve.points[of.index]?.[1] ?? 0;
    this.value.attach(node, () => node.getAttribute("aria-label"), () => [{ name: "", unit: "dB re 1 µm", value: level(), set: (to) => this.move(node.index, to, true) }]);
    draggable(node, (event) => { const taken = nearest(this.points, event); event.preventDefault(); taken.focus(); this.layer.setPointerCapture(event.pointerId); this.dragged = { index: taken.index, level: level(taken), y: event.clientY, begun: true }; });
    node.onkeydown = (event) => {
      const up = { ArrowUp: 1, ArrowDown: -1 }[event.key];
      if (!up) return;
      event.preventDefault();
      this.move(node.index, this.found.curve.points[node.index][1] + up * STEP_DB * (event.shiftKey ? MANY : 1), true);
    };
    this.layer.append(node);
    return node;
  }

  drag(event) {
    if (this.dragged === null) return;
    const { plot } = this.curve, { top } = plot.over.getBoundingClientRect(), { index, level, y, begun } = this.dragged;
    this.dragged.begun = false;
    this.move(index, level + plot.posToVal(event.clientY - top, "y") - plot.posToVal(y - top, "y"), begun);
  }

  move(index, level, begun) {
    const points = structuredClone(this.own.points ? JSON.parse(this.own.points) : this.found.curve.points);
    points[index][1] = Math.max(-200, Math.min(200, Math.round(level * 100) / 100));
    this.change({ points: JSON.stringify(points), file: "", name: "" }, begun);
  }

  offer(name) {
    this.offered.replaceChildren(make("button", { type: "button", id: "take", onclick: () => this.change({ points: "", file: this.personal.file, name }) }, "Take it"),
      make("span", {}, `${this.personal.name}: `, term("provenance", this.personal.provenance)));
  }

  async save() {
    const button = this.bits.saving.querySelector("#design");
    button.disabled = true;
    const end = counted("Designing", (words) => { button.textContent = words; });
    try {
      const found = await this.link.ask("prefilter.save", this.asked()), name = found.command.split(" ").at(-1);
      this.bits.saving.replaceChildren(button, saved(`Save ${name}`, name, found.text), ...(found.curve ? [saved("Save curve.csv", "curve.csv", found.curve, "text/csv")] : []));
      this.bits.verdict.replaceChildren(verdict(found.verdict));
      say(found.verdict.sentence);
    } catch (error) { refusal(error); } finally { end(); button.disabled = false; button.textContent = "Design and save"; }
  }

  again() { this.fit(); }
  resize() { this.curve.resize(); this.error.resize(); }
  restyle() { this.curve.restyle(); this.error.restyle(); }
}
