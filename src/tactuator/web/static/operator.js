"use strict";
// The operator's page. The token stands in the address after the # and never leaves the page but to its own server.
let shown = "";

const link = new Link(
  "/ws/operator",
  (message) => {
    if (message.type === "snapshot") show(message);
    else if (message.type === "results") results(message);
    else banner(message.message);
  },
  (socket) => { socket.send(location.hash.slice(1)); banner(""); },
  (code) => {
    const refused = code === 4003;
    banner(refused ? "The operator's token is missing or wrong: open the address that the server printed." : "The connection is lost. Trying again…");
    return !refused;
  },
);

const command = (type, session) => link.send(session === undefined ? { type } : { type, session });
const percent = (share) => (share === null ? "–" : `${Math.round(100 * share)} %`);
const row = (...cells) => make("tr", {}, ...cells.map((cell) => make("td", {}, cell)));

function button(text, name, subject, disabled, pressed) {
  const made = make("button", { type: "button", [`data-${name}`]: subject }, text);
  made.disabled = disabled;
  made.onclick = pressed;
  return made;
}

function sessionRow(session, snapshot) {
  const open = make("a", { href: session.link, target: "_blank", rel: "noopener" }, "open");
  const cannot = !snapshot.control || snapshot.active !== null || session.stage === "done";
  const buttons = make("div", { class: "buttons" },
    button("Start", "start", session.subject, cannot, () => command("start", session.id)),
    button("Results", "results", session.subject, session.trials === 0, () => command("results", session.id)));
  const made = row(session.subject, session.group, session.stage ?? "–", percent(session.progress), String(session.trials),
    percent(session.share_correct), session.here ? "open" : "closed", open, buttons);
  made.className = session.id === snapshot.active ? "active" : "";
  return made;
}

const runRow = (run) => row(run.title, run.state, run.of === null ? String(run.answered) : `${run.answered} of ${run.of}`, percent(run.share_correct));

// How each kind of run is drawn.
const pictures = {
  track(picture) { drawTrack(el("track"), picture.levels_db_sl, picture.correct); },
  confusion(picture) { el("confusion").replaceChildren(confusionTable(picture.labels, picture.counts)); },
};

function picture(one) {
  el("run").textContent = one === null ? "No run goes on" : one.title;
  for (const kind of Object.keys(pictures)) el(kind).toggleAttribute("hidden", one === null || one.kind !== kind);
  if (one !== null) pictures[one.kind](one);
}

function results(message) {
  const title = make("h2", { tabindex: "-1" }, `Results of ${message.subject}, test runs so far`);
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
  el("state").textContent = there ? (snapshot.paused ? "paused" : "running") : "nobody at the rig";
}

// Made anew only where something changed; the focus stays where it was.
function sessions(snapshot) {
  const stands = JSON.stringify([snapshot.sessions, snapshot.active, snapshot.control]);
  if (stands === shown) return;
  shown = stands;
  const { start, results } = document.activeElement ? document.activeElement.dataset : {};
  el("sessions").replaceChildren(...snapshot.sessions.map((session) => sessionRow(session, snapshot)));
  const again = start ? `[data-start="${start}"]` : results ? `[data-results="${results}"]` : null;
  if (again !== null && document.querySelector(again)) document.querySelector(again).focus();
}

function show(snapshot) {
  el("study").textContent = snapshot.study;
  const rig = snapshot.rig;
  el("rig").textContent = `${rig.name}: ${rig.display}, ${rig.channels.join(", ")}, ${rig.rate_hz} Hz`;
  banner(snapshot.fault === null ? (snapshot.control ? "" : "Another operator has control: you look on.") : `Fault: ${snapshot.fault}`);
  controls(snapshot);
  sessions(snapshot);
  picture(snapshot.picture);
  el("runs-section").hidden = snapshot.runs.length === 0;
  el("runs").replaceChildren(...snapshot.runs.map(runRow));
}

for (const button of document.querySelectorAll("[data-command]")) button.onclick = () => command(button.dataset.command);
