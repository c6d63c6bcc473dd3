// The start page: the display that was named on the command line, the examples, and the tour from a record to speech.
import { address } from "./address.js";
import { command, make } from "./dom.js";

// Of each step: what it is, its view here (null: the command alone), and the command that does the same.
const TOUR = [
  ["Get the examples, and work in their folder; steps 8 to 10 need a rig here, of “tactuator console display.toml --rig simulated”", null, "tactuator init --examples lab && cd lab"],
  ["Calibrate the sensor", null, "tactuator calibrate pairs.csv"],
  ["Identify the actuator from a record", "identify", "tactuator identify bench.csv --input drive --output encoder --time t --out model.json"],
  ["Begin a display of your own with that model; the tour goes on with the example’s display.toml", "display", "tactuator init --from model.json --out mine.toml"],
  ["Design the loop of each of the three fingers, by dragging or by the synthesis", "loop", "tactuator design display.toml --out controller.json"],
  ["Check all three, and save", "loop", "tactuator check controller.json"],
  ["Fit the prefilter to the curve of one person", "prefilter", "tactuator design display.toml --curve curve.csv --out personal.json"],
  ["Measure its response", "response", "tactuator measure response --controller controller.json --out response.csv"],
  ["Watch it, touch it", "scope", "tactuator measure noise --controller controller.json"],
  ["Measure thresholds", "experiment", "tactuator experiment serve protocol.toml --store lab.db --controller controller.json"],
  ["Render speech, and play it", "speech", "tactuator render speech.wav --display display.toml --out reference.wav --felt felt.wav"],
];

export default class Start {
  constructor(view, link) { Object.assign(this, { view, link }); }

  async open() {
    const { view } = this, { views, named, file, examples } = await this.link.ask("start"), display = named ?? "example:display.toml";
    const card = (key, name, more) => make("li", {}, make("a", { href: address({ view: "loop", display: key }) }, make("strong", {}, name), make("span", {}, more)));
    const cards = examples.map(({ key, name, channels }) => card(key, name, `${key.replace("example:", "")} · ${channels}`));
    const step = ([words, at, line]) => {
      const there = at && views[at];
      return make("li", {}, there ? make("a", { href: address({ view: at, ...(there.of_display ? { display } : {}) }) }, words) : words, there ? ` (${there.title})` : "", command(line));
    };
    view.replaceChildren(
      make("h1", {}, "From a record to the finger"),
      make("p", {}, "Choose a display to shape its loop, or follow the tour below. Everything is computed by the server on this machine, as the command line does."),
      ...(named ? [make("h2", {}, "Your display"), make("ul", { class: "cards" }, card(named, file, "as the file says now"))] : []),
      make("h2", {}, "Examples"), make("ul", { class: "cards" }, ...cards),
      make("h2", {}, "The tour"), make("p", {}, "Each step can be done on its page here, or by the command beneath it. Steps without a link have a command only. What a page saves goes to the browser’s downloads."), make("ol", { class: "tour" }, ...TOUR.map(step)));
  }
}
