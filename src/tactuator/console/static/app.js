// The page: which view its address names, and the connection that all of them use.
import { address, read, takeToken, write } from "./address.js";
import { banner, el, refusal } from "./dom.js";
import { Link } from "./link.js";
import { Loop } from "./loop.js";
import { start } from "./start.js";

const LOST = "The server does not answer. What is in this page is still here; it goes on when the server is back.";
const REFUSED = "This address has no valid token. Open the address that the command printed.";
let shown = null, ready = false;

const link = new Link(takeToken(), (what) => {
  ready = what === "open";
  banner({ open: "", lost: LOST, refused: REFUSED }[what]);
  if (ready) { if (shown?.frame) shown.request("draw", {}, performance.now()); else route(); }
}, (message) => shown?.take?.(message));

async function route() {
  if (!ready) return;
  const state = read();
  el("tip").hidden = true;
  try {
    if (state.view === "loop" && state.display) {
      shown = new Loop(el("view"), link, state);
      el("where").textContent = state.display.replace("example:", "example ");
      el("to-loop").hidden = false;
      await shown.open();
      write(state);
      el("to-loop").setAttribute("href", address(state));
    } else {
      shown = null;
      el("where").textContent = "";
      await start(el("view"), link);
    }
  } catch (error) { refusal(error); }
  for (const [id, view] of [["to-start", "start"], ["to-loop", "loop"]]) el(id).toggleAttribute("aria-current", state.view === view);
  document.body.dataset.ready = state.view;
  performance.mark("usable");
}

window.addEventListener("hashchange", route);
window.addEventListener("resize", () => shown?.resize?.());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => shown?.restyle?.());
