// The view Display: the file as a form and as text side by side; the server judges what is written and names the line.
import { address, write } from "./address.js";
import { command, displayName, draw, el, make, saved, say } from "./dom.js";
import { Drop } from "./drop.js";

const WAIT_MS = 350, MOST = 60000;

export default class Display {
  constructor(view, link, state) { Object.assign(this, { view, link, state, own: state.own, past: [], future: [] }); }

  kept() { return `text of ${this.own.model ?? this.state.display ?? "a new display"}`; }
  // what its relative paths start at: the folder of the display, or of the model that was dropped
  get beside() { const { display } = this.state, { model } = this.own; return model ? { model } : display ? { display } : {}; }
  get name() { return this.own.model ? "mine.toml" : "display.toml"; }

  async open() {
    const { view, link, state } = this;
    this.drop = new Drop(link, { label: "Display file or model", accept: ".toml,.json", hint: "Drop a display file, or a model.json to begin a display with it; or go on with the text below.",
      taken: async (key, name) => {
        const model = name.endsWith(".json");
        const { text } = await link.ask("display.read", model ? { model: key } : { file: key });
        this.own.model = model ? key : "";
        write(this.state);
        await this.set(text);
      } });
    this.text = make("textarea", { id: "text", spellcheck: "false", "aria-label": "Display file as text", rows: "24", oninput: () => this.soon(), onscroll: () => { this.gutter.scrollTop = this.text.scrollTop; } });
    this.gutter = make("pre", { class: "gutter", "aria-hidden": "true" });
    this.alert = make("p", { class: "crossed alert", role: "alert", id: "fault" });
    this.form = make("div", { class: "form" });
    this.sketch = make("div", { class: "panel" });
    this.bar = make("div", { class: "bar" });
    this.buttons = [["Undo", () => this.step(this.past, this.future)], ["Redo", () => this.step(this.future, this.past)]].map(([text, onclick]) => make("button", { type: "button", onclick }, text));
    view.replaceChildren(make("h1", {}, "Display"),
      make("p", {}, "What the display is and what it must do. The form and the text are the same file: a change of one changes the other."),
      this.drop.box, this.bar, this.alert,
      make("div", { class: "written" }, make("div", {}, make("div", { class: "panel" }, make("h2", {}, "Form"), this.form)),
        make("div", {}, make("div", { class: "panel" }, make("h2", {}, "Text"), make("div", { class: "editor" }, this.gutter, this.text)))),
      this.sketch);
    const kept = sessionStorage.getItem(this.kept());
    this.text.value = kept ?? (await link.ask("display.read", this.beside)).text;
    this.before = this.text.value;
    await this.judge();
  }

  // A text in place of the one that is there; undo brings that back.
  set(text) {
    if (text === this.text.value) return Promise.resolve();
    this.past.push(this.text.value); this.future = [];
    this.text.value = this.before = text;
    return this.judge();
  }

  step(from, to) {
    if (!from.length) return;
    to.push(this.text.value);
    this.text.value = this.before = from.pop();
    this.judge();
  }

  soon() {
    clearTimeout(this.clock);
    this.clock = setTimeout(() => { this.past.push(this.before); this.before = this.text.value; this.future = []; this.judge(); }, WAIT_MS);
  }

  async judge() {
    const text = this.text.value;
    sessionStorage.setItem(this.kept(), text);
    this.numbers(null);
    if (text.length > MOST) { this.fault(`The text has ${text.length} characters; expected up to ${MOST}.`, null); return; }
    try {
      const found = await this.link.ask("display.judge", { text, ...this.beside });
      if (text !== this.text.value) return;
      if (found.form.length) this.fields(found.form);
      this.fault(found.fault, found.line);
      this.alert.append(...found.doubts.map((one) => make("span", { class: "doubt" }, one)));
      this.actions(found);
      if (found.sketch) this.sketch.replaceChildren(make("h2", {}, "Channels of ", found.sketch.name), ...found.sketch.channels.map((one) => sketched(one, found.sketch)));
    } catch (error) { if (!error.lost) this.fault(error.message, null); }
  }

  fault(text, line) {
    this.numbers(line);
    this.alert.replaceChildren(...(text ? [...(line ? [make("button", { type: "button", onclick: () => this.show(line) }, `Line ${line}`), " "] : []), text] : []));
    this.text.setAttribute("aria-invalid", String(Boolean(text)));
  }

  // Beneath the text the same text, unseen, with the numbers of its lines: long lines are broken in both alike.
  numbers(fault) {
    this.gutter.replaceChildren(...this.text.value.split("\n").map((line, i) => make("span", { class: i + 1 === fault ? "fault" : null, "data-n": i + 1 }, line)));
    this.gutter.scrollTop = this.text.scrollTop;
  }

  // The text with a line selected.
  show(line) {
    const lines = this.text.value.split("\n"), from = lines.slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
    this.text.focus();
    this.text.setSelectionRange(from, from + lines[line - 1].length);
    this.text.scrollTop = Math.max(0, this.gutter.children[line - 1].offsetTop - 100);
  }

  actions({ key, fault, doubts }) {
    const [undo, redo] = this.buttons;
    el("where").textContent = this.own.model || !this.state.display ? this.name : displayName(this.state.display);
    undo.disabled = !this.past.length; redo.disabled = !this.future.length;
    this.bar.replaceChildren(undo, redo, saved(`Save ${this.name}`, this.name, this.text.value, "text/plain"),
      ...(fault ? [] : [make("a", { id: "use", href: address({ view: "loop", display: key }) }, "Shape its loop")]), make("span", { class: "gap" }),
      command(this.own.model ? "tactuator init --from model.json --out mine.toml" : "tactuator design display.toml --out controller.json"));
    if (!fault) say(doubts.length ? "the display file can be read; its numbers are doubted" : "the display file is right");
  }

  fields(form) {
    const focused = document.activeElement?.dataset?.field;
    const open = new Set([...this.form.querySelectorAll("details[open]")].map((one) => one.dataset.table));
    const first = !this.form.children.length;
    this.form.replaceChildren(...form.map(({ table, place, title, fields }, i) => make("details", { "data-table": title, open: open.has(title) || (first && i === 0) ? "" : null }, make("summary", {}, title),
      ...fields.map((field) => this.field(table, place, title, field)))));
    if (focused) this.form.querySelector(`[data-field="${CSS.escape(focused)}"]`)?.focus();
  }

  field(table, place, title, { key, given, usual, words, choices, help }) {
    const id = `${title} ${key}`, value = given ?? "";
    const set = async (to) => {
      if (to === value || to === "") return;
      try { await this.set((await this.link.ask("display.set", { text: this.text.value, table, place, key, value: to, words })).text); } catch (error) { this.fault(error.message, null); }
    };
    const input = choices
      ? make("select", { "data-field": id, "aria-label": id, onchange: (event) => set(event.target.value) }, ...[given === null ? "" : null, ...choices].filter((one) => one !== null).map((one) => make("option", { value: one, selected: one === value ? "" : null }, one === "" ? `${usual ?? "none"} (as usual)` : one.replaceAll('"', ""))))
      : make("input", { "data-field": id, "aria-label": id, value, placeholder: usual ?? "", onchange: (event) => set(event.target.value) });
    return make("div", { class: "field" }, make("span", { class: "key" }, key), input, make("small", {}, help));
  }
}

// A channel as a chain of boxes, from the reference to the finger.
function sketched(one, { rate_hz: rate }) {
  const boxes = [["prefilter F", one.prefilter, one.curve], ...(one.loop ? [["controller C", `${rate} Hz`, "in a loop"]] : [["no loop", `${rate} Hz`, ""]]), ["D/A", ...one.converter.split(", ")], ["plant P", ...one.plant.split(", ")], ["finger", one.travel, one.loads.join(", ") || "no load"], ["sensor", one.sensor, one.quantity]];
  const wide = 118, gap = 26, high = 66, width = boxes.length * (wide + gap) - gap + 4;
  const short = (text) => (text.length > 17 ? `${text.slice(0, 16)}…` : text);
  const parts = boxes.flatMap((texts, i) => {
    const x = 2 + i * (wide + gap);
    return [draw("rect", { x, y: 4, width: wide, height: high, rx: 6 }), ...texts.map((text, row) => draw("text", { x: x + wide / 2, y: 24 + 18 * row, "text-anchor": "middle", class: row ? "" : "head" }, short(text))),
      ...(i ? [draw("path", { class: "wire", d: `M${x - gap} 37H${x - 2}l-6 -4m6 4l-6 4` })] : [])];
  });
  if (one.loop) {
    const from = 2 + 5 * (wide + gap) + wide / 2, to = 2 + (wide + gap) + wide / 2;
    parts.push(draw("path", { class: "wire", d: `M${from} 70V92H${to}V72l-4 6m4 -6l4 6` }));
  }
  const svg = draw("svg", { viewBox: `0 0 ${width} ${one.loop ? 96 : 74}`, class: "sketch", role: "img", "aria-label": `Channel ${one.name}: ${boxes.map((texts) => texts.filter(Boolean).join(" ")).join(", then ")}` }, ...parts);
  return make("figure", {}, make("figcaption", {}, make("strong", {}, one.name), `, band ${one.band}, curve ${one.curve}`), make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `Sketch of channel ${one.name}` }, svg));
}
