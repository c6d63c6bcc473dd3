// A place to drop files on: the file goes to the server on this machine, which answers with the key that it has there.
import { make, say } from "./dom.js";

export class Drop {
  // example: a file of the package that a button takes. taken: called with (key, name); it may be async, and what it throws is shown here. busy: called with true when a file
  // sets out, and with false when it is taken or refused.
  constructor(link, { label, hint = "", multiple = false, accept = "", example = "", taken, busy = () => {} }) {
    Object.assign(this, { link, label, taken, multiple, busy });
    this.input = make("input", { type: "file", multiple: multiple ? "" : null, accept: accept || null, onchange: () => { this.take([...this.input.files]); this.input.value = ""; } });
    this.alert = make("p", { class: "crossed alert", role: "alert" });
    this.name = make("span", { class: "name" });
    this.box = make("div", { class: "drop" }, make("label", {}, make("strong", {}, label), " ", this.input), this.name, hint ? make("p", {}, hint) : "",
      example ? make("button", { type: "button", class: "example", onclick: () => this.shown(example, () => ({ key: `example:${example}`, name: example })) }, `Try the example ${example}`) : "", this.alert);
    this.box.ondragover = (event) => { event.preventDefault(); this.box.classList.add("over"); };
    this.box.ondragleave = () => this.box.classList.remove("over");
    this.box.ondrop = (event) => { event.preventDefault(); this.box.classList.remove("over"); this.take([...event.dataTransfer.files]); };
  }

  refuse(text) { this.alert.textContent = text; }

  async take(files) {
    for (const file of this.multiple ? files : files.slice(0, 1)) await this.shown(file.name, () => this.send(file), file);
  }

  // The way of a file, from which `sent` returns key and name, to the view.
  async shown(words, sent, file = null) {
    this.refuse("");
    this.busy(true);
    this.box.setAttribute("aria-busy", "true");
    this.name.textContent = `${words}: on its way`;
    try {
      const { key, name } = await sent();
      this.name.textContent = name === this.label ? "" : name;
      say(`${name} is there`);
      await this.taken(key, name, file);
    } catch (error) {
      this.refuse(error.lost ? "The server does not answer; drop the file again when it is back." : error.message);
    } finally { this.box.removeAttribute("aria-busy"); this.busy(false); }
  }

  async send(file) {
    let answer;
    try {
      answer = await fetch("/drop", { method: "POST", body: file, headers: { "x-token": this.link.token, "x-name": encodeURIComponent(file.name) } });
    } catch { throw Object.assign(new Error("The server does not answer."), { lost: true }); }
    if (!answer.ok) throw new Error((await answer.text()).trim());
    return answer.json();
  }
}
