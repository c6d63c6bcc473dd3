// Terms that not every reader knows: a button that shows the words of the glossary in short.
import { el, make } from "./dom.js";

export const TERMS = {
  "phase margin": "How much more lag, in degrees, the loop bears where its gain is one before it is unstable.",
  "gain margin": "By how much the loop's gain may rise before it is unstable.",
  "crossover": "The frequency at which the loop's gain is one; above it feedback does little.",
  "sensitivity": "S = 1/(1 + L): what is left of a disturbance. Its peak, max|S|, says how near the loop is to instability.",
  "sensation level": "Level above the detection threshold at the same frequency, in dB SL: 0 dB SL is just felt.",
  "hum": "What the mains add to the sensor's voltage; the loop turns it into motion of the display.",
  "identification": "The estimation of a model of the plant from a record.",
  "residual": "What a model leaves unexplained of the recorded position; of a good model it is noise alone.",
  "candidate": "A form that was tried. Behind: how far its criterion (Bayes) is behind the best.",
  "dead time": "The time between a command and the first change of position that follows from it.",
  "hold": "What the command does between its samples: a converter holds it (zero-order hold), or it is band-limited.",
  "load": "What touches the display, a resting finger for example; it changes the plant.",
  "plant": "The actuator as the loop sees it: from command to sensor voltage.",
  "threshold curve": "The level at which a sinusoid is just felt, against frequency: what the display is to follow.",
  "provenance": "Where the curve comes from: measured, digitised, inferred, synthetic, simulated or not stated.",
  "prefilter": "The filter ahead of the loop; with it, equal amplitude of the reference is felt equally far above threshold.",
  "experiment protocol": "The file (TOML) that says what an experiment plays, to whom, in what order, and how levels are chosen.",
  "experiment store": "The database (SQLite) with every trial and answer of a study; an answer is acknowledged once it is in there.",
  "staircase": "A rule that lowers the level after right answers and raises it after wrong ones, so that it hovers at the threshold.",
  "verdict": "The outcome of each objective: met, not met, or not judged, with what it rests on.",
};

export function term(name, shown = name) {
  const show = () => {
    const place = button.getBoundingClientRect(), tip = el("tip");
    tip.textContent = `${TERMS[name]} (glossary: ${name})`;
    tip.hidden = false;
    tip.style.left = `${Math.max(8, Math.min(place.left, innerWidth - 330)) + scrollX}px`;
    tip.style.top = `${place.bottom + 6 + scrollY}px`;
  };
  const hide = () => { el("tip").hidden = true; };
  const button = make("button", { type: "button", class: "term", "aria-describedby": "tip", onclick: show, onfocus: show,
    onblur: hide, onmouseenter: show, onmouseleave: hide }, shown);
  button.onkeydown = (event) => { if (event.key === "Escape") hide(); };
  return button;
}
