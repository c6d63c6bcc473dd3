// The value at a handle: it is shown beside the handle that has the focus, follows it, and can be typed over.
import { digits, make, numberIn, put } from "./dom.js";

const APART = 14, FARTHER = [0, 25, 60, 110];

export class Value {
  // host: what it is placed in. Enter at the handle goes into it, Escape and Enter in it go back.
  constructor(host) {
    Object.assign(this, { host, node: null });
    this.box = make("div", { class: "value", role: "group", hidden: "" });
    this.box.onfocusout = (event) => this.left(event);
    host.append(this.box);
  }

  // fields: of a handle, called anew whenever it is drawn: [{ name, unit, value, set }].
  attach(node, title, fields) {
    node.addEventListener("focus", () => { Object.assign(this, { node, title, fields }); this.show(); });
    node.addEventListener("focusout", (event) => this.left(event));
    node.addEventListener("keydown", (event) => { if (event.key === "Enter") { event.preventDefault(); this.box.querySelector("input")?.select(); } });
  }

  left(event) { if (!this.box.contains(event.relatedTarget) && event.relatedTarget !== this.node) { this.box.hidden = true; this.node = null; } }

  show() {
    const { node } = this;
    if (node === null) return;
    const title = this.title(), fields = this.fields(), key = [title, ...fields.map((one) => one.name)].join();
    if (key !== this.key) {
      this.key = key;
      this.box.setAttribute("aria-label", `type the value: ${title}`);
      this.box.replaceChildren(make("b", {}, title), ...fields.map((one, i) => make("label", {}, `${one.name} `, this.input(i), one.unit)));
    }
    fields.forEach(({ value }, i) => { const input = this.box.querySelectorAll("input")[i]; if (input !== document.activeElement) put(input, digits(value)); });
    this.box.hidden = false;
    const at = node.getBoundingClientRect(), around = this.host.getBoundingClientRect(), { offsetWidth: wide, offsetHeight: high } = this.box;
    const others = [...this.host.querySelectorAll(".mark, .handle")].filter((one) => one !== node).map((one) => one.getBoundingClientRect());
    const free = (x, y) => x >= 0 && y >= 0 && x + wide <= around.width && others.every((one) => one.right < x + around.left || one.left > x + around.left + wide || one.bottom < y + around.top || one.top > y + around.top + high);
    const [right, left] = [at.right - around.left + APART, at.left - around.left - APART - wide], [above, below] = [at.top - around.top - APART - high, at.bottom - around.top + APART];
    const places = FARTHER.flatMap((far) => [[right + far, above], [right + far, below], [left - far, above], [left - far, below], [right + far, above - far], [left - far, below + far]]);
    const [x, y] = places.find(([px, py]) => free(px, py)) ?? [Math.max(0, around.width - wide), -high]; // above the chart, where no handle is covered
    this.box.style.left = `${x}px`;
    this.box.style.top = `${y}px`;
  }

  input(i) {
    const input = make("input", { inputmode: "decimal", size: "6", tabindex: "-1" });
    input.onchange = () => { const to = numberIn(input); if (!Number.isNaN(to)) this.fields()[i].set(to); };
    input.onkeydown = (event) => {
      event.stopPropagation();
      if (event.key === "Escape") put(input, digits(this.fields()[i].value));
      if (event.key === "Escape" || (event.key === "Enter" && !Number.isNaN(numberIn(input)))) this.node?.focus();
    };
    return input;
  }
}
