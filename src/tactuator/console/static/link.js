// The connection to the server: requests with an answer each, and figures that come when they are ready.
const ENDS = { 4003: "refused", 4004: "none" };
const AGAIN_MS = 600;

export class Link {
  // report: called with "open", "lost", "refused" or, where there is nothing at that path, "none". pushed: called with
  // what the server sends unasked, bytes as an ArrayBuffer.
  constructor(token, report, pushed, path = "/ws") {
    Object.assign(this, { token, report, pushed, path, count: 0, waiting: new Map() });
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}${this.path}`);
    this.socket.binaryType = "arraybuffer";
    this.isRefused = false;
    this.socket.onopen = () => { this.socket.send(this.token); this.report("open"); };
    this.socket.onmessage = ({ data }) => (typeof data === "string" ? this.take(JSON.parse(data)) : this.pushed(data));
    this.socket.onclose = (event) => {
      this.lose();
      if (this.closed) return;
      this.isRefused = ENDS[event.code] === "refused";
      this.report(ENDS[event.code] ?? "lost");
      if (!(event.code in ENDS)) setTimeout(() => { if (!this.closed) this.connect(); }, AGAIN_MS);
    };
  }

  renew(token) {
    this.token = token;
    this.socket.onclose = null;
    this.socket.close();
    this.lose();
    this.connect();
  }

  lose() {
    for (const { reject } of this.waiting.values()) reject(Object.assign(new Error("The connection was lost."), { lost: true }));
    this.waiting.clear();
  }

  close() {
    this.closed = true;
    this.socket.close();
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
