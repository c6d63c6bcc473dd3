"use strict";
// Pictures of a run in dB SL: a track against the trial, a whole curve against frequency; open circles right, filled ones wrong.
const LEFT = 50, RIGHT = 790, TOP = 20, BOTTOM = 265;

function svgNode(name, attributes, text = "") {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.textContent = text;
  return node;
}

// The grid of a picture that holds those levels, a line every so many dB; `add` draws on it, at places that x and y give.
function levelGrid(levels, step, x, axis) {
  const nodes = [], add = (...more) => { nodes.push(svgNode(...more)); };
  const low = Math.floor(Math.min(...levels) / step) * step, high = Math.ceil(Math.max(...levels) / step) * step;
  const y = (level) => BOTTOM - (BOTTOM - TOP) * (level - low) / (high - low);
  const points = (places, values) => values.map((level, i) => `${x(places[i])},${y(level)}`);
  for (let level = low; level <= high; level += step) {
    add("line", { class: "grid", x1: LEFT, x2: RIGHT, y1: y(level), y2: y(level) });
    add("text", { x: LEFT - 8, y: y(level) + 4, "text-anchor": "end" }, String(level));
  }
  add("text", { x: (LEFT + RIGHT) / 2, y: BOTTOM + 31, "text-anchor": "middle" }, axis);
  return { nodes, add, points,
    line(places, values) { add("polyline", { class: "line", points: points(places, values).join(" ") }); },
    trial(place, level, right, r) { add("circle", { class: right ? "right" : "wrong", cx: x(place), cy: y(level), r }); } };
}

function drawTrack(svg, levels, correct) {
  const all = [...levels, 0, 10], trials = levels.map((_, i) => i), wide = (RIGHT - LEFT) / Math.max(levels.length, 40);
  const picture = levelGrid(all, Math.max(...all) - Math.min(...all) > 40 ? 10 : 5, (trial) => LEFT + wide * (trial + 0.5), word("track_axis"));
  picture.line(trials, levels);
  trials.forEach((trial) => picture.trial(trial, levels[trial], correct[trial], 4));
  svg.replaceChildren(...picture.nodes);
}

// A whole curve with its 95 % band.
function drawCurve(svg, { frequency_hz: hertz, level_db_sl: level, low_db_sl: low, high_db_sl: high, trials, chance }) {
  const first = Math.log(hertz[0]), last = Math.log(hertz[hertz.length - 1]), x = (hz) => LEFT + (RIGHT - LEFT - 10) * (Math.log(hz) - first) / (last - first);
  const picture = levelGrid([...low, ...high, ...trials.map(([, db]) => db), -10, 20], 10, x, word("curve_axis") + (chance ? word("curve_guessed") : ""));
  for (const hz of [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500].filter((one) => Math.log(one) >= first && Math.log(one) <= last)) {
    picture.add("line", { class: "grid", x1: x(hz), x2: x(hz), y1: TOP, y2: BOTTOM });
    picture.add("text", { x: x(hz), y: BOTTOM + 14, "text-anchor": "middle" }, String(hz));
  }
  picture.add("polygon", { class: "band", points: [...picture.points(hertz, high), ...picture.points(hertz, low).reverse()].join(" ") });
  picture.line(hertz, level);
  for (const [hz, db, right] of trials) picture.trial(hz, db, right, 3);
  svg.replaceChildren(...picture.nodes);
}
