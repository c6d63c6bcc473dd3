// The simulated finger: a load put on a channel and lifted again, and a force that presses.
import { make, numberIn } from "./dom.js";
import { term } from "./words.js";

export class Finger {
  constructor(rig, channels) {
    Object.assign(this, { rig, channels });
    this.loads = channels.map((one) => make("select", { id: `touch-${one.name}`, onchange: (event) => rig.do("touch", { channel: one.name, load: event.target.value || null }) }, make("option", { value: "" }, "lifted"), ...one.loads.map((load) => make("option", { value: load }, load))));
    this.forces = channels.map((one) => make("input", { type: "number", step: "0.05", min: -one.range_v, max: one.range_v, id: `press-${one.name}`, value: "0", onchange: (event) => { const force = numberIn(event.target); if (!Number.isNaN(force)) rig.do("press", { channel: one.name, force_v: force }); } }));
    const rows = channels.map((one, k) => make("div", { class: "bar" }, make("strong", {}, one.name), make("label", {}, "touch ", this.loads[k]), make("label", {}, "press, V ", this.forces[k])));
    this.box = make("div", { class: "panel" }, make("h2", {}, "Finger ", term("load"), ": on the channel, and pressing with volts of command"), make("div", { class: "fingers" }, ...rows));
  }

  standing() {
    const { rig } = this, { touchable, touch, press_v: press } = rig.standing;
    this.box.hidden = !touchable;
    this.channels.forEach(({ name }, k) => {
      const off = !rig.mayPlay;
      this.loads[k].disabled = this.forces[k].disabled = off;
      this.loads[k].value = touch[name] ?? "";
      if (this.forces[k] !== document.activeElement && this.forces[k].getAttribute("aria-invalid") !== "true") this.forces[k].value = press[name] ?? 0;
    });
  }
}
