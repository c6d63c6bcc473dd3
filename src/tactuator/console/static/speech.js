// The view Speech: a file is dropped; asked, felt and their difference, by finger, over time and over frequency.
import { write } from "./address.js";
import { Chart } from "./chart.js";
import { colour, command, counted, displayName, make, numberIn, refusal, saveMade, say } from "./dom.js";
import { Drop } from "./drop.js";
import { table } from "./figures.js";
import { LivePanel } from "./live.js";
import { takenRig } from "./rig.js";
import { term } from "./words.js";

const LOW = -10, HIGH = 55, APART = 3, HEARD = 10;
const NAMED = [2, 5, 10, 20, 50, 100, 200];

export default class Speech {
  constructor(view, link, state) { Object.assign(this, { view, link, state, own: state.own, charts: [], maps: [] }); }

  async open() {
    const { view, link, state } = this;
    const [display, { codings, level }] = [await link.ask("open", { display: state.display }), await link.ask("speech.codings")];
    if (this.closed) return;
    this.drop = new Drop(link, { label: "Speech file", accept: "audio/*", hint: "Drop a sound file here: WAV, FLAC, Ogg or AIFF.", example: "speech.wav",
      taken: (file, name, content) => { Object.assign(this.own, { file, name }); this.heard.hidden = !content; if (content) this.heard.src = URL.createObjectURL(content); return this.render(); } });
    this.heard = make("audio", { controls: "", hidden: "", "aria-label": "The speech file, as it sounds" });
    const coding = make("select", { id: "coding", onchange: () => { this.own.coding = coding.value; this.again(); } }, ...codings.map((name) => make("option", { value: name, selected: name === this.own.coding ? "" : null }, name)));
    const input = make("input", { id: "level", type: "number", min: "-60", max: "55", step: "1", value: this.own.level ?? level, onchange: () => { if (!Number.isNaN(numberIn(input))) { this.own.level = input.value; this.again(); } } });
    this.found = make("div", { class: "found" });
    this.player = make("div", { class: "player" });
    this.rig = takenRig(() => this.standing(), ({ heard, refused }) => { if (heard) this.live.take(heard); if (refused) this.live.refused(); return false; });
    this.live = new LivePanel(this.rig, state, codings, level);
    view.replaceChildren(make("div", { class: "spoken" }, make("h1", {}, "Speech on ", display.name),
      make("p", { class: "intro" }, "The file is coded onto the fingers at a level in dB SL (", term("sensation level"), "), and felt on the simulated display with the controller that “tactuator design” makes."),
      make("div", { class: "panel asking" }, this.drop.box, this.heard, make("div", { class: "factor" },
        make("div", {}, make("label", { for: "coding" }, "coding"), coding), make("div", {}, make("label", { for: "level" }, "level, dB SL"), input))), this.player, this.found, this.live.box));
    this.standing();
    if (this.own.file) { this.drop.name.textContent = this.own.name ?? ""; await this.again(); }
  }

  close() { this.closed = true; this.rig?.close(); }

  // The rig of the console, where there is one: the reference is played on it as it is, and the stop is always there.
  standing() {
    const { rig } = this, there = rig.standing;
    if (this.closed) return;
    this.live?.standing();
    if (rig.absent || !there || (!this.made && there.mode === "idle")) { this.player.replaceChildren(); return; }
    if (!this.made) { this.player.replaceChildren(rig.bar); return; }
    if (!this.play) {
      this.play = make("button", { type: "button", id: "play-reference", class: "first", onclick: () => this.onRig() }, "Play on the rig");
      this.playing = make("p", { id: "playing", role: "status" });
    }
    const wave = there.wave, foreign = this.state.display !== "file";
    this.play.disabled = this.busy || !rig.mayPlay || foreign || wave !== null || !["idle", "live"].includes(there.mode);
    this.playing.textContent = foreign ? `The rig is that of ${displayName("file")}; open that one to play here.` : wave?.kind === "file" ? "It plays." : this.busy ? "A controller is designed and loaded." : "";
    if (!this.player.contains(this.play)) this.player.replaceChildren(rig.bar, make("div", { class: "bar" }, this.play, command(this.made.play)), this.playing);
  }

  async onRig() {
    const { rig, made } = this;
    this.busy = true;
    this.standing();
    const loaded = rig.standing.loaded || await rig.do("controller", { source: "design" });
    if (loaded && await rig.do("live")) rig.forFile = Boolean(await rig.do("wave", { wave: { kind: "file", file: made.key, level_db_sl: made.peak_db_sl, channels: rig.standing.channels.map((one) => one.name) } }));
    this.busy = false;
    this.standing();
  }

  again() { return this.own.file ? this.render().catch((error) => (error.lost ? undefined : this.drop.refuse(error.message))) : undefined; }

  async render() {
    write(this.state);
    const { file, coding, level } = this.own, busy = make("p", { role: "status" }, "Rendering");
    this.found.prepend(busy);
    const end = counted("Rendering and feeling it", (words) => { busy.textContent = words; });
    try {
      this.show(await this.link.ask("speech.render", { display: this.state.display, file, ...(coding ? { coding } : {}), ...(level ? { level: Number(level) } : {}) }));
      this.drop.refuse("");
    } finally { end(); busy.remove(); }
  }

  show(found) {
    const head = ["finger", "peak, dB SL", "limiter, dB", "felt − asked, rms dB", "median frame, dB", "95 % of frames, dB"];
    this.charts = []; this.maps = []; this.made = found;
    const files = found.files.map((name) => make("button", { type: "button", class: "saving", "data-name": name, onclick: () => saveMade(this.link.token, found.key, name).catch(refusal) }, `Save ${name}`));
    const panels = found.fingers.map((finger) => {
      const chart = new Chart(`${finger.name}: level (dB SL) over frequency (Hz)`, { log: true, height: 190 });
      this.charts.push([chart, finger]);
      const maps = ["asked", "felt", "difference"].map((what) => this.map(finger, what));
      return make("div", { class: "panel" }, make("h2", {}, finger.name), make("div", { class: "maps" }, ...maps), chart.box);
    });
    this.found.replaceChildren(make("div", { class: "bar" }, ...files, make("span", { class: "gap" }), command(found.command)), ...(this.rig.absent ? [command(found.play)] : []),
      ...found.notes.map((text) => make("p", {}, `Note: ${text}.`)),
      make("div", { class: "scroll panel narrow", tabindex: "0", role: "region", "aria-label": "Figures" }, table("Asked and felt", head, found.rows)),
      make("p", {}, `The pictures show ${Math.min(found.duration_s, found.shown_s).toFixed(1)} s. A difference is shown where ${HEARD} dB SL or more was asked. ${found.hum}`),
      ...panels);
    this.draw();
    this.standing();
    say("rendered");
  }

  map(finger, what) {
    const canvas = make("canvas", { width: 560, height: 260, role: "img", "aria-label": `${finger.name}, ${what}: levels in third octaves over time` });
    this.maps.push({ canvas, finger, what });
    return make("figure", {}, make("figcaption", {}, what), canvas);
  }

  draw() {
    for (const one of this.maps) this.picture(one);
    for (const [chart, finger] of this.charts) {
      const line = (y, name, hue, dash) => { const there = finger.hz.map((_, i) => i).filter((i) => y[i] !== null && y[i] > -40); return { name, hue, dash, x: there.map((i) => finger.hz[i]), y: there.map((i) => y[i]) }; };
      const { hum } = finger, heard = { name: "mains hum that the model expects", hue: "limit", x: hum.frequency_hz, y: hum.level_db_sl, points: true };
      chart.show([line(finger.asked, "asked", "nominal"), line(finger.felt, "felt", "load", [7, 4]), heard]);
    }
  }

  // Levels in third octaves over time, with both axes and the scale of the colours.
  picture({ canvas, finger, what }) {
    const ctx = canvas.getContext("2d"), [ground, full, below, faint] = ["paper", "nominal", "sense", "faint"].map(colour), differs = what === "difference", bands = finger.hz.length;
    const size = Math.min(1.8, Math.max(1, canvas.width / (canvas.clientWidth || canvas.width))); // of the text, where the picture is drawn small
    const [LEFT, RIGHT, TOP, BOTTOM] = [36, 62, 20, 20].map((room) => room * size), wide = canvas.width - LEFT - RIGHT, tall = canvas.height - TOP - BOTTOM, high = tall / bands, length = Math.max(...finger.parts.map((part) => part.asked.length * part.seconds));
    const write = (text, x, y, align = "right") => { ctx.textAlign = align; ctx.fillText(text, x, y); };
    const shade = (value) => { ctx.fillStyle = differs && value < 0 ? below : full; ctx.globalAlpha = Math.max(0, Math.min(1, differs ? Math.abs(value) / APART : (value - LOW) / (HIGH - LOW))); };
    ctx.globalAlpha = 1; ctx.fillStyle = ground; ctx.fillRect(0, 0, canvas.width, canvas.height);
    let first = 0;
    for (const part of finger.parts) {
      const step = wide * part.seconds / length;
      part.asked.forEach((row, t) => row.forEach((asked, band) => {
        const felt = part.felt[t][band], value = differs ? (asked === null || felt === null || asked < HEARD ? null : felt - asked) : what === "asked" ? asked : felt;
        if (value === null) return;
        shade(value);
        ctx.fillRect(LEFT + t * step, TOP + tall - (first + band + 1) * high, step + 0.5, high + 0.5);
      }));
      first += part.hz.length;
    }
    const [bottom, top] = differs ? [-APART, APART] : [LOW, HIGH], bar = canvas.width - RIGHT + 12 * size;
    for (let i = 0; i < tall; i += 1) { shade(bottom + (top - bottom) * (1 - i / tall)); ctx.fillRect(bar, TOP + i, 12 * size, 1); }
    ctx.globalAlpha = 1; ctx.fillStyle = ctx.strokeStyle = faint; ctx.font = `${13 * size}px system-ui`;
    ctx.strokeRect(LEFT, TOP, wide, tall); ctx.strokeRect(bar, TOP, 12 * size, tall);
    [[top, 10 * size], [(top + bottom) / 2, tall / 2 + 4 * size], [bottom, tall]].forEach(([value, y]) => write(`${Math.round(value)}`.replace("-", "−"), bar + 15 * size, TOP + y, "left"));
    write(differs ? "dB" : "dB SL", canvas.width - 2, TOP - 5);
    write("Hz", LEFT - 6, TOP - 5);
    for (const hz of NAMED) { const band = finger.hz.findIndex((one) => Math.abs(Math.log(one / hz)) < 0.1); if (band >= 0) write(String(hz), LEFT - 6, TOP + tall - (band + 0.5) * high + 4 * size); }
    const every = [0.5, 1, 2, 5, 10].find((one) => length / one <= 6 / size) ?? 10;
    for (let t = 0; t <= length; t += every) write(`${t} s`, LEFT + wide * t / length, canvas.height - 4, t ? "center" : "left");
  }

  resize() { this.charts.forEach(([chart]) => chart.resize()); this.maps.forEach((one) => this.picture(one)); }
  restyle() { this.live?.restyle(); this.charts.forEach(([chart]) => chart.restyle()); this.maps.forEach((one) => this.picture(one)); }
}
