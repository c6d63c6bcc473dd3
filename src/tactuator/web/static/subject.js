"use strict";
// The subject's page. What it shows follows from what the server says; an answer stays here until it is acknowledged.
// going: the subject has begun; asked: and has told the server so; standing: the trial that waits for an answer.
const page = {
  about: null, stage: null, introduction: "", waiting: false, going: false, asked: false, standing: null, unsaved: null,
  shownAt: 0, noise: null, choices: null, restUntil: 0, over: false,
};
const say = (text) => { if (el("status").textContent !== text) el("status").textContent = text; };

const link = new Link(
  `/ws/subject/${location.pathname.split("/").pop()}`,
  (message) => handlers[message.type] && handlers[message.type](message),
  () => banner(""),
  (code) => {
    if (page.over || code === 4001) return false;
    if (code === 4004) { page.over = true; say("This link opens no session."); return false; }
    stand(null);
    page.asked = false;
    banner("The connection is lost. Nothing of what was acknowledged is gone. Trying again…");
    return true;
  },
);

const handlers = {
  hello(message) {
    page.about = message;
    page.asked = false; // whatever was asked for was asked of another connection
    el("study").textContent = message.study;
    el("who").textContent = message.subject;
    if (page.noise === null) page.noise = new MaskingNoise(message.masking_sound);
    if (page.choices === null) page.choices = new Choices(el("choices"), el("lamps"), message.choices, message.intervals, answer);
    page.choices.open(false);
    if (page.unsaved !== null) link.send(page.unsaved);
  },
  stage(message) {
    if (message.stage === "break" && page.stage !== "break") rest();
    if (message.stage !== page.stage) page.asked = false;
    Object.assign(page, { stage: message.stage, introduction: message.introduction, waiting: message.waiting });
    el("progress").value = message.progress;
    if (message.stage !== "trial") page.going = page.going && message.stage === "introduction" && page.asked;
    else if (page.going && page.standing === null && !page.asked) goOn();
    show();
  },
  playing() {
    page.waiting = false;
    stand(null);
    page.choices.clear();
    page.choices.playing(true);
    show();
  },
  interval(message) { page.choices.light(message.on ? message.interval : -1); },
  "answer-now"(message) {
    page.waiting = false;
    document.body.dataset.trial = `${message.run}/${message.number}`;
    page.shownAt = performance.now();
    stand({ run: message.run, number: message.number });
    show();
  },
  ack(message) {
    if (page.unsaved !== null && message.right !== null) {
      const correct = page.unsaved.response === message.right;
      if (!correct) page.choices.mark(page.unsaved.response, "wrong");
      page.choices.mark(message.right, "right");
      say(correct ? "Right" : `No, it was ${message.right}`);
    }
    page.unsaved = null;
    stand(null);
    el("progress").value = message.progress;
    banner("");
  },
  fault(message) {
    banner(message.message);
    if (page.unsaved !== null) setTimeout(() => page.unsaved !== null && link.send(page.unsaved), 1500);
    else { page.going = false; page.asked = false; stand(null); show(); } // the rig failed: the subject says when to go on
  },
  refused() { page.unsaved = null; stand(null); },
  elsewhere() {
    page.over = true;
    stand(null);
    hideAll();
    el("go").hidden = false;
    el("go").textContent = "Continue here";
    say("This session was opened in another tab.");
  },
};

function stand(trial) {
  page.standing = trial;
  if (page.choices === null) return;
  page.choices.open(trial !== null);
  page.choices.light(-1);
  page.choices.playing(false);
}

function hideAll() { for (const id of ["text", "lamps", "choices", "go"]) el(id).hidden = true; }

function rest() {
  page.restUntil = performance.now() + 1000 * page.about.break_s;
  const tick = () => { if (page.stage === "break") { show(); if (performance.now() < page.restUntil) setTimeout(tick, 250); } };
  setTimeout(tick, 0);
}

const restLeft = () => Math.max(0, Math.ceil((page.restUntil - performance.now()) / 1000));

// What a stage shows before the subject goes on: [status, text, button].
const before = {
  consent: () => ["Before we begin", page.about.consent, "I agree (Enter)"],
  break: () => ["Time for a break. Go on when you are ready.", "", restLeft() > 0 ? `Go on in ${restLeft()} s` : "Go on (Enter)"],
  introduction: () => [page.about.prompt, words(page.introduction), "Begin (Enter)"],
  trial: () => [page.about.prompt, words(page.introduction), "Begin (Enter)"],
};
const words = (introduction) => [page.about.instructions, introduction].filter((part) => part !== "").join("\n\n");

function show() {
  if (page.over || page.about === null) return;
  hideAll();
  if (page.stage === "done") {
    say("That was all. Thank you!");
    page.noise.stop();
  } else if (page.stage === "trial" && page.going) {
    el("choices").hidden = false;
    if (!page.choices.hasFocus()) el("choices").focus(); // the next Tab leads to the responses
    el("lamps").hidden = el("lamps").childElementCount === 0;
    if (page.standing !== null) say(page.about.prompt);
    else if (page.waiting) say("Please wait for the experimenter.");
    else if (page.unsaved === null) say("Feel…");
    page.choices.fit();
  } else {
    const [status, text, button] = before[page.stage]();
    say(status);
    el("text").hidden = text === "";
    el("text").textContent = text;
    el("go").textContent = button;
    el("go").disabled = page.stage === "break" && restLeft() > 0;
    el("go").hidden = false;
    el("go").focus();
  }
}

function goOn() { page.asked = true; link.send({ type: "ready", stage: page.stage }); }

function go() {
  if (page.over) { location.reload(); return; }
  if (page.asked || el("go").disabled) return;
  page.noise.start();
  if (page.stage === "consent") { link.send({ type: "consent" }); return; }
  page.going = page.stage !== "break" || page.introduction === "";
  goOn();
  if (page.stage === "trial") show();
}

function answer(response) {
  if (page.standing === null || page.unsaved !== null) return;
  page.unsaved = { type: "answer", ...page.standing, response, shown_ms: page.shownAt, pressed_ms: performance.now() };
  stand(null);
  page.choices.clear();
  page.choices.mark(response, "chosen");
  say("…");
  link.send(page.unsaved);
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const enter = event.key === "Enter" || event.key === " ";
  if (event.repeat) { if (enter) event.preventDefault(); return; }
  const response = page.choices === null || el("choices").hidden ? undefined : page.choices.byKey(event.key);
  if (response !== undefined) { event.preventDefault(); answer(response); }
  else if (enter && !el("go").hidden) { event.preventDefault(); go(); }
  else if (event.key in ARROWS && !el("choices").hidden) { event.preventDefault(); page.choices.move(...ARROWS[event.key]); }
});
el("go").onclick = go;
