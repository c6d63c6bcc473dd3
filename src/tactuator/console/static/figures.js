// Figures of a shape: large ones, the table of `design`, the findings of `check`; and designs that are kept.
import { make } from "./dom.js";
import { term } from "./words.js";

const NAMED = { "phase margin": ["phase margin"], "felt hum": ["hum", "felt hum"], "felt noise": ["sensation level", "felt noise"], "change of |H|": ["load", "change of |H| under load"],
  "level error": ["prefilter", "level error"], "level error, lowest level": ["prefilter", "error, lowest level"], "max|T|": ["sensitivity", "max|T|"] };
const named = (name) => (NAMED[name] ? term(NAMED[name][0], NAMED[name].at(-1)) : name);
const IN_WORDS = { met: "met", "not met": "not met", "not judged": "not judged" };

export function tiles(into, found) {
  into.replaceChildren(...found.map(({ name, value, allowed, outcome }) => make("div", { class: outcome.replace(" ", "-") },
    make("dt", {}, named(name)), make("dd", {}, value, make("small", {}, `${allowed}${allowed ? ": " : ""}${IN_WORDS[outcome]}`)))));
}

const NUMBER = /^[−-]?[\d.]/;
const isNumber = (text) => NUMBER.test(text) || text === "—";
const cell = (text) => make("td", { class: isNumber(text) ? "number" : /^at (least|most) /.test(text) ? "whole" : null }, text);
export const table = (caption, head, rows) => make("table", {}, make("caption", {}, caption),
  make("thead", {}, make("tr", {}, ...head.map((text, i) => make("th", { scope: "col", class: i && rows.length && rows.filter((row) => isNumber(row[i] ?? "")).length * 2 > rows.length ? "number" : null }, text)))),
  make("tbody", {}, ...rows.map(([first, ...others]) => make("tr", {}, make("th", { scope: "row" }, first), ...others.map(cell)))));

export const designTable = (rows, kept) => table("Figures, the worst over loads and models", ["figure", "now", ...kept.map((one) => one.name)],
  rows.map(([name, value]) => [name, value, ...kept.map((one) => one.rows.find(([other]) => other === name)?.[1] ?? "—")]));

export function verdict(found) {
  // remarks are sentences: each has a line below its finding
  const width = found.columns.length - 1;
  const made = table("Objectives", found.columns.slice(0, width), found.rows.map((row) => row.slice(0, width)));
  [...made.tBodies[0].rows].forEach((row, index) => {
    if (found.rows[index][width]) row.after(make("tr", { class: "remark" }, make("td", { colspan: `${width}` }, found.rows[index][width])));
  });
  const notes = found.assumed.map((text) => make("p", {}, `Assumed: ${text}.`));
  return make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Objectives" }, made, make("p", {}, term("verdict"), `: ${found.sentence}`), ...notes);
}
