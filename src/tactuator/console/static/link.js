// The connection to the server: requests with an answer each, and figures that come when they are ready.
const FORBIDDEN = 4003;
const AGAIN_MS = 600;

export class Link {
  // told: called with "open", "lost" or "refused". pushed: called with what the server sends unasked.
  constructor(token, told, pushed) {
    Object.assign(this, { token, told, pushed, count: 0, waiting: new Map() });
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/ws`);
    this.socket.onopen = () => { this.socket.send(this.token); this.told("open"); };
    this.socket.onmessage = (event) => this.take(JSON.parse(event.data));
    this.socket.onclose = (event) => {
      for (const { reject } of this.waiting.values()) reject(Object.assign(new Error("The connection was lost."), { lost: true }));
      this.waiting.clear();
      this.told(event.code === FORBIDDEN ? "refused" : "lost");
      if (event.code !== FORBIDDEN) setTimeout(() => this.connect(), AGAIN_MS);
    };
  }

  take(message) {
    const one = this.waiting.get(message.id);
    if (one === undefined) { this.pushed(message); return; }
    this.waiting.delete(message.id);
    if (message.error !== undefined) one.reject(new Error(message.error));
    else one.resolve(message);
  }

  ask(what, more = {}) {
    if (this.socket.readyState !== WebSocket.OPEN) return Promise.reject(Object.assign(new Error("The server is not connected."), { lost: true }));
    const id = ++this.count;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.socket.send(JSON.stringify({ id, do: what, ...more }));
    });
  }
}
