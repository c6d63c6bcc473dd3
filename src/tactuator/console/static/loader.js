// The controller that runs on the rig: designed now, the loops that were shaped in this page, or a file.
import { make } from "./dom.js";
import { Drop } from "./drop.js";

export class Loader {
  // more: what precedes it in the same bar.
  constructor(rig, link, state, ...more) {
    Object.assign(this, { rig, state });
    const press = (source, text) => make("button", { type: "button", id: `use-${source}`, onclick: () => this.use(source) }, text);
    this.buttons = { design: press("design", "Design a controller"), loops: press("loops", "Use the loops of this page") };
    this.loaded = make("span", { id: "loaded" });
    this.drop = new Drop(link, { label: "controller.json", accept: ".json", busy: (on) => rig.loads(on), taken: (file) => rig.link.ask("controller", { source: "file", file }) });
    this.drop.input.id = "controller-file";
    this.box = make("div", { class: "bar" }, ...more, make("span", {}, "controller: ", this.loaded), this.buttons.design, this.buttons.loops, this.drop.box);
  }

  async use(source) {
    const button = this.buttons[source], words = button.textContent;
    button.textContent = "Wait";
    this.rig.loads(true);
    await this.rig.do("controller", { source, ...(source === "loops" ? { shapes: this.state.shapes } : {}) });
    button.textContent = words;
    this.rig.loads(false);
  }

  standing() {
    const { rig } = this, { loaded, channels, controller } = rig.standing, off = !rig.open || rig.watches;
    this.loaded.textContent = loaded ? controller.name : "none yet";
    this.loaded.title = loaded;
    const needed = channels.filter((channel) => channel.loop).map((channel) => channel.name), lacks = needed.filter((name) => !(name in (this.state.shapes ?? {})));
    for (const button of Object.values(this.buttons)) button.disabled = off || rig.loading > 0;
    this.buttons.loops.disabled ||= lacks.length > 0;
    this.buttons.loops.hidden = lacks.length === needed.length;
    this.buttons.loops.title = lacks.length ? `not shaped yet: ${lacks.join(", ")}; open each in the view Loop` : "";
    this.drop.box.hidden = off;
  }
}
