"use strict";
// The subject's page. It shows what the server's messages say, and keeps an answer until it is acknowledged.
// going: the subject has begun; asked: the server knows it; pending: the trial that waits for an answer;
// litAt: when each interval's lamp was lit; leaving: the subject is asked how to leave, or is to be once nothing plays.
const page = {
  about: null, stage: null, ended: null, introduction: "", waiting: false, going: false, asked: false, pending: null, unsaved: null,
  shownAt: 0, litAt: [], noise: null, choices: null, demonstration: null, restUntil: 0, over: false, leaving: false,
};
const ENDS = { declined: "declined", withdrawn: "withdrawn_keep", "withdrawn-discard": "withdrawn_discard" };
const finished = () => page.stage === "done" || page.stage === "ended";
const say = (text) => { if (el("status").textContent !== text) el("status").textContent = text; };

// A link from another system names the participant: the server keeps it before the session opens.
async function claimed() {
  const participant = new URLSearchParams(location.search).get("participant");
  if (participant === null) return true;
  for (;;) {
    const answer = await fetch(`?${new URLSearchParams({ participant })}`, { method: "POST" }).catch(() => ({ status: 503 }));
    if (answer.status < 500) {
      page.over = !answer.ok;
      if (page.over) say(word("other_participant"));
      return answer.ok;
    }
    banner(word("lost"));
    await new Promise((wait) => setTimeout(wait, 500));
  }
}

const link = new Link(
  `/ws/subject/${location.pathname.split("/").pop()}`,
  (message) => handlers[message.type] && handlers[message.type](message),
  () => banner(""),
  (code) => {
    if (page.over || code === 4001) return false;
    if (code === 4004) { page.over = true; if (!finished()) say(word("no_session")); return false; }
    setPending(null);
    page.asked = false;
    banner(word("lost"));
    return true;
  },
  claimed(),
);

const handlers = {
  hello(message) {
    page.about = message;
    page.asked = false; // what was asked for came from the connection before
    el("study").textContent = message.study;
    el("who").textContent = message.subject;
    simulated(message);
    if (page.noise === null) page.noise = new MaskingNoise(message.masking_sound);
    if (page.choices === null) page.choices = new Choices(el("choices"), el("lamps"), message.choices, message.intervals, answer);
    page.choices.open(false);
    if (page.unsaved !== null) link.send(page.unsaved);
  },
  stage(message) {
    page.restUntil = message.break_left_s > 0 ? performance.now() + 1000 * message.break_left_s : 0;
    if (message.stage === "break" && page.stage !== "break") rest();
    if (message.stage === "trial" && page.going && !["", page.introduction].includes(message.introduction)) page.going = page.asked = false; // announced
    if (message.stage !== page.stage) { page.asked = false; page.leaving = page.leaving && message.stage === "paused"; }
    Object.assign(page, { stage: message.stage, ended: message.ended, introduction: message.introduction, waiting: message.waiting });
    progress(message);
    if (message.stage === "paused" || message.stage === "stopped") {
      page.noise.stop(); // the rig is at rest
      page.demonstration.stop();
      page.going = false;
      page.unsaved = null;
      setPending(null);
    }
    else if (message.stage !== "trial") page.going = page.going && message.stage === "introduction" && page.asked;
    else if (page.going && page.pending === null && !page.asked) goOn();
    show();
  },
  playing() {
    page.waiting = false;
    banner(""); // what had failed plays again
    page.litAt = [];
    setPending(null);
    page.choices.clear();
    page.choices.playing(true);
    show();
  },
  interval(message) {
    if (message.on) page.litAt[message.interval] = performance.now();
    page.choices.light(message.on ? message.interval : -1);
  },
  shape(message) { page.demonstration.play(message); },
  "answer-now"(message) {
    page.waiting = false;
    document.body.dataset.trial = `${message.run}/${message.number}`;
    page.shownAt = performance.now();
    setPending({ run: message.run, number: message.number });
    show();
  },
  ack(message) {
    if (page.unsaved !== null && message.right !== null) {
      const correct = page.unsaved.response === message.right;
      if (!correct) page.choices.mark(page.unsaved.response, "wrong");
      page.choices.mark(message.right, "right");
      const { label } = page.about.choices.find((choice) => choice.response === message.right) || { label: message.right };
      say(correct ? word("right") : word("wrong", { right: label }));
    }
    page.unsaved = null;
    setPending(null);
    progress(message);
    banner("");
  },
  fault(message) {
    banner(message.message);
    if (page.unsaved !== null) setTimeout(() => page.unsaved !== null && link.send(page.unsaved), 1500);
    else { page.going = false; page.asked = false; setPending(null); show(); } // the rig failed, and the subject says when to go on
  },
  refused(message) {
    page.unsaved = null; page.asked = false; setPending(null);
    if (message.said === "") return;
    banner(message.said);
    if (page.choices.number !== null) page.choices.valid(false);
  },
  elsewhere() { over("elsewhere"); },
  changed() { over("changed"); },
};

function over(why) {
  page.over = true;
  setPending(null);
  hideAll();
  el("go").hidden = false;
  el("go").textContent = word("continue_here");
  say(word(why));
}

function simulated({ simulated: yes, shown }) {
  el("simulated").hidden = !yes;
  el("simulated").firstElementChild.textContent = word(shown === "" ? "simulated_blank" : "simulated");
  el("sound").hidden = !shown.includes("heard");
  el("sound").textContent = word("sound_on");
  if (page.demonstration === null) page.demonstration = new Demonstration(el("stimulus"), el("sound"));
}

function progress({ progress: share, left_s: left }) {
  el("progress").value = share;
  const minutes = Math.ceil(left / 60);
  el("left").textContent = page.stage === "ended" || share >= 1 ? "" : minutes > 1 ? word("minutes_left", { minutes }) : word("minute_left");
}

function setPending(trial) {
  page.pending = trial;
  if (page.choices === null) return;
  page.choices.open(trial !== null);
  page.choices.light(-1);
  page.choices.playing(false);
}

function hideAll() { for (const id of ["text", "lamps", "choices", "go", "others", "stimulus", "pause", "names"]) el(id).hidden = true; }

function rest() {
  const tick = () => { if (page.stage === "break") { show(); if (restLeft() > 0) setTimeout(tick, 250); } };
  setTimeout(tick, 0);
}

const restLeft = () => Math.max(0, Math.ceil((page.restUntil - performance.now()) / 1000));

// Returns what a stage shows before the subject goes on: [status, text, button, other buttons].
const before = {
  consent: () => [word("before"), page.about.consent, word("agree"), [[word("decline"), () => link.send({ type: "decline" })]]],
  break: () => [word("break"), "", restLeft() > 0 ? word("break_wait", { seconds: restLeft() }) : word("go_on"), leave()],
  introduction: () => [page.about.prompt, words(page.introduction), word("begin"), leave()],
  trial: () => [page.about.prompt, words(page.introduction), word("begin"), leave()],
  paused: () => [word("paused"), "", word("go_on"), [[word("stop"), () => link.send({ type: "stop" })], ...leave()]],
  stopped: () => [word("stopped"), "", word("go_on"), leave()],
};
const words = (introduction) => [page.about.instructions, introduction].filter((part) => part !== "").join("\n\n");
const leave = () => [[word("withdraw"), () => { page.leaving = true; if (page.asked || page.going) pause(); show(); }]];

function asked(buttons) {
  el("others").hidden = buttons.length === 0;
  el("others").replaceChildren(...buttons.map(([text, pressed]) => {
    const button = make("button", { type: "button" }, text);
    button.onclick = pressed;
    return button;
  }));
}

function show() {
  if (page.over || page.about === null) return;
  hideAll();
  if (finished()) {
    say(word(page.stage === "done" ? "done" : ENDS[page.ended]));
    el("left").textContent = "";
    page.noise.stop();
  } else if (page.leaving && !(page.stage === "trial" && page.going)) {
    say(word("withdraw_ask"));
    const back = [word("back"), () => { page.leaving = false; show(); }];
    const sure = (keep) => () => {
      say(word(keep ? "withdraw_sure_keep" : "withdraw_sure_discard"));
      asked([[word("withdraw"), () => link.send({ type: "withdraw", keep })], back]);
      el("others").lastElementChild.focus();
    };
    asked([[word("withdraw_keep"), sure(true)], [word("withdraw_discard"), sure(false)], back]);
    el("others").lastElementChild.focus(); // Enter goes back, and leaves nothing
  } else if (page.stage === "trial" && page.going) trial();
  else {
    const [status, text, button, others] = before[page.stage]();
    say(status);
    el("text").hidden = text === "";
    el("text").textContent = text;
    el("go").textContent = button;
    el("names").hidden = !(page.stage === "consent" && page.about.consent_by === "name");
    el("go").disabled = page.stage === "break" && restLeft() > 0;
    el("go").hidden = false;
    asked(others);
    if (!el("others").contains(document.activeElement) && !(page.stage === "consent" && el("names").contains(document.activeElement))) el(text === "" ? "go" : "text").focus();
  }
}

function trial() {
  el("choices").hidden = el("pause").hidden = false;
  asked(page.leaving ? [] : leave());
  el("stimulus").hidden = page.about.shown === "";
  if (!page.choices.hasFocus()) el("choices").focus(); // the next Tab leads to the responses
  el("lamps").hidden = el("lamps").childElementCount === 0;
  if (page.pending !== null) say(page.about.prompt);
  else if (page.waiting) say(word("wait"));
  else if (page.unsaved === null) say(word("feel"));
  page.choices.fit();
}

function goOn() { page.asked = true; link.send({ type: "ready", stage: page.stage }); }

// Scrolls on, and returns true, where the end of the text has not been in sight: Enter agrees to what can have been read.
function readOn() {
  const main = document.querySelector("main"), { bottom } = main.getBoundingClientRect();
  if (el("text").hidden || el("text").getBoundingClientRect().bottom <= bottom + 2) return false;
  banner(word("read_on"));
  main.scrollBy({ top: 0.8 * main.clientHeight });
  return true;
}

function go() {
  if (page.over) { location.reload(); return; }
  if (page.asked || el("go").disabled) return;
  if (page.stage === "consent" && readOn()) return;
  page.noise.start();
  banner("");
  if (page.stage === "consent") { link.send({ type: "consent", name: el("name").value }); return; }
  page.going = page.stage !== "break" || page.introduction === "";
  goOn();
  if (page.stage === "trial") show();
}

// Nothing is to play, whatever the page shows: what was asked for may be on its way.
function pause() {
  const rests = ["paused", "stopped"].includes(page.stage) && !page.asked;
  if (page.over || rests || finished()) return;
  page.unsaved = null;
  setPending(null);
  link.send({ type: "pause" });
}

function answer(response) {
  if (page.pending === null && page.unsaved === null && page.stage === "trial" && page.going) say(word("too_early"));
  if (page.pending === null || page.unsaved !== null) return;
  const pressed = performance.now(), lit = Array.from(page.litAt, (at) => at === undefined ? null : at);
  page.unsaved = { type: "answer", ...page.pending, response, shown_ms: page.shownAt, pressed_ms: pressed, lit_ms: lit };
  setPending(null);
  page.choices.clear();
  page.choices.mark(response, "chosen");
  say(word("saving"));
  link.send(page.unsaved);
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const enter = event.key === "Enter" || event.key === " ";
  if (event.repeat) { if (enter) event.preventDefault(); return; }
  const writes = el("names").contains(document.activeElement);
  if (writes && event.key !== "Enter" && event.key !== "Escape") return;
  const response = page.choices === null || el("choices").hidden ? undefined : page.choices.byKey(event.code, event.key);
  const other = document.activeElement !== null && el("others").contains(document.activeElement);
  if (response !== undefined) { event.preventDefault(); answer(response); }
  else if (event.key === "Escape") pause();
  else if (enter && !el("go").hidden && !other) { event.preventDefault(); go(); }
  else if (event.key in ARROWS && !el("choices").hidden && page.choices.number === null) { event.preventDefault(); page.choices.move(...ARROWS[event.key]); }
});
el("go").onclick = go;
el("names").onsubmit = (event) => event.preventDefault();
el("pause").onclick = pause;
