// The factors as a list of numbers: every value can be typed, every factor added and removed.
import { digits, make, numberIn, put } from "./dom.js";
import { KINDS, PARAMETERS, excessZeros, limited, namesOf, titleOf } from "./shape.js";

export class Editor {
  // changed: called with a change of the shape.
  constructor(into, changed) {
    Object.assign(this, { changed });
    this.list = make("div");
    this.gain = make("input", { type: "number", step: "0.1", id: "gain", onchange: () => this.typed(this.gain, (shape, to) => { shape.gain_db = to; }) });
    const kind = make("select", { "aria-label": "kind of factor" }, ...Object.entries(KINDS).map(([name, { title }]) => make("option", { value: name }, title)));
    const add = make("button", { type: "button", id: "add", onclick: () => this.set((shape) => shape.factors.push({ kind: kind.value, ...KINDS[kind.value].add })) }, "Add");
    this.note = make("p", { class: "crossed" });
    into.replaceChildren(make("h2", {}, "Controller C"), make("div", { class: "factor" }, make("b", {}, "gain"), make("div", {}, make("label", { for: "gain" }, "dB"), this.gain)), this.list,
      make("div", { class: "factor" }, kind, add), this.note);
  }

  typed(field, change) {
    const to = numberIn(field);
    if (!Number.isNaN(to)) this.set((shape) => change(shape, to));
  }

  set(change) {
    this.changed((shape) => {
      const before = structuredClone(shape);
      change(shape);
      const excess = excessZeros(shape);
      this.note.textContent = excess > 0 ? `That leaves ${excess} more zeros than poles; add poles first.` : "";
      if (excess > 0 || !Number.isFinite(shape.gain_db)) Object.assign(shape, before);
      this.show(shape);
    });
  }

  // all: the value that is being typed, too. still: rows that come and go wait.
  show(shape, all = false, still = false) {
    if (all || this.gain !== document.activeElement) put(this.gain, shape.gain_db.toFixed(2));
    const key = shape.factors.map((one) => one.kind).join();
    if (key !== this.key && still) return;
    if (key !== this.key) { this.key = key; this.list.replaceChildren(...shape.factors.map((factor, index) => this.row(factor, index))); }
    shape.factors.forEach((factor, index) => {
      for (const name of namesOf(factor)) {
        const input = this.list.children[index].querySelector(`[data-name="${name}"]`);
        if (all || input !== document.activeElement) put(input, digits(factor[name]));
      }
    });
  }

  row(factor, index) {
    const title = titleOf(factor);
    const fields = namesOf(factor).map((name) => {
      const { title: words, unit } = PARAMETERS[name];
      const input = make("input", { type: "number", step: "any", "data-name": name, "aria-label": `${title} ${index + 1}: ${words}${unit ? `, ${unit}` : ""}`,
        onchange: () => this.typed(input, (shape, to) => { shape.factors[index][name] = limited(name, to); }) });
      return make("div", {}, make("label", { "aria-hidden": "true" }, name === "hz" ? unit : unit ? `${words}, ${unit}` : words), input);
    });
    const fixed = fields.length || factor.kind === "integrator" ? "" : `z = ${factor.re.toPrecision(4)}${factor.im ? ` ± ${factor.im.toPrecision(4)}j` : ""}`;
    return make("div", { class: "factor" }, make("b", {}, title), ...fields, fixed,
      make("button", { type: "button", class: "remove", title: "Remove", "aria-label": `Remove ${title} ${index + 1}`, onclick: () => this.set((shape) => shape.factors.splice(index, 1)) }, "×"));
  }
}
