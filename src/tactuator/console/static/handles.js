// Handles on |L|: one for each factor at its frequency, and one for the gain. Sideways: frequency; up and down: what else it has.
import { COARSE, digits, draggable, draw, gone, nearest } from "./dom.js";
import { PARAMETERS, highest, limited, namesOf, second, stepped, titleOf } from "./shape.js";
import { Value } from "./value.js";

const SIZE = COARSE ? " scale(1.7)" : "";
const KEYS = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class Handles {
  // changed: called with (change of the shape, begun); done: when a movement ends; removed: with a factor's index.
  constructor(plot, changed, done, removed) {
    Object.assign(this, { plot, changed, done, removed, dragged: null, drawn: [] });
    this.layer = draw("svg", { class: "handles", role: "group", "aria-label": "Handles of the controller on the open loop’s curve" });
    this.value = new Value(plot.host);
    this.layer.onpointermove = (event) => this.drag(event);
    this.layer.onpointerup = this.layer.onpointercancel = () => { if (this.dragged !== null) { this.dragged = null; this.done(); } };
  }

  show(shape, frequencies, curve) {
    Object.assign(this, { shape, frequencies, curve });
    this.plot.drawn = () => this.settle(); // its scales hold what is drawn only then
  }

  settle() {
    const { plot: { plot: chart }, shape, frequencies, curve } = this;
    if (this.layer.parentNode !== chart.over) chart.over.append(this.layer);
    const places = shape.factors.map((factor, index) => ({ index, factor })).filter(({ factor }) => "hz" in factor);
    while (this.drawn.length > places.length + 1) this.drawn.pop().remove();
    while (this.drawn.length < places.length + 1) { const one = this.made(); this.drawn.push(one); this.layer.append(one); }
    const at = (hz) => { const i = Math.min(frequencies.length - 1, Math.max(0, frequencies.findIndex((one) => one >= hz))); return curve.gain_db[i]; };
    const crossing = curve.gain_db.findIndex((gain, i) => i > 0 && gain < 0 && curve.gain_db[i - 1] >= 0);
    // while the gain is held, its handle rises with the curve at the place where it was taken
    const held = this.dragged?.index === -1 ? this.dragged.hz : null, hz = held ?? frequencies[Math.max(0, crossing)];
    this.place(this.drawn[0], { index: -1, hz, db: held === null && crossing >= 0 ? 0 : at(hz), label: "gain", value: shape.gain_db, text: `${shape.gain_db.toFixed(1)} dB` });
    places.forEach(({ index, factor }, i) => {
      const more = second(factor), text = `${digits(factor.hz)} Hz${more ? `, ${PARAMETERS[more].title} ${digits(factor[more])}` : ""}`;
      this.place(this.drawn[i + 1], { index, hz: factor.hz, db: at(factor.hz), label: titleOf(factor), value: factor.hz, text });
    });
    this.value.show();
  }

  // What can be typed at a handle.
  fields(index) {
    const set = (how) => (to) => { this.changed(how(to), true); this.done(); };
    if (index < 0) return [{ name: "", unit: "dB", value: this.shape.gain_db, set: set((to) => (shape) => { shape.gain_db = to; }) }];
    const factor = this.shape.factors[index];
    return factor ? namesOf(factor).map((name) => ({ name: name === "hz" ? "" : PARAMETERS[name].title, unit: PARAMETERS[name].unit, value: factor[name], set: set((to) => (shape) => { shape.factors[index][name] = limited(name, to); }) })) : [];
  }

  made() {
    const one = draw("path", { class: "handle", tabindex: 0, role: "slider" });
    draggable(one, (event) => {
      const taken = nearest(this.drawn, event);
      event.preventDefault();
      taken.focus();
      this.layer.setPointerCapture(event.pointerId);
      this.dragged = { index: taken.index, hz: taken.hz, x: event.clientX, y: event.clientY, from: structuredClone(this.shape), begun: true };
    });
    this.value.attach(one, () => (one.index < 0 ? "gain" : titleOf(this.shape.factors[one.index] ?? { kind: "" })), () => this.fields(one.index));
    one.onkeydown = (event) => this.key(event, one.index);
    return one;
  }

  place(node, { index, hz, db, label, value, text }) {
    const chart = this.plot.plot, high = chart.over.clientHeight;
    const x = chart.valToPos(hz, "x"), y = Math.max(8, Math.min(high - 8, chart.valToPos(db, "y")));
    Object.assign(node, { index, hz });
    node.classList.toggle("gain", index < 0);
    node.setAttribute("d", FORMS[index < 0 ? "gain" : label] ?? FORMS.other);
    node.setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})${SIZE}`);
    node.setAttribute("aria-label", index < 0 ? "gain, up and down" : `${label}: left and right its frequency`);
    node.setAttribute("aria-valuemin", index < 0 ? -200 : 0.01);
    node.setAttribute("aria-valuemax", index < 0 ? 200 : highest("hz"));
    node.setAttribute("aria-valuenow", value);
    node.setAttribute("aria-valuetext", text);
  }

  key(event, index) {
    if (event.key === "Delete" && index >= 0) { event.preventDefault(); this.removed(index); return; }
    const [along, up] = KEYS[event.key] ?? [0, 0];
    if (along === 0 && up === 0) return;
    event.preventDefault();
    this.apply(index, along * (event.shiftKey ? 5 : 1), up * (event.shiftKey ? 5 : 1), true);
    this.done();
  }

  apply(index, along, up, begun) {
    this.changed((shape) => {
      if (index < 0) { shape.gain_db = Math.max(-200, Math.min(200, shape.gain_db + 0.5 * up)); return; }
      const factor = shape.factors[index], more = second(factor);
      factor.hz = stepped("hz", factor.hz, along);
      if (more && up !== 0) factor[more] = stepped(more, factor[more], 2 * up);
    }, begun);
  }

  // By how far the pointer has gone since the handle was taken, and no further.
  drag(event) {
    if (this.dragged === null) return;
    const { plot: { plot: chart } } = this, { index, begun, from, x, y } = this.dragged, box = chart.over.getBoundingClientRect(), at = (px, py) => [chart.posToVal(px - box.left, "x"), chart.posToVal(py - box.top, "y")];
    const [hz, db] = at(gone(event.clientX, x), gone(event.clientY, y)), [hz0, db0] = at(x, y), rise = db - db0;
    this.dragged.begun = false;
    this.changed((shape) => {
      if (index < 0) { shape.gain_db = Math.max(-200, Math.min(200, from.gain_db + rise)); return; }
      const factor = shape.factors[index], { [second(factor)]: more, hz: before } = from.factors[index];
      factor.hz = limited("hz", before * (hz / hz0));
      if (more !== undefined) factor[second(factor)] = limited(second(factor), second(factor) === "depth_db" ? more + rise : more * 1.03 ** rise);
    }, begun);
  }
}

const ROUND = "M-7 0a7 7 0 1 0 14 0a7 7 0 1 0 -14 0Z", CROSS = "M-7 -5L-5 -7L0 -2L5 -7L7 -5L2 0L7 5L5 7L0 2L-5 7L-7 5L-2 0Z";
const FORMS = {
  zero: ROUND, "pair of zeros": `${ROUND}M-3.5 0a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0 -7 0Z`, pole: CROSS, "pair of poles": `${CROSS}M-10 0H-8M8 0H10`,
  gain: "M0 -10L6 -3H2V3H6L0 10L-6 3H-2V-3H-6Z", notch: "M-8 -7H8L0 8Z", other: "M0 -8L8 0L0 8L-8 0Z",
};
