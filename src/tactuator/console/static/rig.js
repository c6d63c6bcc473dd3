// The rig of the console: its connection and state, who has the controls, and the stop that is always there.
import { banner, make, refusal, say } from "./dom.js";
import { Link } from "./link.js";

const LOST = "The server does not answer. Its rig goes to rest by itself; what is in this page is still here, and can be saved.";
const MODES = { idle: "at rest", live: "live", listening: "listening", measuring: "measuring", presenting: "an experiment plays", fault: "stopped by a fault", gone: "the rig has gone" };
const HOLDERS = { you: "this page has the controls", another: "another page has the controls; this one watches", nobody: "nobody has the controls",
  experiment: "an experiment has the rig; pages of the scope watch" };

const KEPT = 6;
// The newest measurements that this page received; they stay while views come and go.
export const measured = new Map();
let held = null, count = 0;

// The rig of this page for a view: what plays continues from one view of the rig to the next. changed: called whenever the
// standing has changed, and once by the view. pushed: called with frames, levels and points; true where a frame is drawn.
export function takenRig(changed, pushed) {
  if (held && held.link.token !== sessionStorage.getItem("token")) held.end();
  held ??= new Rig();
  return Object.assign(held, { changed, pushed });
}

// Where a view without the rig is shown the page lets it go: the generator goes silent.
export function leftRig() { if (held && !held.pushed) held.end(); }

// There is one stop, of every view: all that goes on ends, whichever page began it. The rig's connection is there and the
// faster way; a request beside it waits for no other request of the page.
export const stopRig = () => { held?.rest(); fetch("/rest", { method: "POST", headers: { "x-token": sessionStorage.getItem("token") ?? "" } }).then(() => banner(""), () => {}); };

class Rig {
  constructor() {
    Object.assign(this, { standing: null, open: false, loading: 0, forFile: false });
    this.close();
    this.bar = make("div", { class: "rig-bar", role: "region", "aria-label": "Rig" });
    this.mode = make("strong", { id: "rig-mode" }, "connecting");
    this.more = make("span", { id: "rig-more" });
    this.held = make("span", { id: "rig-held" });
    const press = (id, text, pressed, more = {}) => make("button", { type: "button", id, onclick: pressed, ...more }, text);
    this.buttons = { take: press("take", "Take over", () => this.do("take")), give: press("give", "Give back", () => this.do("give")), reopen: press("reopen", "Open the rig again", () => this.do("reopen")),
      stop: press("stop", "Stop", stopRig, { class: "stop", title: "Escape: all that goes on ends, and the rig comes to rest" }) };
    this.bar.append(make("span", {}, this.mode, " ", this.more), this.held, make("span", { class: "gap" }), ...Object.values(this.buttons));
    this.link = new Link(sessionStorage.getItem("token") ?? "", (what) => this.connection(what), (message) => this.take(message), "/ws/rig");
  }

  // A view leaves it.
  close() { Object.assign(this, { changed: () => {}, pushed: null }); }
  end() { held = null; this.link.close(); }
  get watches() { return this.standing?.controls !== "you"; }
  get mayPlay() { return this.open && !this.watches && !this.loading && !["gone", "fault"].includes(this.standing.mode); }
  get has() { return this.watches ? HOLDERS[this.standing.controls] : ""; }
  get experiment() { return this.standing?.controls === "experiment"; }

  connection(what) {
    this.open = what === "open";
    if (what === "lost") { banner(LOST); this.mode.textContent = "not connected"; }
    if (what === "none") this.absent = true;
    if (this.open) banner("");
    this.show();
    this.changed();
  }

  take(message) {
    if (message instanceof ArrayBuffer) { if (!this.pushed?.({ frame: message })) this.drawn(new Uint32Array(message, 0, 1)[0]); return; }
    if (message.refused) { banner(message.refused); this.pushed?.(message); }
    if (message.standing) {
      const before = this.standing?.mode, played = this.standing?.wave?.kind, { wave, mode } = this.standing = message.standing;
      if (this.forFile && played === "file" && !wave && mode === "live" && !this.watches) stopRig(); // the file is over, or was stopped
      this.forFile &&= wave?.kind === "file" || played !== "file";
      if (before !== this.standing.mode && this.standing.controls !== "experiment") say(MODES[this.standing.mode]);
      this.show();
      this.changed();
    } else {
      if (message.points) this.keep(message.points);
      this.pushed?.(message);
    }
  }

  drawn(frame) { this.send("drawn", { frame }); }
  rest() { if (this.open) this.send("rest"); }
  send(what, more = {}) { this.link.socket.send(JSON.stringify({ id: 0, do: what, ...more })); }

  // A measurement has its number at one server, of which the token is the name.
  keep(points) {
    const key = `${this.link.token} ${points.number}`, before = measured.get(key) ?? { place: ++count, shown: true };
    measured.set(key, Object.assign(before, points));
    if (measured.size > KEPT) measured.delete(measured.keys().next().value);
  }

  show() {
    const one = this.standing;
    this.bar.dataset.mode = this.open && one ? one.mode : "lost";
    for (const [name, button] of Object.entries(this.buttons)) button.disabled = !this.open;
    if (!one) return;
    if (this.open) this.mode.textContent = MODES[one.mode];
    const guard = one.guard.mode ? `guard: ${one.guard.mode}${one.guard.fault ? `, ${one.guard.fault} at ${one.guard.channel}` : ""}${one.guard.late ? `, ${one.guard.late} late ticks` : ""}` : one.touchable ? "no guard" : "";
    this.more.textContent = [one.rig, guard, one.fault, one.gaps ? `${one.gaps} gaps` : "", one.loaded ? `dB SL over the curve ${one.controller.curve}` : ""].filter(Boolean).join(" · ");
    this.held.textContent = HOLDERS[one.controls];
    this.buttons.take.hidden = ["you", "experiment"].includes(one.controls);
    this.buttons.give.hidden = one.controls !== "you";
    this.buttons.reopen.hidden = one.mode !== "gone";
  }

  // A controller is on its way to the rig, or is there: what began meanwhile would be ended by it.
  loads(on) { this.loading += on ? 1 : -1; this.changed(); }

  async do(what, more = {}) {
    try {
      const answer = await this.link.ask(what, more);
      banner("");
      return answer;
    } catch (error) { refusal(error); return null; }
  }
}

// A view of a rig: it is built when the rig has reported what it is, or that it is missing.
export function connected(view, title, built, standing, pushed) {
  view.replaceChildren(make("h1", {}, title), make("p", {}, "Connecting to the rig."));
  return new Promise((ready) => {
    let begun = false;
    const rig = takenRig(() => {
      if (rig.absent) { view.replaceChildren(...absent()); ready(rig); }
      if (!rig.standing) return;
      if (!begun) { begun = true; built(rig); }
      standing(rig);
      ready(rig);
    }, pushed);
    rig.changed();
  });
}

const absent = () => [make("h1", {}, "No rig"), make("p", {}, "This view needs a rig, and the console was begun without one. Begin it with one, a simulated one for example, to see and drive a display here."), make("code", {}, "tactuator console DISPLAY.toml --rig simulated")];
