// The start page: the display that was named on the command line, or the examples.
import { address } from "./address.js";
import { make } from "./dom.js";

export class Start {
  constructor(view, link) { Object.assign(this, { view, link }); }

  async open() {
    const { view } = this, { named, examples } = await this.link.ask("start");
    const card = (key, name, more) => make("li", {}, make("a", { href: address({ view: "loop", display: key }) }, make("strong", {}, name), make("span", {}, more)));
    const cards = examples.map(({ key, name, channels }) => card(key, name, `${key.replace("example:", "")} · ${channels}`));
    view.replaceChildren(
      make("h1", {}, "Shape a loop"),
      make("p", {}, "Choose a display. Its loop is shown as a Nichols chart and over frequency; drag what you want changed, or let the synthesis design it. Everything is computed by the server on this machine, as the command line does."),
      ...(named ? [make("h2", {}, "Your display"), make("ul", { class: "cards" }, card(named, "The display of the command line", "as the file says now"))] : []),
      make("h2", {}, "Examples"), make("ul", { class: "cards" }, ...cards));
  }
}
