"use strict";
// Forms of the operator's page: a new subject with what the laboratory notes of everybody, and the data of a session's day.
function demographicFields(items) {
  return items.map(({ name, label, kind, unit, low, high, choices, required }) => {
    const data = { "data-demographic": name, ...(required ? { required: "" } : {}) };
    const field = kind === "choice" ? make("select", data, ...["", ...choices].map((one) => make("option", { value: one }, one)))
      : make("input", kind === "number" ? { ...data, type: "number", step: "any", ...(low === null ? {} : { min: low }), ...(high === null ? {} : { max: high }) } : { ...data, maxlength: 200 });
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

// Shows the data of the day of a session in a row below it; saved: called with the message.
function dayForm(session, saved) {
  const number = (name, value) => make("input", { name, type: "number", step: "any", min: 0, ...(value === null ? {} : { value }) });
  const temperature = number("skin_temperature_c", session.skin_temperature_c), force = number("preload_n", session.preload_n);
  const form = make("form", { class: "day" }, make("label", {}, word("skin_temperature"), " ", temperature),
    make("label", {}, word("contact_force"), " ", force), make("button", { type: "submit" }, word("save")));
  const value = (field) => (field.value === "" ? null : Number(field.value));
  form.onsubmit = (event) => {
    event.preventDefault();
    saved({ type: "day", session: session.id, skin_temperature_c: value(temperature), preload_n: value(force) });
  };
  return make("tr", { class: "under" }, make("td", { colspan: 11 }, form));
}
