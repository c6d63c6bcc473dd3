"use strict";
// Shows the responses as buttons that fit the page, or a field for a number where there are none, and cues for
// intervals that are no responses.
const LARGEST_PX = [260, 200], FONTS_PX = [88, 72, 60, 48, 40, 34, 28, 24, 21, 19, 17, 16, 15, 14, 13, 12];
const SPACINGS_PX = [{ gap: 8, least: 44, margin: 18 }, { gap: 4, least: 38, margin: 14 }]; // the second is for many responses

class Choices {
  // choices: {response, keys, codes}; intervals: names of those that are shown; chosen: called with a response.
  constructor(box, cues, choices, intervals, chosen) {
    this.box = box;
    this.choices = choices;
    this.buttons = new Map(choices.map((choice) => [choice.response, this.button(choice, chosen)]));
    const own = intervals.length > 0 && intervals.every((name) => this.buttons.has(name));
    this.inRow = own || choices.length === 2; // responses in the order of time, or two of them
    this.cues = (own ? [] : intervals.length ? intervals : [""]).map((name) => make("span", { class: "cue" }, name));
    this.intervals = own ? intervals.map((name) => this.buttons.get(name)) : intervals.length ? this.cues : [];
    this.number = choices.length === 0 ? this.field(chosen) : null;
    box.replaceChildren(...this.buttons.values(), ...(this.number === null ? [] : [this.number]));
    cues.replaceChildren(...this.cues);
    cues.hidden = this.cues.length === 0;
    new ResizeObserver(() => this.fit()).observe(box.parentElement);
  }

  button({ response, label: text, keys }, chosen) {
    const label = make("span", { class: "label", dir: "auto" }, text);
    const single = keys.filter((key) => key.length === 1);
    const button = make("button", { class: "choice", type: "button" }, label);
    if (single.length > 0) {
      button.setAttribute("aria-keyshortcuts", single[0]);
      if (!single.includes(text)) button.append(make("kbd", { "aria-hidden": "true" }, single[0]));
    }
    button.onclick = () => chosen(response);
    return button;
  }

  // Returns a form that takes a number and gives it by Enter; the server reads it, and what it refuses stays to be mended.
  field(chosen) {
    const input = make("input", { type: "text", inputmode: "decimal", autocomplete: "off", maxlength: "12", "aria-label": word("number") });
    const form = make("form", { class: "number" }, input, make("button", { type: "submit" }, word("enter")));
    form.onsubmit = (event) => {
      event.preventDefault();
      if (!input.readOnly) chosen(input.value.trim());
    };
    return form;
  }

  // Returns the response of a key, by its place or by the character that it types, or undefined. Digits go by place,
  // since an unshifted AZERTY key types another character.
  byKey(code, key) {
    const found = this.choices.find((choice) => choice.codes.includes(code)) || this.choices.find((choice) => choice.keys.includes(key));
    return (found || {}).response;
  }

  // Marks the buttons as enabled or not for those who cannot see it; they keep their focus.
  open(yes) {
    for (const button of this.buttons.values()) button.setAttribute("aria-disabled", String(!yes));
    if (this.number === null) return;
    const input = this.number.firstElementChild;
    input.readOnly = !yes;
    this.number.lastElementChild.setAttribute("aria-disabled", String(!yes));
    if (yes) input.focus();
  }

  light(interval) { this.intervals.forEach((cue, index) => cue.classList.toggle("lit", index === interval)); }

  // Lights the visual cue while a trial plays whose intervals are not shown.
  playing(on) {
    if (on && this.number !== null) { this.number.firstElementChild.value = ""; this.valid(true); }
    if (this.intervals.length === 0) for (const cue of this.cues) cue.classList.toggle("lit", on);
  }

  valid(yes) { this.number.firstElementChild.setAttribute("aria-invalid", String(!yes)); }

  mark(response, name) { if (this.buttons.has(response)) this.buttons.get(response).classList.add(name); }

  clear() { for (const button of this.buttons.values()) button.classList.remove("chosen", "right", "wrong"); }

  hasFocus() { return this.box.contains(document.activeElement) && document.activeElement !== this.box; }

  // Moves the focus to the neighbour in that direction.
  move(columns, rows) {
    const buttons = [...this.buttons.values()];
    const at = buttons.indexOf(document.activeElement);
    const to = at < 0 ? 0 : at + columns + rows * this.columns;
    if (to >= 0 && to < buttons.length) buttons[to].focus();
  }

  // Chooses the largest letters with which every label is on one line of its cell and all cells are on the page; among
  // the numbers of columns that allow it, the one whose cells are nearest to 3 : 2.
  fit() {
    if (this.box.hidden || this.number !== null) return;
    const main = this.box.parentElement, style = getComputedStyle(main);
    const others = [...main.children].filter((child) => child !== this.box && !child.hidden);
    const gap = parseFloat(style.rowGap) || 0;
    const width = main.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
    const height = main.clientHeight - parseFloat(style.paddingTop) - parseFloat(style.paddingBottom)
      - others.reduce((sum, child) => sum + child.offsetHeight + gap, 0);
    const widest = this.widest(), hint = this.box.querySelector("kbd"), keyed = hint !== null && hint.offsetHeight > 0;
    const tries = (this.inRow ? [this.buttons.size, 1] : [1]).flatMap((least) => SPACINGS_PX.flatMap((spacing) =>
      FONTS_PX.map((font) => [spacing, font, least])));
    const room = { width, height, widest, keyed };
    let found = null;
    for (const one of tries) { found = this.best(...one, room); if (found !== null) break; }
    found = found || this.scrolling(room);
    this.columns = found.columns;
    const set = (name, value) => this.box.style.setProperty(name, value);
    set("--columns", found.columns); set("--cell-width", `${found.width}px`); set("--gap", `${found.gap}px`);
    set("--cell-height", `${found.height}px`); set("--font", `${found.font}px`);
  }

  best({ gap, least, margin }, font, leastColumns, { width, height, widest, keyed }) {
    const count = this.buttons.size, label = Math.ceil(widest * font + Math.max(margin, 0.4 * font)), low = Math.max(least, font * 1.2 + (keyed ? 22 : 8));
    let best = null;
    for (let columns = leastColumns; columns <= count; columns++) {
      const rows = Math.ceil(count / columns);
      const cell = {
        columns, font, gap,
        width: Math.floor(Math.min(Math.max(LARGEST_PX[0], label), (width - gap * (columns - 1)) / columns)),
        height: Math.floor(Math.min(LARGEST_PX[1], (height - gap * (rows - 1)) / rows)),
      };
      if (cell.width < Math.max(least, label) || cell.height < low) continue;
      cell.height = Math.min(cell.height, Math.max(low, Math.round(cell.width / 1.5)));
      cell.off = Math.abs(Math.log(cell.width / cell.height / 1.5));
      if (best === null || cell.off < best.off) best = cell;
    }
    return best;
  }

  // Where nothing fits: returns as many columns as the labels allow (the longest wrap); the page then scrolls.
  scrolling({ width, widest }) {
    const [{ gap, least, margin }] = SPACINGS_PX, font = 14, cell = Math.min(widest * font + margin, width);
    const columns = Math.max(1, Math.min(this.buttons.size, Math.floor((width + gap) / (cell + gap))));
    return { columns, font, gap, width: Math.floor((width - gap * (columns - 1)) / columns), height: least };
  }

  // Returns the width of the widest label in heights of its letters.
  widest() {
    const pen = document.createElement("canvas").getContext("2d");
    pen.font = `600 100px ${getComputedStyle(this.box).fontFamily}`;
    return Math.max(...this.choices.map((choice) => pen.measureText(choice.label).width)) / 100;
  }
}
