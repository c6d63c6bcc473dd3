// Small functions that every view uses.
export const el = (id) => document.getElementById(id);
export const say = (text) => { el("said").textContent = text; };
export const banner = (text) => { el("banner").textContent = text; el("banner").hidden = text === ""; };
// A refusal is shown; a lost connection is shown already.
export const refusal = (error) => { if (!error.lost) banner(error.message); };

export function make(name, attributes = {}, ...content) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node[key] = value;
    else if (value !== false && value !== null) node.setAttribute(key, value);
  }
  node.append(...content);
  return node;
}

export function draw(name, attributes = {}, ...content) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...content);
  return node;
}

// What is wrong with a field is shown beside it until something else is typed or chosen; nothing is sent then.
export function fault(field, text) {
  const wrong = field.nextElementSibling?.classList.contains("wrong") ? field.nextElementSibling : make("small", { class: "wrong", role: "alert" });
  field.setAttribute("aria-invalid", String(text !== ""));
  wrong.textContent = text;
  field.oninput = () => fault(field, "");
  if (text === "") { wrong.remove(); return; }
  field.after(wrong);
  wrong.style.transform = ""; // then beneath the field, within the page, over what is there
  const at = field.getBoundingClientRect(), from = wrong.getBoundingClientRect();
  wrong.style.transform = `translate(${Math.min(at.left, innerWidth - from.width - 12) - from.left}px, ${at.bottom + 2 - from.top}px)`;
}

// A value into a field, in place of what was wrong there.
export function put(field, value) {
  field.value = value;
  if (field.getAttribute("aria-invalid") === "true") fault(field, "");
}

// The number in a field, within its bounds, or NaN with the fault at the field; optional: an empty field is null.
export function numberIn(field, optional = false) {
  const { min, max } = field, text = field.value.trim(), bad = field.validity.badInput;
  if (optional && text === "" && !bad) { fault(field, ""); return null; }
  const value = text === "" ? NaN : Number(text), within = Number.isFinite(value) && !(min && value < Number(min)) && !(max && value > Number(max));
  const range = min && max ? `${min} to ${max}` : min ? `${min} or more` : max ? `up to ${max}` : "a number";
  fault(field, within ? "" : `${text || (bad ? "not a number" : "empty")}: enter ${range}`);
  return within ? value : NaN;
}

// Fields keep what was put into them, by their ids, until the page is left.
const entered = new Map();
export function lasting(field) {
  const what = field.type === "checkbox" ? "checked" : "value";
  if (entered.has(field.id)) field[what] = entered.get(field.id);
  field.remember = () => entered.set(field.id, field[what]);
  field.addEventListener("change", field.remember);
  return field;
}

// The name of a display, the same everywhere: that of its file. file: of the one that the command line named.
export const names = { file: "" };
export const displayName = (key) => (key.startsWith("text:") ? "the text in Display" : key === "file" ? names.file : key.replace("example:", "examples/"));

// A number as a person reads it: three digits that count.
export const digits = (value) => Number(value.toPrecision(3)).toString();
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

// A link that saves a text under a name, as the command of the same page writes it.
export function saved(words, name, text, type = "application/json") {
  return make("a", { href: URL.createObjectURL(new Blob([text], { type })), download: name, class: "save" }, words);
}

// What takes long shows at once, and then each second, that it is at work; returns what ends that. show: called with the words.
export function counted(words, show) {
  const began = Date.now(), tick = () => show(`${words}, ${Math.round((Date.now() - began) / 1000)} s`);
  tick();
  const clock = setInterval(tick, 250);
  return () => clearInterval(clock);
}

// A file that the server made comes with the token in a header, as every request of the page.
export async function saveMade(token, key, name) {
  const answer = await fetch(`/made/${key}/${name}`, { headers: { "x-token": token } });
  if (!answer.ok) throw new Error((await answer.text()).trim());
  make("a", { href: URL.createObjectURL(await answer.blob()), download: name }).click();
}

// Ctrl+Z and Ctrl+Shift+Z in a view; a field has its own.
export function undoKeys(view, undo, redo) {
  view.onkeydown = (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || event.target.tagName === "INPUT") return;
    event.preventDefault();
    if (event.shiftKey) redo(); else undo();
  };
}

export function command(text) {
  const copy = make("button", { type: "button", onclick: () => navigator.clipboard?.writeText(text).then(() => say("copied")) }, "Copy");
  const words = text.split(" ").flatMap((word) => [" ", make("span", {}, word)]).slice(1); // a line is broken between them
  return make("div", { class: "command" }, make("code", { tabindex: "0" }, ...words), copy);
}

// How much larger than usual the page's text is: a wall display is read from afar. Charts follow it.
export const large = () => Number.parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;

// True where a fingertip points: it takes more room than a mouse.
export const COARSE = matchMedia("(pointer: coarse)").matches;

// Where a pointer has gone to along one axis since it was down there: less than a pixel is none of a hand's doing.
export const gone = (to, from) => (Math.abs(to - from) < 1 ? from : to);

// The one of several handles that lies nearest to a pointer: one may cover the middle of another.
export function nearest(nodes, { clientX, clientY }) {
  const apart = (node) => { const { left, right, top, bottom } = node.getBoundingClientRect(); return Math.hypot((left + right) / 2 - clientX, (top + bottom) / 2 - clientY); };
  return nodes.reduce((best, one) => (apart(one) < apart(best) ? one : best));
}

// A part of a drawing that is dragged: a fingertip on it does not scroll the page (touch-action does not count inside an SVG).
export function draggable(node, begin) {
  node.addEventListener("touchstart", (event) => event.preventDefault(), { passive: false });
  node.onpointerdown = begin;
  return node;
}
