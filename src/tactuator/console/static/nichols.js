// The Nichols chart: open-loop gain against phase. Marks on the curve are its handles; the curve itself can be taken anywhere.
import { COARSE, digits, draggable, draw, gone, large, make } from "./dom.js";
import { Value } from "./value.js";

const LEFT = 46, RIGHT = 10, TOP = 10, BOTTOM = 40, LOWEST = 340, HIGHEST = 560;
const NEAR_PX = 30;
const MARK = COARSE ? 8 : 5, FREE = MARK + 4; // radius of a mark, and how far from its middle a label begins
const STEP_DB = 0.5, STEP_DEG = 1;

export class Nichols {
  // moved: called with (hz, turn_deg, gain_db, begun). done: called when a movement ends. settled: calls back when what is
  // drawn is what was asked for.
  constructor(basis, moved, done, settled) {
    Object.assign(this, { basis, moved, done, settled, frame: null, kept: [], dragged: null });
    this.svg = draw("svg", { class: "nichols", role: "group", "aria-label": "Nichols chart: open-loop gain against phase" });
    this.out = make("output", { class: "readout", "aria-hidden": "true" });
    this.box = make("div", { class: "plot" }, this.svg);
    this.value = new Value(this.box);
    this.cross = draw("path", { class: "cross" });
    this.window = { left: -360, right: 0, bottom: -50, top: 40 };
    this.layers = {};
    this.clip = draw("rect", { x: LEFT, y: TOP });
    this.svg.append(draw("clipPath", { id: "inside" }, this.clip));
    for (const name of ["ground", "regions", "templates", "kept", "curves", "grab", "axes", "marks"]) {
      this.layers[name] = draw("g", ["axes", "marks"].includes(name) ? {} : { "clip-path": "url(#inside)" });
      this.svg.append(this.layers[name]);
    }
    this.grab = draw("path", { class: "grab" });
    this.layers.grab.append(this.grab);
    draggable(this.grab, (event) => this.take(event));
    this.svg.onpointermove = (event) => { this.drag(event); this.read(event); };
    this.svg.onpointerleave = () => { this.out.textContent = ""; this.cross.setAttribute("d", ""); };
    this.svg.onpointerup = this.svg.onpointercancel = () => this.end();
    this.layers.axes.before(this.cross);
    this.marks = basis.marks_hz.map((hz) => this.mark(hz));
    this.free = this.mark(null); // where the curve was taken beside a mark
  }

  // The chart takes the room that there is, in units of the page's text.
  fill() {
    this.wide = Math.max(280, this.box.clientWidth) / large();
    this.high = Math.min(HIGHEST, Math.max(LOWEST, this.wide));
    this.svg.setAttribute("viewBox", `0 0 ${this.wide} ${this.high}`);
    this.clip.setAttribute("width", this.wide - LEFT - RIGHT); this.clip.setAttribute("height", this.high - TOP - BOTTOM);
    this.ground();
  }

  x(phase) { return LEFT + (phase - this.window.left) / (this.window.right - this.window.left) * (this.wide - LEFT - RIGHT); }
  y(gain) { return TOP + (this.window.top - gain) / (this.window.top - this.window.bottom) * (this.high - TOP - BOTTOM); }

  at(event) {
    const box = this.svg.getBoundingClientRect(), { left, right, bottom, top } = this.window;
    const px = (event.clientX - box.left) * this.wide / box.width, py = (event.clientY - box.top) * this.high / box.height;
    return { phase: left + (px - LEFT) / (this.wide - LEFT - RIGHT) * (right - left), gain: top - (py - TOP) / (this.high - TOP - BOTTOM) * (top - bottom), px, py };
  }

  line(points, close = false) { return points.map(([p, g], i) => `${i ? "L" : "M"}${this.x(p).toFixed(1)} ${this.y(g).toFixed(1)}`).join("") + (close ? "Z" : ""); }
  curve(one) { return this.line(one.phase_deg.map((phase, i) => [phase, one.gain_db[i]])); }

  ground() {
    const { left, right, bottom, top } = this.window, { ground } = this.basis, labels = [];
    const turns = left < -360 ? [-360, 0] : [0];
    const turned = (points, turn) => points.map(([p, g]) => [p + turn, g]);
    this.levels = [];
    this.layers.ground.replaceChildren(...ground.contours.flatMap(({ points }) => turns.map((turn) => draw("path", { class: "contour", d: this.line(turned(points, turn)) }))));
    const beside = 26 * (right - left) / (this.wide - LEFT - RIGHT); // half a label
    for (const { level_db: level, points } of ground.contours) {
      const inside = points.filter(([p, g]) => p > left + beside && p < right - beside && g > bottom + 2 && g < top - 2);
      const spot = inside.reduce((best, one) => (best === null || (level < -1 ? one[0] > best[0] : one[1] > best[1]) ? one : best), null);
      if (spot === null) continue;
      const [x, y] = [this.x(spot[0]), this.y(spot[1])];
      if (level > 1 || labels.some(([a, b]) => Math.abs(a - x) < 40 && Math.abs(b - y) < 13)) continue;
      labels.push([x, y]);
      const label = draw("text", { x, y: y - 3, "text-anchor": "middle" }, `${level} dB`.replace("-", "−"));
      this.layers.ground.append(label);
      this.levels.push({ x: x - 19, y: y - 3, label });
    }
    this.regions = {};
    this.layers.regions.replaceChildren();
    for (const name of ["resonance", "sensitivity"]) {
      if (!ground[name]) continue;
      this.regions[name] = turns.map((turn) => draw("path", { class: "region", d: this.line(turned(ground[name], turn), true) }));
      this.layers.regions.append(...this.regions[name]);
    }
    if (ground.phase !== null) {
      this.regions.phase = turns.map((turn) => draw("path", { class: "margin", d: this.line([[turn - 180 - ground.phase, 0], [turn - 180 + ground.phase, 0]]) }));
      this.layers.regions.append(...this.regions.phase);
    }
    this.axes();
  }

  axes() {
    const { left, right, bottom, top } = this.window, made = [draw("rect", { class: "axis", x: LEFT, y: TOP, width: this.wide - LEFT - RIGHT, height: this.high - TOP - BOTTOM })];
    const step = [45, 90, 180, 360].find((degrees) => this.x(degrees) - this.x(0) >= 48) ?? 360;  // a label is as wide
    for (let phase = Math.ceil(left / step) * step; phase <= right; phase += step) made.push(draw("text", { x: this.x(phase), y: this.high - BOTTOM + 15, "text-anchor": "middle" }, `${phase}°`.replace("-", "−")));
    for (let gain = Math.ceil(bottom / 10) * 10; gain <= top; gain += 10) made.push(draw("text", { x: LEFT - 6, y: this.y(gain) + 4, "text-anchor": "end" }, `${gain}`.replace("-", "−")));
    made.push(draw("text", { x: (LEFT + this.wide) / 2, y: this.high - 6, "text-anchor": "middle" }, "open-loop phase (degrees)"));
    made.push(draw("text", { x: 0, y: 0, "text-anchor": "middle", transform: `translate(12 ${this.high / 2 - 20}) rotate(-90)` }, "open-loop gain (dB)"));
    for (const turn of left < -360 ? [-360, 0] : [0]) {
      const [x, y] = [this.x(turn - 180), this.y(0)];
      made.push(draw("path", { class: "axis", d: `M${x - 6} ${y}H${x + 6}M${x} ${y - 6}V${y + 6}`, stroke: "currentColor" }));
    }
    this.layers.axes.replaceChildren(...made);
  }

  // The window holds what is drawn; it does not change while something is dragged.
  fit() {
    let left = -360, top = 30;
    for (const one of this.frame.curves) {
      one.gain_db.forEach((gain, i) => {
        if (gain > -50) left = Math.min(left, one.phase_deg[i]);
        top = Math.max(top, Math.min(gain, 90));
      });
    }
    const window = { left: Math.max(-720, Math.floor((left - 5) / 45) * 45), right: 0, bottom: -50, top: Math.ceil((top + 3) / 10) * 10 };
    if (left >= -360) window.left = -360;
    if (JSON.stringify(window) !== JSON.stringify(this.window)) { this.window = window; this.ground(); }
  }

  show(frame) {
    this.frame = frame;
    if (this.dragged === null) this.fit();
    this.layers.templates.replaceChildren(...frame.templates.map((points) => draw("path", { class: "template", d: this.line(points, true) })));
    const paths = frame.curves.map((one, i) => draw("path", { class: "curve", d: this.curve(one), stroke: `var(--${["nominal", "load", "load2"][i] ?? "load"})`, "stroke-dasharray": i ? "7 4" : "none" }));
    this.layers.curves.replaceChildren(...paths.reverse());
    this.grab.setAttribute("d", this.curve(frame.curves[0]));
    this.layers.kept.replaceChildren(...this.kept.map((one) => draw("path", { class: "kept", d: this.curve(one) })));
    for (const [name, paths] of Object.entries(this.regions)) paths.forEach((path) => path.classList.toggle("over", frame.crossed.includes(name)));
    const placed = [];
    this.drawn = [...frame.curves, ...this.kept].flatMap((one) => one.phase_deg.map((phase, i) => [this.x(phase), this.y(one.gain_db[i])])).filter((_, i) => i % 2 === 0);
    if (this.basis.ground.phase !== null) for (let at = -1; at <= 1; at += 0.1) this.drawn.push([this.x(at * this.basis.ground.phase - 180), this.y(0)]);
    for (const one of [...this.marks, this.free]) if (one.hz !== null) this.place(one, placed);
    // what names the ground gives way to what is dragged
    for (const { x, y, label } of this.levels) label.setAttribute("visibility", this.clear(x, y, 46) && placed.every(([a, b, wide]) => Math.abs(b - y) > 12 || a > x + 40 || a + wide < x) ? "visible" : "hidden");
    this.value.show();
  }

  // The crosshair, and what lies under it.
  read(event) {
    const { phase, gain, px, py } = this.at(event), { left, right, bottom, top } = this.window, inside = phase > left && phase < right && gain > bottom && gain < top;
    const hz = inside && this.frame ? this.nearest(event) : null;
    this.cross.setAttribute("d", inside ? `M${LEFT} ${py}H${this.wide - RIGHT}M${px} ${TOP}V${this.high - BOTTOM}` : "");
    this.out.textContent = inside ? `${phase.toFixed(0)}°, ${gain.toFixed(1)} dB${hz === null ? "" : ` · curve: ${digits(hz)} Hz`}` : "";
  }

  point(hz) {
    const f = this.basis.frequency_hz, { phase_deg: phases, gain_db: gains } = this.frame.curves[0];
    const i = Math.max(1, f.findIndex((one) => one >= hz)), share = Math.log(hz / f[i - 1]) / Math.log(f[i] / f[i - 1]);
    return { hz, phase: phases[i - 1] + share * (phases[i] - phases[i - 1]), gain: gains[i - 1] + share * (gains[i] - gains[i - 1]) };
  }

  mark(hz) {
    const name = hz === null ? "Point of the curve that was taken" : `Point of the curve at ${hz} Hz`, one = { hz };
    const dot = one.dot = draw("circle", { class: "mark", r: MARK, tabindex: hz === null ? -1 : 0, role: "slider", "aria-label": `${name}: up and down its gain, left and right its phase`, "aria-orientation": "vertical" });
    one.label = draw("text", {}, hz === null ? "" : `${hz} Hz`);
    const move = (turn, gain) => this.settled(() => { this.moved(one.hz, turn, gain(this.point(one.hz).gain), true); this.done(); });
    draggable(dot, (event) => this.begin(event, one));
    dot.onkeydown = (event) => {
      const [turn, rise] = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowRight: [1, 0], ArrowLeft: [-1, 0] }[event.key] ?? [0, 0];
      if (turn === 0 && rise === 0) return;
      event.preventDefault();
      const many = event.shiftKey ? 5 : 1;
      move(turn * STEP_DEG * many, (gain) => gain + rise * STEP_DB * many);
    };
    this.value.attach(dot, () => `${digits(one.hz)} Hz`, () => [
      { name: "", unit: "dB", value: this.point(one.hz).gain, set: (to) => move(0, () => Math.max(-200, Math.min(200, to))) },
      { name: "", unit: "°", value: this.point(one.hz).phase, set: (to) => move(to - this.point(one.hz).phase, (gain) => gain) }]);
    const group = draw("g", {}, dot, one.label);
    if (hz === null) group.setAttribute("visibility", "hidden");
    this.layers.marks.append(group);
    return one;
  }

  place({ hz, dot, label }, placed) {
    const { phase, gain } = this.point(hz), { left, right, bottom, top } = this.window;
    const inside = phase > left && phase < right && gain > bottom && gain < top, group = dot.parentNode;
    group.setAttribute("visibility", inside ? "visible" : "hidden");
    const [x, y] = [this.x(phase), this.y(gain)];
    dot.setAttribute("cx", x); dot.setAttribute("cy", y);
    dot.setAttribute("aria-valuemin", -200); dot.setAttribute("aria-valuemax", 200);
    dot.setAttribute("aria-valuenow", gain.toFixed(1));
    dot.setAttribute("aria-valuetext", `${gain.toFixed(1)} dB at ${phase.toFixed(0)} degrees`);
    const wide = FREE + 6.4 * label.textContent.length;
    const spots = [[FREE, 4], [-wide, 4], [FREE, -8], [FREE, 16], [-wide, -8], [-wide, 16], [-wide / 2 + 4, -FREE - 2], [-wide / 2 + 4, FREE + 11], [FREE + 15, 4], [-wide - 16, 4]];
    const free = spots.find(([dx, dy]) => x + dx > LEFT && x + dx + wide < this.wide - RIGHT && placed.every(([a, b, w]) => Math.abs(b - y - dy) > 12 || x + dx + wide - 6 < a || x + dx > a + w - 6) && this.clear(x + dx, y + dy, wide));
    label.setAttribute("visibility", inside && free ? "visible" : "hidden");
    if (!inside) return;
    placed.push([x - MARK - 1, y + 4, 2 * MARK + 2]);
    if (free) { label.setAttribute("x", x + free[0]); label.setAttribute("y", y + free[1]); placed.push([x + free[0], y + free[1], wide]); }
  }

  // Whether a label at this place leaves the curves alone.
  clear(x, y, wide) {
    return this.drawn.every(([a, b]) => a < x - 1 || a > x + wide - 8 || b < y - 11 || b > y + 3);
  }

  nearest(event) {
    const { px, py } = this.at(event), f = this.basis.frequency_hz, { phase_deg: phases, gain_db: gains } = this.frame.curves[0];
    let best = 0, least = Infinity;
    f.forEach((_, i) => { const d = Math.hypot(this.x(phases[i]) - px, this.y(gains[i]) - py); if (d < least) { least = d; best = i; } });
    return least < NEAR_PX ? f[best] : null;
  }

  // The curve is taken where there is no mark.
  take(event) {
    this.free.hz = this.nearest(event);
    if (this.free.hz === null) return;
    this.place(this.free, []);
    this.begin(event, this.free);
  }

  begin(event, { hz, dot }) {
    event.preventDefault();
    dot.focus();
    this.svg.setPointerCapture(event.pointerId);
    this.dragged = { hz, x: event.clientX, y: event.clientY, from: this.at(event), gain: this.point(hz).gain, begun: true };
  }

  // By how far the pointer has gone since the point was taken, and no further.
  drag(event) {
    if (this.dragged === null) return;
    const { hz, x, y, from, gain: before, begun } = this.dragged, { phase, gain } = this.at({ clientX: gone(event.clientX, x), clientY: gone(event.clientY, y) });
    this.dragged.begun = false;
    this.moved(hz, phase - from.phase, before + gain - from.gain, begun);
  }

  end() { if (this.dragged !== null) { this.dragged = null; this.done(); } }
}
