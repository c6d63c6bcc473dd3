// Live sound on the rig: what is asked of each finger and what it feels, as it comes.
import { colour, command, counted, displayName, draw, make, numberIn } from "./dom.js";
import { HUES } from "./traces.js";

const LOW = -10, HIGH = 55, COLUMN = 2, BLOCKS_HZ = 20, EXAMPLE = "example:speech.wav", FILE = "file";
const NAMED = [10, 50, 100, 200, 500], LEFT = 36, TOP = 8, BOTTOM = 6;
const level = (value) => (value === null ? "—" : `${Math.max(LOW, value).toFixed(0)}`.replace("-", "−"));
const share = (value) => Math.max(0, Math.min(1, ((value ?? LOW) - LOW) / (HIGH - LOW)));

export class LivePanel {
  // state: of the page, whose own part names the dropped file.
  constructor(rig, state, codings, usual) {
    Object.assign(this, { rig, state, busy: false, block: null, fingers: [] });
    const option = (value, text) => make("option", { value }, text), button = (id, text, pressed, more = {}) => make("button", { type: "button", id, onclick: pressed, ...more }, text);
    this.file = option(FILE, "");
    this.input = make("select", { id: "live-input" }, this.file, option("", "the system's microphone"));
    this.coding = make("select", { id: "live-coding" }, ...codings.map((name) => option(name, name)));
    this.level = make("input", { id: "live-level", type: "number", min: "-60", max: "55", step: "1", value: usual });
    this.buttons = { start: button("live-start", "Start", () => this.start(), { class: "first" }), stop: button("live-stop", "Stop", () => rig.do("stop")),
      mute: button("live-mute", "Mute", () => rig.do("mute", { muted: !this.block?.muted }), { "aria-pressed": "false" }) };
    this.now = make("p", { id: "live-now", role: "status" });
    this.figures = make("p", { id: "live-figures" });
    this.meters = make("div", { class: "maps" });
    this.equal = make("div", {});
    this.box = make("section", { class: "panel live", "aria-label": "Live" }, make("h2", {}, "Live"),
      make("div", { class: "bar", role: "toolbar", "aria-label": "Live sound" }, make("label", {}, "input ", this.input), make("label", {}, "coding ", this.coding), make("label", {}, "level, dB SL ", this.level), ...Object.values(this.buttons)),
      this.now, this.figures, this.meters, this.equal);
    this.equal.append(command("tactuator console DISPLAY.toml --rig simulated"));
  }

  // The rig has reported what it is: its fingers are known, and the machine's microphones are asked for.
  async begin() {
    this.begun = true;
    this.equal.replaceChildren();
    this.meters.after(make("p", {}, `Spectra (Hz) of the last ${Math.round((560 - LEFT) / COLUMN / BLOCKS_HZ)} s: empty at −10, full at ${HIGH} dB SL. Felt is what the sensor reads, its hum and noise included.`));
    this.fingers = this.rig.standing.channels.map(({ name }, k) => {
      const bar = draw("rect", { x: 0, y: 0, height: 10, width: 0, class: `hue-${k % HUES.length}` }), mark = draw("rect", { y: 0, height: 10, width: 0.6, class: "asked" }), words = make("span", {}, "—");
      const meter = make("div", { role: "meter", "aria-label": `${name}: felt, dB SL`, "aria-valuemin": LOW, "aria-valuemax": HIGH, "aria-valuenow": LOW }, draw("svg", { viewBox: `0 0 ${HIGH - LOW} 10`, preserveAspectRatio: "none", "aria-hidden": "true" }, bar, mark));
      const maps = ["asked", "felt"].map((what) => make("canvas", { width: 560, height: 150, role: "img", "aria-label": `${name}: spectrum ${what}, scrolling` }));
      this.meters.append(make("div", {}, make("h3", {}, name, " ", words), meter, ...maps.map((canvas, i) => make("figure", {}, make("figcaption", {}, ["asked", "felt"][i]), canvas))));
      return { bar, mark, words, meter, maps };
    });
    const answer = await this.rig.do("microphones");
    this.input.append(...(answer?.microphones ?? []).map((name) => make("option", { value: name }, name)));
  }

  standing() {
    const { rig, buttons, state } = this, there = rig.standing;
    this.file.textContent = `file ${state.own.name ?? (state.own.file ?? EXAMPLE).replace(/^example:/, "")}`;
    if (there && !rig.absent && !this.begun) this.begin();
    const runs = there?.mode === "listening", foreign = state.display !== "file";
    if (["listening", "fault", "gone"].includes(there?.mode)) this.settled();
    if (!runs) this.fingers.forEach((finger) => this.meter(finger, null, null));
    buttons.start.disabled = !there || this.busy || runs || foreign || !rig.mayPlay;
    buttons.stop.disabled = buttons.mute.disabled = !runs || rig.watches;
    if (rig.absent) this.now.textContent = "Live needs a rig, and the console was begun without one. Begin it with one:";
    else if (foreign) this.now.textContent = `The rig is that of ${displayName("file")}; open that one to listen here.`;
    else if (!this.busy && there) this.now.textContent = runs ? "Fingers feel the sound as it comes. Escape ends it." : rig.has ? `Not now: ${rig.has}.` : "Nothing is felt.";
  }

  settled() { this.end?.(); Object.assign(this, { busy: false, end: null }); }

  refused() { this.settled(); this.standing(); }

  async start() {
    const { rig } = this, at = numberIn(this.level), input = this.input.value === FILE ? { file: this.state.own.file ?? EXAMPLE } : { microphone: this.input.value };
    if (Number.isNaN(at)) return;
    this.busy = true;
    this.end = counted("Starting", (words) => { this.now.textContent = words; });
    this.standing();
    const loaded = rig.standing.loaded || await rig.do("controller", { source: "design" });
    const answer = loaded && await rig.do("listen", { settings: { ...input, coding: this.coding.value, level_db_sl: at } });
    if (answer) this.equal.replaceChildren(command(answer.command)); else this.refused();
  }

  take(block) {
    this.block = block;
    const [least, most] = block.delay_s.map((one) => (1000 * one).toFixed(0)), { buttons: { mute } } = this;
    this.figures.textContent = `delay ${least === most ? least : `${least} to ${most}`} ms · ${block.dropouts} drop-outs · ${block.time_s.toFixed(1)} s`;
    mute.setAttribute("aria-pressed", String(block.muted));
    if (this.rig.standing.mode !== "listening") return; // it has ended meanwhile
    this.fingers.forEach((finger, k) => {
      this.meter(finger, block.felt_db_sl[k], block.asked_db_sl[k]);
      this.scroll(finger.maps[0], block.asked_spectrum_db_sl[k]);
      this.scroll(finger.maps[1], block.felt_spectrum_db_sl[k]);
    });
  }

  meter({ bar, mark, words, meter }, felt, asked) {
    words.textContent = `felt ${level(felt)} dB SL, asked ${level(asked)}`;
    meter.setAttribute("aria-valuenow", Math.max(LOW, Math.min(HIGH, felt ?? LOW)));
    meter.setAttribute("aria-valuetext", words.textContent);
    bar.setAttribute("width", share(felt) * (HIGH - LOW));
    mark.setAttribute("x", share(asked) * (HIGH - LOW - 0.6));
  }

  // Everything moves on by a column, and the newest is drawn at the right.
  scroll(canvas, spectrum) {
    const ctx = canvas.getContext("2d"), { frequency_hz: hertz } = this.block, wide = canvas.width - LEFT, tall = canvas.height - TOP - BOTTOM, high = tall / hertz.length, at = canvas.width - COLUMN;
    if (!canvas.dataset.drawn) this.axis(canvas, ctx, tall, high);
    ctx.globalAlpha = 1;
    ctx.drawImage(canvas, LEFT + COLUMN, TOP, wide - COLUMN, tall, LEFT, TOP, wide - COLUMN, tall);
    ctx.fillStyle = colour("paper");
    ctx.fillRect(at, TOP, COLUMN, tall);
    ctx.fillStyle = colour("nominal");
    spectrum.forEach((value, i) => { ctx.globalAlpha = share(value); ctx.fillRect(at, TOP + tall - (i + 1) * high, COLUMN, high + 0.5); });
  }

  axis(canvas, ctx, tall, high) {
    canvas.dataset.drawn = "yes";
    Object.assign(ctx, { globalAlpha: 1, fillStyle: colour("paper"), font: "13px system-ui", textAlign: "right" });
    ctx.fillRect(0, 0, canvas.width, canvas.height);
    ctx.fillStyle = colour("faint");
    for (const hz of NAMED) {
      const near = this.block.frequency_hz.findIndex((one) => Math.abs(Math.log(one / hz)) < 0.06);
      if (near >= 0) ctx.fillText(String(hz), LEFT - 6, TOP + tall - (near + 0.5) * high + 4);
    }
  }

  restyle() { this.fingers.forEach(({ maps }) => maps.forEach((canvas) => { delete canvas.dataset.drawn; })); }
}
