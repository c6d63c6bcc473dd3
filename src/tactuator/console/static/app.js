// The page: which view its address names, and the connection that all of them use.
import { address, keepToken, read, takeToken, write } from "./address.js";
import { banner, displayName, el, make, names, refusal } from "./dom.js";
import { Link } from "./link.js";
import { leftRig, stopRig } from "./rig.js";

const LOST = "The server does not answer. What is in this page is still here; it goes on when the server is back.";
const REFUSED = "This address has no valid token. Open the address that the command printed.";
const LEFTOVER_MS = 300; // what the view before drew is shown so long at most, where the next one has to wait
let shown = null, ready = false, about = null, renewed = false, routes = 0;
const remembered = {}; // of each view that was left, its part of the address
const shapesOf = {}; // of each display, the loops that were shaped: links from the start page and addresses typed anew do not bear them
// Tabs of one origin share the token as long as one of them is open; it is stored nowhere.
const tabs = new BroadcastChannel("token");

// A view: constructor(view, link, state), open(); and where it has them again() after a lost connection, take(message),
// resize(), restyle(), close().
const link = new Link(takeToken(), (what) => {
  ready = what === "open";
  banner({ open: "", lost: LOST, refused: REFUSED }[what]);
  if (what === "refused") tabs.postMessage(null);
  if (!ready) return;
  if (shown?.isOpen && !renewed) shown.again?.(); else route();
}, (message) => shown?.take?.(message));

tabs.onmessage = ({ data: token }) => {
  if (token === null) { if (ready && !link.isRefused) tabs.postMessage(link.token); return; }
  if (link.isRefused && token !== link.token) renew(token);
};

// Another token: that of a server that was begun anew, which may have another display.
function renew(token) {
  keepToken(token);
  about = null; renewed = true;
  link.renew(token);
}

// Every view; one that needs what is not there says so. The display is the page's, or else the one of the command line.
function navigation(state) {
  const display = state.display ?? about.named;
  // of the moment in which it is followed: a loop is shaped meanwhile
  const to = (view) => { const { channel, shapes, own } = state; return address({ view, display, channel, shapes, own: view === state.view ? own : remembered[view] }); };
  const links = Object.entries(about.views).map(([view, { title, of_display: ofDisplay, of_rig: ofRig }]) => {
    const needs = ofDisplay && !display ? "needs a display" : ofRig && !about.rig ? "needs a rig" : "", words = [title, ...(needs ? [make("small", {}, ` ${needs}`)] : [])];
    if (ofDisplay && needs) return make("span", { class: "needs", id: `to-${view}` }, ...words);
    return make("a", { href: to(view), id: `to-${view}`, class: needs ? "needs" : null, "aria-current": view === state.view ? "page" : null, onclick: (event) => event.currentTarget.setAttribute("href", to(view)) }, ...words);
  });
  el("views").replaceChildren(...links);
  el("where").textContent = display ? displayName(display) : "";
}

// Addresses may follow each other faster than their views open: the last is shown, and what another draws late is drawn
// on an element that the page no longer has.
async function route() {
  if (!ready) return;
  const number = ++routes;
  const state = read();
  el("tip").hidden = true;
  delete document.body.dataset.ready;
  if (shown?.state) remembered[shown.state.view] = shown.state.own;
  shown?.close?.();
  shown = null;
  const last = el("view"), view = last.cloneNode(false);
  view.replaceChildren(...last.childNodes);
  last.replaceWith(view);
  renewed = false;
  try {
    about ??= await link.ask("start");
    if (number !== routes) return;
    const of = state.display ?? about.named, { views } = about;
    if (Object.keys(state.shapes).length) shapesOf[of] = state.shapes; else state.shapes = shapesOf[of] ??= {};
    if (!(state.view in views) || (views[state.view].of_display && !state.display)) state.view = "start";
    names.file = about.file;
    navigation(state);
    // a request of the view that was left may take long, and the next one's waits for its answer
    const leftover = view.firstChild;
    setTimeout(() => {
      if (number !== routes || !leftover || view.firstChild !== leftover) return;
      view.replaceChildren(make("h1", {}, views[state.view].title), make("p", {}, "Waiting for the server."));
    }, LEFTOVER_MS);
    const { default: View } = await import(`./${state.view}.js`); // when it is opened first
    if (number !== routes) return;
    shown = new View(view, link, state);
    await shown.open();
    if (number !== routes) return;
    shown.isOpen = true;
    if (views[state.view].of_display) { write(state); navigation(state); }
  } catch (error) {
    if (number !== routes || error.lost) return; // it is opened when the server is back
    refusal(error);
  }
  leftRig();
  document.body.dataset.ready = state.view;
  performance.mark("usable");
}

window.addEventListener("hashchange", () => {
  const token = takeToken();
  if (token === link.token) route(); else renew(token);
});
// Caught ahead of the fields and tips for which the key means something too.
window.addEventListener("keydown", (event) => { if (event.key === "Escape" && about?.rig) stopRig(); }, true);
window.addEventListener("resize", () => shown?.resize?.());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => shown?.restyle?.());
