"use strict";
// The operator's page. The token stands in the address after the # and never leaves the page but to its own server.
const el = (id) => document.getElementById(id);
let socket = null, shown = "";

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  socket = new WebSocket(`${scheme}://${location.host}/ws/operator`);
  socket.onopen = () => { socket.send(location.hash.slice(1)); banner(""); };
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    if (message.type === "snapshot") show(message);
    else banner(message.message);
  };
  socket.onclose = (event) => {
    if (event.code === 4003) { banner("The operator's token is missing or wrong: open the address that the server printed."); return; }
    banner("The connection is lost. Trying again…");
    setTimeout(connect, 500);
  };
}

const banner = (text) => { el("banner").hidden = text === ""; el("banner").textContent = text; };
const command = (type, session) => socket.send(JSON.stringify(session === undefined ? { type } : { type, session }));

function cell(content) {
  const td = document.createElement("td");
  td.append(content);
  return td;
}

function row(session, snapshot) {
  const tr = document.createElement("tr");
  tr.className = session.id === snapshot.active ? "active" : "";
  const link = document.createElement("a");
  link.href = session.link;
  link.textContent = "open";
  link.target = "_blank";
  link.rel = "noopener";
  const start = document.createElement("button");
  start.textContent = "Start";
  start.dataset.start = session.subject;
  start.disabled = !snapshot.control || snapshot.active !== null || session.stage === "done";
  start.onclick = () => command("start", session.id);
  tr.append(
    cell(session.subject), cell(session.group), cell(session.stage ?? "–"), cell(`${Math.round(100 * session.progress)} %`),
    cell(String(session.trials)), cell(session.here ? "open" : "closed"), cell(link), cell(start),
  );
  return tr;
}

function show(snapshot) {
  el("study").textContent = snapshot.study;
  const rig = snapshot.rig;
  el("rig").textContent = `${rig.name}: ${rig.display}, ${rig.channels.join(", ")}, ${rig.rate_hz} Hz`;
  banner(snapshot.fault === null ? (snapshot.control ? "" : "Another operator has control: you look on.") : `Fault: ${snapshot.fault}`);
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
  const stands = JSON.stringify([snapshot.sessions, snapshot.active, snapshot.control]);
  if (stands !== shown) {
    shown = stands;
    const focus = document.activeElement && document.activeElement.dataset.start;
    el("sessions").replaceChildren(...snapshot.sessions.map((session) => row(session, snapshot)));
    const again = focus && document.querySelector(`[data-start="${focus}"]`);
    if (again) again.focus();
  }
  const track = snapshot.track;
  if (track === null) { el("run").textContent = "No run goes on"; return; }
  const what = track.frequency_hz === null ? "whole curve" : `${track.frequency_hz} Hz`;
  const turned = track.reversals === null ? "" : `, ${track.reversals} reversals`;
  el("run").textContent = `${track.practice ? "Practice" : "Run"}: ${track.finger}, ${what}, ${track.levels_db_sl.length} trials${turned}`;
  drawTrack(el("track"), track.levels_db_sl, track.correct);
}

for (const button of document.querySelectorAll("[data-command]")) button.onclick = () => command(button.dataset.command);
connect();
