// The view Experiment: a study at the console's rig. It is begun here; then the operator's own panel shows and drives it.
import { write } from "./address.js";
import { banner, command, el, fault, make, refusal, saveMade, say } from "./dom.js";
import { Drop } from "./drop.js";
import { Link } from "./link.js";
import { Loader } from "./loader.js";
import { connected } from "./rig.js";
import { term } from "./words.js";

const named = (key) => key.replace("example:", "example ");

const STORE = "[A-Za-z0-9_\\-][A-Za-z0-9._ \\-]{0,100}\\.db";

export default class Experiment {
  constructor(view, link, state) { Object.assign(this, { view, link, state, own: state.own, files: [], study: null, known: undefined }); }

  async open() {
    this.offered = await this.link.ask("experiment.start");
    if (this.closed) return;
    this.rig = await connected(this.view, "Experiment", (rig) => { this.rig = rig; this.build(); }, () => this.standing(), () => {});
    if (this.rig.absent || this.closed) return;
    await new Promise((ready) => {
      this.studies = new Link(sessionStorage.getItem("token") ?? "", (what) => { if (what !== "open") { this.known = undefined; ready(); } },
        (message) => { if (message.study) this.update(message.study.open).catch(refusal).finally(ready); }, "/ws/study");
    });
  }

  close() { this.closed = true; this.leave?.(); this.studies?.close(); this.rig?.close(); }

  build() {
    const { display } = this.rig.standing;
    this.loader = new Loader(this.rig, this.link, this.state);
    this.title = make("h1", {}, `Experiment on ${display}`);
    this.said = make("p", { class: "crossed alert", role: "alert" });
    this.bits = { setup: make("div", { class: "panel" }), panel: make("div"), more: make("div") };
    this.view.replaceChildren(this.title, this.rig.bar, this.loader.box, this.said, this.bits.setup, this.bits.panel, this.bits.more);
    this.setup();
  }

  // What a study begins from: a protocol, a store, and how it goes on.
  setup() {
    const { protocols, stores, store } = this.offered, option = (key) => make("option", { value: key, selected: key === this.own.protocol ? "" : null }, named(key));
    this.protocol = make("select", { id: "protocol", onchange: () => this.look(this.protocol.value).catch((error) => this.refuse(error)) }, make("option", { value: "" }, "choose"), ...protocols.map(option));
    this.drop = new Drop(this.link, { label: "Protocol of your own", accept: ".toml", hint: "Drop a protocol file (TOML) here, or choose an example.", taken: (key, name) => this.look(key, name) });
    this.drop.input.id = "protocol-file";
    this.others = new Drop(this.link, { label: "Files that it names", multiple: true, hint: "Recordings with their .json, and a language file, if the protocol names any.", taken: (key, name) => { this.files = [...this.files, key]; say(`${name} is there`); } });
    this.about = make("p", { id: "about-protocol", role: "status" });
    this.store = make("input", { id: "store", type: "text", value: this.own.store ?? store, list: "stores", autocomplete: "off", pattern: STORE, onchange: () => { this.own.store = this.store.value; write(this.state); } });
    this.auto = make("input", { type: "checkbox", id: "auto-start", checked: this.own.auto ? "" : null, onchange: () => { this.own.auto = this.auto.checked ? "1" : ""; write(this.state); } });
    this.amend = make("input", { type: "text", id: "amend", autocomplete: "off", placeholder: "of a study that has begun" });
    this.begin = make("button", { type: "button", id: "begin", class: "first", onclick: () => this.start() }, "Begin or resume");
    this.needs = make("span", { id: "needs", class: "needs" });
    this.bits.setup.replaceChildren(make("h2", {}, "Begin or resume a study"),
      make("p", {}, "The study plays on the rig above, with the controller that is loaded. Its ", term("experiment store", "store"), " keeps every answer; a store that is there is resumed. The ", term("experiment protocol", "protocol"), " says what is played, and by which rule, a ", term("staircase"), " for example. While the study is open, the scope and the response watch and cannot play."),
      make("div", { class: "begin" },
        make("div", {}, make("label", { for: "protocol" }, "protocol that comes with the package"), this.protocol, this.drop.box, this.about),
        make("div", {}, make("label", { for: "store" }, "store, a file in the folder of the console"), this.store, make("datalist", { id: "stores" }, ...stores.map((name) => make("option", { value: name }))),
          this.others.box, make("label", {}, this.auto, " subjects may begin without the operator"), make("label", { for: "amend" }, "reason, where the protocol was changed"), this.amend)),
      make("div", { class: "bar" }, this.begin, this.needs));
    if (this.own.protocol) this.look(this.own.protocol, this.own.name).catch(() => this.chosen("", ""));
    this.standing();
  }

  refuse(error) { this.said.textContent = error.lost ? "The server does not answer." : error.message; }

  // A protocol that is none is refused where it was dropped, and no study begins from the one before it.
  async look(key, name = "") {
    this.chosen("", "");
    if (!key) return;
    const found = await this.link.ask("experiment.look", { protocol: key });
    this.chosen(key, name);
    const needed = found.files.length && name ? ` It names ${found.files.join(", ")}: drop them too.` : "";
    this.about.textContent = `${name || named(key)}: the study “${found.study}”, ${found.kind}, language ${found.language}, subjects ${found.subjects.join(", ") || "none yet"}.${needed}${found.warning && ` ${found.warning}.`}`;
  }

  chosen(key, name) {
    Object.assign(this.own, { protocol: key, name });
    this.protocol.value = name ? "" : key;
    if (!name) { this.drop.name.textContent = ""; this.drop.refuse(""); }
    this.about.textContent = "";
    this.said.textContent = "";
    write(this.state);
    this.standing();
  }

  // The rig passes from this page to the study, and comes back where it is refused.
  async start() {
    const wrong = !this.store.value || this.store.validity.patternMismatch;
    fault(this.store, wrong ? `store: “${this.store.value}”; expected a name of letters and digits that ends in .db` : "");
    if (wrong) return;
    this.busy = true;
    this.standing();
    await this.rig.do("give");
    try {
      await this.studies.ask("begin", { protocol: this.own.protocol, store: this.store.value, files: this.files, auto_start: this.auto.checked, amend: this.amend.value });
      this.said.textContent = "";
    } catch (error) {
      this.refuse(error);
      await this.rig.do("take");
    }
    this.busy = false;
    this.standing();
  }

  async end() {
    try {
      await this.studies.ask("end");
      await this.rig.do("take");
      this.offered = await this.link.ask("experiment.start");
      this.setup();
    } catch (error) { this.refuse(error); }
  }

  standing() {
    if (!this.begin) return;
    const { rig } = this;
    this.loader.standing();
    this.loader.box.hidden = rig.experiment;
    this.begin.disabled = this.busy || !rig.mayPlay || !rig.standing.loaded || !this.own.protocol || rig.standing.mode === "measuring";
    this.begin.textContent = this.busy ? "Wait" : "Begin or resume";
    const needs = [rig.standing.loaded ? "" : "a controller, loaded above", this.own.protocol ? "" : "a protocol"].filter(Boolean);
    this.needs.textContent = needs.length ? `needs ${needs.join(" and ")}` : "";
  }

  // What the server says of the study; the panel is taken up once, and left when the study is over.
  async update(study) {
    if (JSON.stringify(study) === JSON.stringify(this.known)) return;
    this.known = study;
    this.leave?.();
    this.leave = null;
    this.bits.setup.hidden = this.title.hidden = study !== null;
    if (study === null) { this.bits.panel.replaceChildren(); this.bits.more.replaceChildren(); banner(""); return; }
    this.bits.more.replaceChildren(this.exports(study), make("div", { class: "panel" }, make("h2", {}, "The same by commands"),
      make("dl", { class: "commands" }, ...study.commands.flatMap(([what, line]) => [make("dt", {}, what), make("dd", {}, command(line))]))));
    this.bits.panel.replaceChildren(await operatorPanel());
    this.leave = window.openOperator(this.studies.token, () => {});
    say(`The study ${study.study} is open.`);
  }

  exports(study) {
    const line = make("div"), form = make("select", { id: "form" }, ...this.offered.forms.map((one) => make("option", { value: one }, one)));
    const done = make("p", { role: "status", id: "exported" });
    const save = make("button", { type: "button", id: "export", onclick: async () => {
      try {
        const made = await this.studies.ask("export", { store: study.store, form: form.value });
        line.replaceChildren(command(made.command));
        await saveMade(this.studies.token, made.key, made.name);
        done.textContent = `${made.trials} trials in ${made.name}`;
      } catch (error) { done.textContent = error.message; }
    } }, "Save the export");
    const over = make("button", { type: "button", id: "end-study", onclick: () => this.end() }, "End the study here");
    return make("div", { class: "panel" }, make("h2", {}, `Store ${study.store}`),
      make("div", { class: "bar" }, make("label", {}, "format ", form), save, make("span", { class: "gap" }), over), done, line,
      make("p", {}, "Ending closes the store and gives the rig back to the scope. Nothing that was answered is lost; the study is resumed from the same store."));
  }
}

// The operator's page of this server, without the page around it: its texts, its scripts (once), and its sections.
async function operatorPanel() {
  const answer = await fetch("/operator");
  if (!answer.ok) throw new Error("The study is not open any more.");
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  el("words")?.remove();
  document.body.append(document.importNode(page.getElementById("words"), true));
  const loaded = new Set([...document.scripts].map((one) => one.src));
  for (const { src } of [...page.scripts].filter((one) => one.src)) {
    const at = new URL(src, location.href).href;
    if (loaded.has(at) || at.endsWith("/operator.js")) continue; // its own entry: this view is another
    await new Promise((ready, failed) => document.head.append(make("script", { src: at, onload: ready, onerror: () => failed(new Error("A part of the page does not come.")) })));
  }
  const found = document.importNode(page.querySelector(".operator"), true), main = found.querySelector("main");
  main.replaceWith(make("div", { class: "parts" }, ...main.childNodes));
  return found;
}
