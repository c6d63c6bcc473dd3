// The loop view: one channel's controller, dragged, computed by the server, drawn here.
import { write } from "./address.js";
import { banner, command, counted, make, refusal, saved, say, undoKeys } from "./dom.js";
import { Editor } from "./editor.js";
import { designTable, tiles, verdict } from "./figures.js";
import { Handles } from "./handles.js";
import { Nichols } from "./nichols.js";
import { Plots } from "./plots.js";
import { copied, setRanges } from "./shape.js";
import { term } from "./words.js";

const STYLES = ["none", "7 4", "7 4"], HUES = ["nominal", "load", "load2"];
const UNDESIGNED = "not designed yet, a loop to begin with";
const REGIONS = { sensitivity: "|S| passes its limit", resonance: "|T| passes its limit", phase: "the phase margin is short" };

export default class Loop {
  constructor(view, link, state) {
    Object.assign(this, { view, link, state, past: [], future: [], latencies: [], kept: [], frame: null, waiting: false, next: null, since: null, later: [], good: null });
    window.consoleLatencies = this.latencies;
  }

  async open() {
    const { display } = this.state;
    this.display = await this.link.ask("open", { display });
    const loops = this.display.channels.filter((one) => one.loop);
    if (!loops.length) {
      this.view.replaceChildren(make("h1", {}, this.display.name), make("p", {}, "This display has no loop to shape: its structure is “none”, and the prefilter drives the actuator directly. `tactuator design` fits the prefilter."), command(`tactuator design ${this.display.file}`));
      return;
    }
    if (!loops.some((one) => one.name === this.state.channel)) this.state.channel = loops[0].name;
    this.kept = JSON.parse(localStorage.getItem(this.keeping()) ?? "[]");
    this.build(loops);
    await this.bring(this.state.channel);
  }

  keeping() { return `kept ${this.state.display} ${this.state.channel}`; }
  shape() { return this.state.shapes[this.state.channel]; }

  build(loops) {
    const press = (text, onclick, more = {}) => make("button", { type: "button", onclick, ...more }, text);
    const choose = make("select", { id: "channel", onchange: () => this.bring(choose.value) }, ...loops.map(({ name }) => make("option", { value: name, selected: name === this.state.channel ? "" : null }, name)));
    this.buttons = { undo: press("Undo", () => this.undo(), { title: "Ctrl+Z" }), redo: press("Redo", () => this.redo(), { title: "Ctrl+Shift+Z" }), design: press("Design it", () => this.design(), { class: "first" }),
      keep: press("Keep", () => this.keep()), check: press("Check and save", () => this.check(), { id: "check" }) };
    const panel = (name) => make("div", { class: `panel ${name}` });
    this.bits = { tiles: make("dl", { class: "tiles" }), standing: make("strong", { id: "standing", class: "chip" }), crossed: make("span", { id: "crossed", class: "crossed" }), verdict: make("span", { id: "verdict" }), chart: panel("nichols-panel"), plots: panel("plots"),
      editor: panel("editing"), tables: make("div", { class: "panel" }), kept: panel("kept"), command: make("div"), legend: make("ul", { class: "legend" }) };
    const { tiles: big, standing, crossed, verdict: sentence, chart, plots, editor, tables, kept, command: line } = this.bits;
    this.view.replaceChildren(make("div", { class: "workbench" },
      make("div", { class: "bar" }, make("h1", {}, "Loop of ", this.display.name), make("label", { for: "channel" }, "channel "), choose, ...Object.values(this.buttons)),
      make("p", { class: "limits", tabindex: "0", role: "region", "aria-label": "Limits" }, standing, " ", crossed, " ", sentence), big,
      make("div", { class: "bench" }, chart, plots, make("div", { class: "aside" }, editor, kept)), line, tables));
    undoKeys(this.view, () => this.undo(), () => this.redo());
  }

  async bring(channel) {
    this.state.channel = channel;
    this.kept = JSON.parse(localStorage.getItem(this.keeping()) ?? "[]");
    this.past = []; this.future = []; this.good = null;
    const { display } = this.state;
    this.basis = await this.link.ask("bring", { display, channel });
    setRanges(this.basis.ranges);
    this.state.shapes[channel] ??= this.basis.shape;
    this.nichols = new Nichols(this.basis, (hz, turn, gain, begun) => this.point(hz, turn, gain, begun), () => this.done(), (then) => this.settled(then));
    this.bits.chart.replaceChildren(make("div", { class: "head" }, make("h2", {}, "Nichols chart"), this.nichols.out), this.bits.legend, this.nichols.box);
    this.nichols.fill();
    this.plots = new Plots(this.basis);
    this.bits.plots.replaceChildren(...this.plots.all.map((one) => one.box));
    this.handles = new Handles(this.plots.open, (change, begun) => this.change(change, begun), () => this.done(), (index) => this.remove(index));
    this.editor = new Editor(this.bits.editor, (change) => { this.change(change, true); this.done(); });
    this.lists();
    this.request("draw", {}, performance.now());
  }

  legend() {
    const line = (hue, dash) => `<svg viewBox="0 0 26 10" aria-hidden="true"><path d="M0 5H26" fill="none" stroke="var(--${hue})" stroke-width="2.4" stroke-dasharray="${dash}"/></svg>`;
    const entry = (picture, ...words) => { const li = make("li", {}); li.innerHTML = picture; li.append(...words); return li; };
    this.bits.legend.replaceChildren(
      ...this.basis.loads.map((load, i) => entry(line(HUES[i] ?? "load", STYLES[i] ?? "7 4"), ...(load === "none" ? ["no load"] : [term("load"), ` ${load}`]))),
      ...(this.basis.plants > 1 ? [entry(`<svg viewBox="0 0 26 10" aria-hidden="true"><rect width="26" height="10" fill="var(--shade)" stroke="var(--load)"/></svg>`, `all ${this.basis.plants} plants`)] : []),
      entry(line("limit", "5 3"), "limits"), ...(this.kept.some((one) => one.compared) ? [entry(line("kept", "2 3"), "kept designs")] : []));
  }

  // Changes: of the shape here, or of a point of the curve by the server.
  change(how, begun) {
    if (begun) this.remember();
    how(this.shape());
    this.request("draw", {}, performance.now());
  }

  point(hz, turn_deg, gain_db, begun) {
    if (begun) { this.remember(); this.origin = copied(this.shape()); }
    this.request("point", { shape: this.origin, hz, turn_deg, gain_db }, performance.now());
  }

  // One request is under way at a time; what changes meanwhile is asked for together when it is answered.
  request(what, more, now) {
    this.since ??= now;
    this.next = { what, more };
    this.bits.tiles.setAttribute("aria-busy", "true");
    if (!this.waiting) this.ask();
  }

  async ask() {
    const { display, channel } = this.state, { what, more } = this.next, since = this.since;
    this.next = null; this.since = null; this.waiting = true;
    try {
      const { drawing, frame, shape } = await this.link.ask(what, { display, channel, shape: this.shape(), ...more });
      if (channel !== this.state.channel) return;
      this.newest = drawing;
      if (this.next?.what !== "draw") this.state.shapes[channel] = shape;
      this.good = copied(shape);
      this.frame = frame;
      this.show();
      banner("");
      if (!this.held) write(this.state);
      requestAnimationFrame(() => { this.latencies.push(performance.now() - since); });
    } catch (error) { this.refused(error); } finally {
      this.waiting = false;
      if (this.next !== null) this.ask();
      else this.later.shift()?.();
    }
  }

  // What the server refuses is taken back; a lost connection takes nothing back.
  refused(error) {
    refusal(error);
    if (error.lost || this.next !== null || this.good === null) return;
    if (JSON.stringify(this.past.at(-1)) === JSON.stringify(this.good)) this.past.pop();
    this.state.shapes[this.state.channel] = copied(this.good);
    this.editor.show(this.shape(), true);
    write(this.state);
  }

  // Steps that build on the curve as it is wait until it is drawn.
  settled(then) { if (this.waiting) this.later.push(then); else then(); }

  show() {
    const compared = this.kept.filter((one) => one.compared), standing = this.standing(), begun = standing !== UNDESIGNED;
    this.nichols.kept = compared.map((one) => one.curve);
    this.nichols.show({ ...this.frame, crossed: begun ? this.frame.crossed : [] }); // a loop to begin with keeps no limit yet
    this.plots.show(this.frame, compared.map((one) => one.curve));
    for (const chart of this.plots.all) chart.still = this.held;
    this.handles.show(this.shape(), this.basis.frequency_hz, this.frame.curves[0]);
    if (!this.view.querySelector(".factor:focus-within")) this.editor.show(this.shape(), false, this.held);
    const { unstable, crossed } = this.frame;
    const crossedText = unstable.length ? `Unstable: ${unstable.join(", ").replace(/\bnone\b/, "no load")}.` : begun && crossed.length ? `Beyond a limit: ${crossed.map((one) => REGIONS[one] ?? `${one} Hz`).join(", ")}.` : "";
    if (this.bits.crossed.textContent !== crossedText) { this.bits.crossed.textContent = crossedText; say(crossedText || (begun ? "Every limit is kept." : standing)); }
    this.bits.standing.textContent = standing;
    this.bits.tiles.classList.toggle("undesigned", !begun);
    this.buttons.undo.disabled = !this.past.length; this.buttons.redo.disabled = !this.future.length;
  }

  get held() { return Boolean(this.nichols?.dragged || this.handles?.dragged); }

  // Where this loop comes from.
  standing() {
    const here = JSON.stringify(this.shape()), { design, first } = this.basis;
    return here === JSON.stringify(design) ? "as designed" : here === JSON.stringify(first) ? UNDESIGNED : "shaped by hand";
  }

  take({ of, channel, figures }) {
    if (channel !== this.state.channel) return;
    this.refusal = figures.refused ?? "";
    this.figures = this.refusal ? null : figures;
    this.shown = this.figures?.tiles ?? this.shown?.map((one) => ({ ...one, value: "—", allowed: "", outcome: "not judged" })) ?? [];
    tiles(this.bits.tiles, this.shown);
    this.bits.verdict.textContent = this.refusal || `Verdict: ${figures.verdict.sentence}.`;
    this.tables();
    if (of === this.newest && !this.waiting && this.next === null) this.bits.tiles.setAttribute("aria-busy", "false");
  }

  // The tables below wait until nothing is held: their length changes.
  tables() {
    if (this.held) return;
    if (this.refusal) this.bits.tables.replaceChildren(make("h2", {}, "Figures"), make("p", { class: "crossed" }, this.refusal));
    if (!this.figures) return;
    const rows = designTable(this.figures.design, this.kept.filter((one) => one.compared));
    this.bits.tables.replaceChildren(make("h2", {}, "Figures"), make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Figures" }, rows), verdict(this.figures.verdict));
  }

  // Steps back and forth.
  remember() { this.past.push(copied(this.shape())); this.future = []; this.origin = null; }
  done() { write(this.state); this.show(); this.tables(); }
  undo() { this.step(this.past, this.future); }
  redo() { this.step(this.future, this.past); }

  step(from, to) {
    if (!from.length) return;
    to.push(copied(this.shape()));
    this.state.shapes[this.state.channel] = from.pop();
    this.request("draw", {}, performance.now());
    this.done();
  }

  remove(index) { this.change((shape) => shape.factors.splice(index, 1), true); this.done(); }

  async design() {
    const { display, channel } = this.state, before = this.figures;
    this.buttons.design.disabled = true;
    const end = counted("Designing", (words) => { this.buttons.design.textContent = words; });
    try {
      const { shape, command: line } = await this.link.ask("design", { display, channel });
      this.remember();
      this.state.shapes[channel] = this.basis.design = shape;
      if (before) this.store("before", before);
      this.bits.command.replaceChildren(command(line));
      this.request("draw", {}, performance.now());
      this.done();
      say("designed");
    } catch (error) { refusal(error); } finally { end(); this.buttons.design.disabled = false; this.buttons.design.textContent = "Design it"; }
  }

  // Designs that are kept, by name, in this browser.
  keep() {
    const name = `design ${this.kept.length + 1}`;
    if (this.figures) this.store(name, this.figures);
  }

  store(name, figures) {
    const curve = this.frame.curves[0], shape = name === "before" ? this.past.at(-1) : copied(this.shape());
    this.kept = [...this.kept.filter((one) => one.name !== name), { name, shape, curve, rows: figures.design, compared: true }];
    this.lists();
    this.show();
  }

  lists() {
    localStorage.setItem(this.keeping(), JSON.stringify(this.kept));
    const redo = () => { this.lists(); this.show(); this.tables(); };
    const entries = this.kept.map((one, i) => make("div", { class: "factor" },
      make("label", {}, "name", make("input", { value: one.name, "aria-label": `name of kept design ${i + 1}`, maxlength: 40, onchange: (event) => { one.name = event.target.value; redo(); } })),
      make("label", {}, "compare ", make("input", { type: "checkbox", checked: one.compared ? "" : null, onchange: (event) => { one.compared = event.target.checked; redo(); } })),
      make("button", { type: "button", onclick: () => { this.remember(); this.state.shapes[this.state.channel] = copied(one.shape); this.request("draw", {}, performance.now()); this.done(); } }, "Take up"),
      make("button", { type: "button", "aria-label": `Forget ${one.name}`, onclick: () => { this.kept.splice(i, 1); redo(); } }, "Forget")));
    this.bits.kept.replaceChildren(make("h2", {}, "Kept designs"), ...(entries.length ? entries : [make("p", {}, "None yet. “Keep” keeps the loop as it is, to compare with and to go back to.")]));
    this.tables();
    this.legend();
  }

  // The whole verdict, and the file: every channel must have its loop.
  async check() {
    this.buttons.check.disabled = true;
    try {
      const { verdict: found, text, command: line } = await this.link.ask("check", { display: this.state.display, shapes: this.state.shapes });
      this.bits.command.replaceChildren(command(line));
      const save = saved("Save controller.json", "controller.json", text);
      save.id = "save";
      this.bits.tables.replaceChildren(make("h2", { tabindex: "-1" }, "The whole display"), make("p", {}, save), verdict(found));
      save.focus();
      say(found.sentence);
      banner("");
    } catch (error) { refusal(error); } finally { this.buttons.check.disabled = false; }
  }

  again() { if (this.frame) this.request("draw", {}, performance.now()); }
  resize() { if (this.frame) { this.nichols.fill(); this.plots.resize(); this.show(); } }
  restyle() { if (this.frame) { this.plots.restyle(); this.show(); } }
}
