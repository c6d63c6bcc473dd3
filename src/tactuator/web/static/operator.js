"use strict";
// The operator's page. The token is in the address after the #, and is sent to the page's own server only.
let shown = "", asks = "", dayOf = null;
const refusal = { text: "", until: 0 }; // stays for a while, though snapshots come every second

const link = new Link(
  "/ws/operator",
  (message) => {
    if (message.type === "snapshot") show(message);
    else if (message.type === "results") results(message);
    else {
      Object.assign(refusal, { text: message.message, until: performance.now() + 10000 });
      banner(refusal.text);
    }
  },
  (socket) => { socket.send(location.hash.slice(1)); banner(""); },
  (code) => {
    const refused = code === 4003;
    banner(word(refused ? "token" : "lost"));
    return !refused;
  },
);

function command(type, session) {
  refusal.until = 0;
  link.send(session === undefined ? { type } : { type, session });
}
const percent = (share) => (share === null ? "–" : `${Math.round(100 * share)} %`);
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
    button(word("day"), "day", key, !snapshot.control, () => { dayOf = dayOf === session.id ? null : session.id; shown = ""; sessions(snapshot); }),
    button(word("new_visit"), "visit", key, !snapshot.control, () => link.send({ type: "new-visit", subject: session.subject })));
  const who = session.participant_id === null ? session.subject : `${session.subject} (${session.participant_id})`;
  const made = row(who, String(session.visit), named("group", session.group), session.stage === null ? "–" : named("stage", session.stage),
    percent(session.progress), minutes(over ? null : session.left_s), String(session.trials), percent(session.share_correct),
    word(session.here ? "open" : "closed"), open, buttons);
  made.className = session.id === snapshot.active ? "active" : "";
  const saved = (message) => { link.send(message); dayOf = null; };
  return dayOf === session.id ? [made, dayForm(session, saved)] : [made];
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
  const stands = JSON.stringify([snapshot.sessions, snapshot.active, snapshot.control]);
  if (stands === shown || (dayOf !== null && el("sessions").querySelector("form") !== null && shown !== "")) return;
  shown = stands;
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
    : performance.now() < refusal.until ? refusal.text : snapshot.control ? "" : word("looking_on"));
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

for (const button of document.querySelectorAll("[data-command]")) button.onclick = () => command(button.dataset.command);
el("enrol-form").onsubmit = (event) => {
  event.preventDefault();
  link.send(enrolment(event.target));
  event.target.reset();
};
