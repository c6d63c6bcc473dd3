"use strict";
// The operator's panel: a study, its sessions, and the run at the rig. Its own page shows it, and so does the console.
let shown = "", asks = "", dayOf = null, link = null;
let sent = null; // the form that was sent, and what becomes of it once it is not refused
const refused = { text: "", until: 0 }; // a refusal stays for a while, though snapshots come every second

// Connects the panel that is in the page; token: the operator's; gone: called where the study is not open any more.
// Returns a function that ends the connection.
function openOperator(token, gone = () => banner(word("lost"))) {
  readTexts();
  shown = asks = ""; dayOf = null; refused.until = 0;
  let over = false;
  link = new Link(
    "/ws/operator",
    (message) => {
      if (over) return;
      if (message.type === "snapshot") show(message);
      else if (message.type === "results") results(message);
      else if (message.type === "done") { say(message.message); mark(""); sent?.accepted(); sent = null; }
      else { say(message.message); mark(message.field); sent = null; }
    },
    (socket) => { socket.send(token); banner(""); },
    (code) => {
      if (over) return false;
      if (code === 4004) { gone(); return false; }
      banner(word(code === 4003 ? "token" : "lost"));
      return code !== 4003;
    },
  );
  for (const button of document.querySelectorAll("[data-command]")) button.onclick = () => command(button.dataset.command);
  el("enrol-form").onsubmit = (event) => {
    event.preventDefault();
    submit(event.target, enrolment(event.target), () => event.target.reset());
  };
  return () => { over = true; link.socket.close(); };
}

function submit(form, message, accepted) {
  sent = { form, accepted };
  link.send(message);
}

// Marks the field of that name in the form that was sent as what was refused, and no other.
function mark(name) {
  for (const one of document.querySelectorAll("form :is([name], [data-demographic])")) {
    one.setAttribute("aria-invalid", String(one.form === sent?.form && (one.name || one.dataset.demographic) === name));
  }
}

function say(text) {
  Object.assign(refused, { text, until: text === "" ? 0 : performance.now() + 10000 });
  banner(text);
}

function command(type, session) {
  refused.until = 0;
  link.send(session === undefined ? { type } : { type, session });
}
const percent = (share) => (share === null ? "–" : `\u2066${Math.round(100 * share)}\u00a0%\u2069`);
const minutes = (seconds) => (seconds === null ? "–" : word("minutes", { minutes: Math.ceil(seconds / 60) }));
const row = (...cells) => make("tr", {}, ...cells.map((cell) => make("td", {}, cell)));
const named = (table, name) => TEXTS[`${table}_${name.replace("-", "_")}`] || name;

function button(text, name, key, disabled, pressed) {
  const made = make("button", { type: "button", [`data-${name}`]: key }, text);
  made.disabled = disabled;
  made.onclick = pressed;
  return made;
}

function sessionRows(session, snapshot) {
  const key = session.visit === 1 ? session.subject : `${session.subject}-${session.visit}`;
  const open = make("a", { href: session.link, target: "_blank", rel: "noopener" }, word("open_link"));
  const over = session.stage === "done" || session.stage === "ended";
  const cannot = !snapshot.control || snapshot.active !== null || over;
  const buttons = make("div", { class: "buttons" },
    button(word("start"), "start", key, cannot, () => command("start", session.id)),
    button(word("results"), "results", key, session.trials === 0, () => command("results", session.id)),
    button(word("data"), "day", key, !snapshot.control, () => { dayOf = dayOf === session.id ? null : session.id; shown = ""; sessions(snapshot); }),
    button(word("new_visit"), "visit", key, !snapshot.control, () => link.send({ type: "new-visit", subject: session.subject })));
  const who = session.participant_id === null ? session.subject : `${session.subject} (${session.participant_id})`;
  const made = row(who, String(session.visit), named("group", session.group), session.stage === null ? "–" : named("stage", session.stage),
    percent(session.progress), minutes(over ? null : session.left_s), String(session.trials), percent(session.share_correct),
    word(session.here ? "open" : "closed"), open, buttons);
  made.className = session.id === snapshot.active ? "active" : "";
  const heads = el("sessions").parentElement.tHead.rows[0].cells; // on a phone each cell has its own
  for (const cell of made.cells) cell.dataset.head = heads[cell.cellIndex].textContent;
  const saved = (form, message) => submit(form, message, () => { dayOf = null; shown = ""; });
  return dayOf === session.id ? [made, under(dayForm(session, saved), correctionForm(session, snapshot.demographics, saved), voidForm(session, saved))] : [made];
}

const runRow = (run) => row(run.title, named("state", run.state),
  run.of === null ? String(run.answered) : word("of", { done: run.answered, count: run.of }), percent(run.share_correct));

// Functions that draw each kind of run.
const pictures = {
  track(picture) { drawTrack(el("track"), picture.levels_db_sl, picture.correct); },
  curve(picture) { drawCurve(el("curve"), picture); },
  confusion(picture) { el("confusion").replaceChildren(confusionTable(picture.labels, picture.counts)); },
};

function picture(one) {
  el("run").textContent = one === null ? word("no_run") : one.title;
  for (const kind of Object.keys(pictures)) el(kind).toggleAttribute("hidden", one === null || one.kind !== kind);
  if (one !== null) pictures[one.kind](one);
}

function results(message) {
  const title = make("h2", { tabindex: "-1" }, word("results_of", { subject: message.subject }));
  el("results").replaceChildren(title, ...message.tables.flatMap(resultTable));
  el("results").hidden = false;
  title.focus();
}

function controls(snapshot) {
  const there = snapshot.active !== null;
  const enabled = {
    pause: there && !snapshot.paused, resume: there && snapshot.paused, stop: there, "give-up-run": there && snapshot.paused,
    "clear-fault": snapshot.fault !== null,
  };
  for (const button of document.querySelectorAll("[data-command]")) {
    const name = button.dataset.command;
    button.disabled = name === "take-control" ? snapshot.control : !snapshot.control || !enabled[name];
  }
  el("state").textContent = word(there ? (snapshot.paused ? "paused" : "running") : "nobody");
}

// Renders again only where something changed, so that the focus stays where it was.
function sessions(snapshot) {
  const current = JSON.stringify([snapshot.sessions, snapshot.active, snapshot.control]);
  if (current === shown || (dayOf !== null && el("sessions").querySelector("form") !== null && shown !== "")) return;
  shown = current;
  const { start, results } = document.activeElement ? document.activeElement.dataset : {};
  el("sessions").replaceChildren(...snapshot.sessions.flatMap((session) => sessionRows(session, snapshot)));
  const again = start ? `[data-start="${start}"]` : results ? `[data-results="${results}"]` : null;
  if (again !== null && document.querySelector(again)) document.querySelector(again).focus();
}

function show(snapshot) {
  el("study").textContent = snapshot.study;
  const rig = snapshot.rig;
  el("rig").textContent = word("rig", { name: rig.name, display: rig.display, channels: rig.channels.join(", "), rate: rig.rate_hz });
  el("simulated").hidden = !rig.simulated;
  banner(snapshot.fault !== null ? word("fault", { fault: snapshot.fault })
    : performance.now() < refused.until ? refused.text : snapshot.control ? "" : word("looking_on"));
  el("calls").hidden = snapshot.calls.length === 0;
  el("calls").replaceChildren(...snapshot.calls.map((call) => make("li", {}, word("called", { call }))));
  controls(snapshot);
  sessions(snapshot);
  picture(snapshot.picture);
  el("runs-section").hidden = snapshot.runs.length === 0;
  el("runs").replaceChildren(...snapshot.runs.map(runRow));
  if (JSON.stringify(snapshot.demographics) !== asks) {
    asks = JSON.stringify(snapshot.demographics);
    el("demographics").replaceChildren(...demographicFields(snapshot.demographics));
  }
}
