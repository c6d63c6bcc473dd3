"use strict";
// The subject's page. What it shows follows from what the server says; an answer stays here until it is acknowledged.
const el = (id) => document.getElementById(id);
const page = {
  socket: null, about: null, stage: null, waiting: false, going: false, standing: null, unsaved: null, asked: false, shownAt: 0, noise: null, over: false,
};

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const token = location.pathname.split("/").pop();
  const socket = new WebSocket(`${scheme}://${location.host}/ws/subject/${token}`);
  page.socket = socket;
  socket.onopen = () => banner("");
  socket.onmessage = (event) => take(JSON.parse(event.data));
  socket.onclose = (event) => {
    if (page.over || event.code === 4001) return;
    if (event.code === 4004) { page.over = true; say("This link opens no session."); return; }
    page.standing = null;
    page.asked = false;
    light(-1);
    banner("The connection is lost. Nothing of what was acknowledged is gone. Trying again…");
    setTimeout(connect, 500);
  };
}

const send = (message) => {
  if (page.socket.readyState === WebSocket.OPEN) page.socket.send(JSON.stringify(message));
};

const handlers = {
  hello(message) {
    page.about = message;
    page.asked = false; // whatever was asked for was asked of another connection
    el("study").textContent = message.study;
    el("who").textContent = message.subject;
    if (page.noise === null) page.noise = new MaskingNoise(message.masking_sound);
    draw(message.responses);
    if (page.unsaved !== null) send(page.unsaved);
  },
  stage(message) {
    page.stage = message.stage;
    page.waiting = message.waiting;
    el("progress").value = message.progress;
    if (message.stage === "trial" && page.going) {
      if (page.standing === null && !page.asked) { page.asked = true; send({ type: "ready" }); }
    } else if (message.stage !== "trial") page.going = false;
    show();
  },
  interval(message) {
    page.asked = false;
    page.waiting = false;
    if (message.on && message.interval === 0) { page.standing = null; clear(); }
    light(message.on ? message.interval : -1);
    show();
  },
  "answer-now"(message) {
    page.asked = false;
    page.standing = { run: message.run, number: message.number };
    document.body.dataset.trial = `${message.run}/${message.number}`;
    page.shownAt = performance.now();
    light(-1);
    show();
  },
  ack(message) {
    const button = page.unsaved && el("intervals").querySelector(`[data-response="${page.unsaved.response}"]`);
    if (button && message.correct !== null) button.classList.add(message.correct ? "right" : "wrong");
    if (message.correct !== null) say(message.correct ? "Right" : "Not this one");
    page.unsaved = null;
    page.standing = null;
    el("progress").value = message.progress;
    banner("");
  },
  fault(message) {
    banner(message.message);
    if (page.unsaved !== null) setTimeout(() => page.unsaved !== null && send(page.unsaved), 1500);
  },
  refused() { page.unsaved = null; page.standing = null; },
  elsewhere() {
    page.over = true;
    el("intervals").hidden = true;
    el("go").hidden = false;
    el("go").textContent = "Continue here";
    say("This session was opened in another tab.");
  },
};

const take = (message) => handlers[message.type] && handlers[message.type](message);
const say = (text) => { el("status").textContent = text; };
const banner = (text) => { el("banner").hidden = text === ""; el("banner").textContent = text; };

function draw(responses) {
  el("intervals").replaceChildren(...responses.map((response) => {
    const button = document.createElement("button");
    button.className = "interval";
    button.dataset.response = response;
    button.textContent = response;
    button.onclick = () => answer(response);
    return button;
  }));
}

function light(interval) {
  [...el("intervals").children].forEach((button, index) => button.classList.toggle("lit", index === interval));
}

function clear() {
  for (const button of el("intervals").children) button.classList.remove("chosen", "right", "wrong");
}

function show() {
  const text = el("text"), go = el("go");
  const trial = page.stage === "trial";
  el("intervals").hidden = !(trial && page.going);
  text.hidden = true;
  go.hidden = trial && page.going;
  if (page.stage === "consent") {
    say("Before we begin");
    text.hidden = false;
    text.textContent = page.about.consent;
    go.textContent = "I agree (Enter)";
  } else if (page.stage === "break") {
    say("Time for a break. Go on when you are ready.");
    go.textContent = "Go on (Enter)";
  } else if (page.stage === "done") {
    say("That was all. Thank you!");
    go.hidden = true;
    page.noise.stop();
  } else if (!page.going) {
    say("Which interval has the vibration?");
    text.hidden = page.about.instructions === "";
    text.textContent = page.about.instructions;
    go.textContent = "Begin (Enter)";
  } else if (page.standing !== null) say(`Which one? Press ${page.about.responses.join(", ")}`);
  else if (page.waiting) say("Please wait for the experimenter.");
  else if (page.unsaved === null) say("Feel…");
}

function go() {
  if (page.over) { location.reload(); return; }
  page.noise.start();
  if (page.stage === "consent") { send({ type: "consent" }); return; }
  if (page.stage === "break") { send({ type: "ready" }); page.going = true; return; }
  if (page.stage === "trial" && !page.going) { page.going = true; page.asked = true; send({ type: "ready" }); show(); }
}

function answer(response) {
  if (page.standing === null || page.unsaved !== null) return;
  page.unsaved = { type: "answer", ...page.standing, response, shown_ms: page.shownAt, pressed_ms: performance.now() };
  page.standing = null;
  clear();
  el("intervals").querySelector(`[data-response="${response}"]`).classList.add("chosen");
  say("…");
  send(page.unsaved);
}

document.addEventListener("keydown", (event) => {
  if (event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
  if (page.about !== null && page.about.responses.includes(event.key)) { event.preventDefault(); answer(event.key); }
  else if ((event.key === "Enter" || event.key === " ") && !el("go").hidden) { event.preventDefault(); go(); }
});
el("go").onclick = go;
connect();
