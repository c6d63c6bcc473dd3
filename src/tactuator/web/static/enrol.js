"use strict";
// Forms of the operator's page: a new subject with what the laboratory notes of everybody, the data of a session's day, and
// corrections of what was noted. values: the present values, by the item's name.
// A browser's own field for numbers drops a comma that its language does not know, and 0,5 becomes 5: the server reads numbers.
// A browser's own checks speak its language, not the page's: the server says what is allowed.
const DAY = { class: "day", novalidate: "" };
const DECIMAL = { type: "text", inputmode: "decimal", maxlength: 30 };
function demographicFields(items, values = {}) {
  return items.map(({ name, label, kind, unit, choices, required }) => {
    const data = { "data-demographic": name, ...(required ? { required: "" } : {}) };
    const field = kind === "choice" ? make("select", data, ...["", ...choices].map((one) => make("option", { value: one }, one)))
      : make("input", kind === "number" ? { ...data, ...DECIMAL } : { ...data, maxlength: 200 });
    field.value = values[name] || "";
    return make("label", {}, unit === "" ? label : `${label}, ${unit}`, " ", field);
  });
}

function enrolment(form) {
  const given = [...form.querySelectorAll("[data-demographic]")].filter((field) => field.value !== "");
  const message = { type: "enrol", code: form.elements.code.value, group: form.elements.group.value,
    demographics: Object.fromEntries(given.map((field) => [field.dataset.demographic, field.value])) };
  const participant = form.elements.participant_id.value;
  return participant === "" ? message : { ...message, participant_id: participant };
}

// Shows the data of the day of a session in a row below it; saved: called with the form and the message. An emptied
// field says that its value is taken away.
function dayForm(session, saved) {
  const number = (name, value) => make("input", { name, ...DECIMAL, ...(value === null ? {} : { value, placeholder: `${value} → –` }) });
  const temperature = number("skin_temperature_c", session.skin_temperature_c), force = number("preload_n", session.preload_n);
  const form = make("form", DAY, make("b", {}, word("day")), make("label", {}, word("skin_temperature"), " ", temperature),
    make("label", {}, word("contact_force"), " ", force), make("button", { type: "submit" }, word("save")));
  const value = (field) => (field.value === "" ? null : field.value);
  form.onsubmit = (event) => {
    event.preventDefault();
    saved(form, { type: "day", session: session.id, skin_temperature_c: value(temperature), preload_n: value(force) });
  };
  return form;
}

// Shows what is noted of a session's subject; only what is changed is sent, with the reason.
function correctionForm(session, items, saved) {
  const group = make("input", { name: "group", required: "", maxlength: 64, list: "groups" }), participant = make("input", { name: "participant_id" });
  group.value = session.group;
  participant.value = session.participant_id || "";
  participant.required = session.participant_id !== null; // an id that is there may be another, not none
  const reason = make("input", { name: "reason", required: "", maxlength: 200, "data-reason": "" }), fields = demographicFields(items, session.demographics);
  const form = make("form", DAY, make("b", {}, word("correct_data", { subject: session.subject })),
    make("label", {}, word("group"), " ", group), make("label", {}, word("participant_id"), " ", participant), ...fields,
    make("label", {}, word("reason"), " ", reason), make("button", { type: "submit" }, word("save")));
  form.onsubmit = (event) => {
    event.preventDefault();
    const facts = [...form.querySelectorAll("[data-demographic]")].map((field) => [field.dataset.demographic, field.value]);
    saved(form, { type: "correct", subject: session.subject, reason: reason.value, ...(group.value === session.group ? {} : { group: group.value }),
      ...(participant.value === (session.participant_id || "") ? {} : { participant_id: participant.value }),
      demographics: Object.fromEntries(facts.filter(([name, value]) => value !== (session.demographics[name] || ""))) });
  };
  return form;
}

// Leaves a visit, a run or a trial out of all results, or takes it in again; both are asked once more.
function voidForm(session, saved) {
  const title = (part) => (part.void === null ? part.title : `${part.title} (${word("is_void", { reason: part.void })})`);
  const part = make("select", {}, ...session.parts.map((each, index) => make("option", { value: index }, title(each))));
  const trial = make("input", { name: "trial", inputmode: "numeric", maxlength: 9 }), reason = make("input", { name: "reason", required: "", maxlength: 200 });
  const form = make("form", { ...DAY, "data-void": session.subject }, make("b", {}, word("void_title")), make("label", {}, word("void_part"), " ", part),
    make("label", {}, word("void_trial"), " ", trial), make("label", {}, word("reason"), " ", reason),
    make("button", { type: "submit", value: "void" }, word("void")), make("button", { type: "submit", value: "restore" }, word("restore")));
  form.onsubmit = (event) => {
    event.preventDefault();
    const leaves = event.submitter.value === "void", chosen = session.parts[part.value], number = trial.value.trim() === "" ? chosen.trial : trial.value.trim();
    const what = { subject: session.subject, part: number === null || number === chosen.trial ? chosen.title : `${chosen.title}, ${word("trial")} ${number}` };
    if (reason.value.trim() === "" || confirm(word(leaves ? "void_sure" : "restore_sure", what))) saved(form, { type: "void", session: session.id, run: chosen.run, trial: number, void: leaves, reason: reason.value });
  };
  return form;
}

const under = (...forms) => make("tr", { class: "under" }, make("td", { colspan: 11 }, ...forms));
