"use strict";
// Functions that both pages use.
const el = (id) => document.getElementById(id);
const banner = (text) => { el("banner").hidden = text === ""; el("banner").textContent = text; };

function make(name, attributes = {}, ...content) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...content);
  return node;
}

// A connection that is opened again when it closes. take: called with every message. opened: called when it opens.
// closed: called with the close code; returns whether to try again. first: a promise of whether to connect at all.
class Link {
  constructor(path, take, opened, closed, first = Promise.resolve(true)) {
    Object.assign(this, { path, take, opened, closed, socket: null });
    first.then((yes) => yes && this.connect());
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}${this.path}`);
    this.socket.onopen = () => this.opened(this.socket);
    this.socket.onmessage = (event) => this.take(JSON.parse(event.data));
    this.socket.onclose = (event) => { if (this.closed(event.code)) setTimeout(() => this.connect(), 500); };
  }

  send(message) { if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message)); }
}
