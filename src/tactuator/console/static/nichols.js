// The Nichols chart: open-loop gain against phase. Marks on the curve are its handles; the curve itself can be taken anywhere.
import { COARSE, digits, draggable, draw } from "./dom.js";

const NARROW = innerWidth < 600; // a phone: fewer units, so that the texts keep their size
const WIDTH = NARROW ? 370 : 640, HEIGHT = NARROW ? 400 : 560, LEFT = 46, RIGHT = 10, TOP = 10, BOTTOM = 40;
const NEAR_PX = 30;
const MARK = COARSE ? 8 : 5, FREE = MARK + 4; // radius of a mark, and how far from its middle a label begins
const STEP_DB = 0.5, STEP_DEG = 1;

export class Nichols {
  // moved: called with (hz, turn_deg, gain_db, begun). done: called when a movement ends. settled: calls back when what is
  // drawn is what was asked for.
  constructor(basis, moved, done, settled) {
    Object.assign(this, { basis, moved, done, settled, frame: null, kept: [], dragged: null });
    this.svg = draw("svg", { class: "nichols", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "group", "aria-label": "Nichols chart: open-loop gain against phase" });
    this.window = { left: -360, right: 0, bottom: -50, top: 40 };
    this.layers = {};
    const clip = draw("clipPath", { id: "inside" }, draw("rect", { x: LEFT, y: TOP, width: WIDTH - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM }));
    this.svg.append(clip);
    for (const name of ["ground", "regions", "templates", "kept", "curves", "grab", "marks", "axes"]) {
      this.layers[name] = draw("g", ["axes", "marks"].includes(name) ? {} : { "clip-path": "url(#inside)" });
      this.svg.append(this.layers[name]);
    }
    this.grab = draw("path", { class: "grab" });
    this.layers.grab.append(this.grab);
    draggable(this.grab, (event) => this.begin(event, this.nearest(event)));
    this.svg.onpointermove = (event) => this.drag(event);
    this.svg.onpointerup = this.svg.onpointercancel = () => this.end();
    this.marks = basis.marks_hz.map((hz) => this.mark(hz));
    this.ground();
  }

  x(phase) { return LEFT + (phase - this.window.left) / (this.window.right - this.window.left) * (WIDTH - LEFT - RIGHT); }
  y(gain) { return TOP + (this.window.top - gain) / (this.window.top - this.window.bottom) * (HEIGHT - TOP - BOTTOM); }

  at(event) {
    const box = this.svg.getBoundingClientRect(), { left, right, bottom, top } = this.window;
    const px = (event.clientX - box.left) * WIDTH / box.width, py = (event.clientY - box.top) * HEIGHT / box.height;
    return { phase: left + (px - LEFT) / (WIDTH - LEFT - RIGHT) * (right - left), gain: top - (py - TOP) / (HEIGHT - TOP - BOTTOM) * (top - bottom), px, py };
  }

  line(points, close = false) { return points.map(([p, g], i) => `${i ? "L" : "M"}${this.x(p).toFixed(1)} ${this.y(g).toFixed(1)}`).join("") + (close ? "Z" : ""); }
  curve(one) { return this.line(one.phase_deg.map((phase, i) => [phase, one.gain_db[i]])); }

  ground() {
    const { left, right, bottom, top } = this.window, { ground } = this.basis, labels = [];
    const turns = left < -360 ? [-360, 0] : [0];
    const turned = (points, turn) => points.map(([p, g]) => [p + turn, g]);
    this.layers.ground.replaceChildren(...ground.contours.flatMap(({ points }) => turns.map((turn) => draw("path", { class: "contour", d: this.line(turned(points, turn)) }))));
    for (const { level_db: level, points } of ground.contours) {
      const inside = points.filter(([p, g]) => p > left + 3 && p < right - (NARROW ? 26 : 14) && g > bottom + 2 && g < top - 2);
      const spot = inside.reduce((best, one) => (best === null || (level < -1 ? one[0] > best[0] : one[1] > best[1]) ? one : best), null);
      if (spot === null) continue;
      const [x, y] = [this.x(spot[0]), this.y(spot[1])];
      if (level > 1 || labels.some(([a, b]) => Math.abs(a - x) < 40 && Math.abs(b - y) < 13)) continue;
      labels.push([x, y]);
      this.layers.ground.append(draw("text", { x, y: y - 3, "text-anchor": "middle" }, `${level} dB`.replace("-", "−")));
    }
    this.regions = {};
    this.layers.regions.replaceChildren();
    for (const name of ["resonance", "sensitivity"]) {
      if (!ground[name]) continue;
      this.regions[name] = turns.map((turn) => draw("path", { class: "region", d: this.line(turned(ground[name], turn), true) }));
      this.regions[name].forEach((path) => path.append(draw("title", {}, name === "resonance" ? "|T| beyond its limit" : "|S| beyond its limit")));
      this.layers.regions.append(...this.regions[name]);
    }
    if (ground.phase !== null) {
      this.regions.phase = turns.map((turn) => draw("path", { class: "margin", d: this.line([[turn - 180 - ground.phase, 0], [turn - 180 + ground.phase, 0]]) }));
      this.layers.regions.append(...this.regions.phase);
    }
    this.axes();
  }

  axes() {
    const { left, right, bottom, top } = this.window, made = [draw("rect", { class: "axis", x: LEFT, y: TOP, width: WIDTH - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM })];
    for (let phase = Math.ceil(left / 90) * 90; phase <= right; phase += NARROW ? 90 : 45) made.push(draw("text", { x: this.x(phase), y: HEIGHT - BOTTOM + 15, "text-anchor": "middle" }, `${phase}°`.replace("-", "−")));
    for (let gain = Math.ceil(bottom / 10) * 10; gain <= top; gain += 10) made.push(draw("text", { x: LEFT - 6, y: this.y(gain) + 4, "text-anchor": "end" }, `${gain}`.replace("-", "−")));
    made.push(draw("text", { x: (LEFT + WIDTH) / 2, y: HEIGHT - 6, "text-anchor": "middle" }, "open-loop phase (degrees)"));
    made.push(draw("text", { x: 0, y: 0, "text-anchor": "middle", transform: `translate(12 ${HEIGHT / 2 - 20}) rotate(-90)` }, "open-loop gain (dB)"));
    for (const turn of left < -360 ? [-360, 0] : [0]) {
      const [x, y] = [this.x(turn - 180), this.y(0)];
      made.push(draw("path", { class: "axis", d: `M${x - 6} ${y}H${x + 6}M${x} ${y - 6}V${y + 6}`, stroke: "currentColor" }));
    }
    this.layers.axes.replaceChildren(...made);
  }

  // The window holds what is drawn; it stands still while something is dragged.
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
    this.drawn = frame.curves.flatMap((one) => one.phase_deg.map((phase, i) => [this.x(phase), this.y(one.gain_db[i])])).filter((_, i) => i % 2 === 0);
    for (const one of this.marks) this.place(one, placed);
  }

  point(hz) {
    const f = this.basis.frequency_hz, { phase_deg: phases, gain_db: gains } = this.frame.curves[0];
    const i = Math.max(1, f.findIndex((one) => one >= hz)), share = Math.log(hz / f[i - 1]) / Math.log(f[i] / f[i - 1]);
    return { hz, phase: phases[i - 1] + share * (phases[i] - phases[i - 1]), gain: gains[i - 1] + share * (gains[i] - gains[i - 1]) };
  }

  mark(hz) {
    const dot = draw("circle", { class: "mark", r: MARK, tabindex: 0, role: "slider", "aria-label": `Point of the curve at ${hz} Hz: up and down its gain, left and right its phase`, "aria-orientation": "vertical" });
    const label = draw("text", {}, `${hz} Hz`);
    draggable(dot, (event) => this.begin(event, hz));
    dot.onkeydown = (event) => {
      const [turn, rise] = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowRight: [1, 0], ArrowLeft: [-1, 0] }[event.key] ?? [0, 0];
      if (turn === 0 && rise === 0) return;
      event.preventDefault();
      const many = event.shiftKey ? 5 : 1;
      this.settled(() => { this.moved(hz, turn * STEP_DEG * many, this.point(hz).gain + rise * STEP_DB * many, true); this.done(); });
    };
    this.layers.marks.append(draw("g", {}, dot, label));
    return { hz, dot, label };
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
    const free = spots.find(([dx, dy]) => x + dx > LEFT && x + dx + wide < WIDTH - RIGHT && placed.every(([a, b, w]) => Math.abs(b - y - dy) > 12 || x + dx + wide - 6 < a || x + dx > a + w - 6) && this.clear(x + dx, y + dy, wide));
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

  begin(event, hz) {
    if (hz === null) return;
    event.preventDefault();
    this.svg.setPointerCapture(event.pointerId);
    this.dragged = { hz, phase: this.point(hz).phase, begun: true };
    this.svg.setAttribute("aria-label", `Nichols chart: the point at ${digits(hz)} Hz is being moved`);
  }

  drag(event) {
    if (this.dragged === null) return;
    const { phase, gain } = this.at(event), { hz, begun } = this.dragged;
    this.dragged.begun = false;
    this.moved(hz, phase - this.dragged.phase, gain, begun);
  }

  end() { if (this.dragged !== null) { this.dragged = null; this.done(); } }
}
