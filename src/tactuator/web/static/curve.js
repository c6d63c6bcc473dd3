"use strict";
// Draws a whole-curve run: the curve with its 95 % band in dB SL against frequency; trials as circles, open right, filled wrong.
function drawCurve(svg, picture) {
  const draw = (name, attributes, text) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    if (text !== undefined) node.textContent = text;
    return node;
  };
  const nodes = [], frequency = picture.frequency_hz;
  const levels = [...picture.low_db_sl, ...picture.high_db_sl, ...picture.trials.map((trial) => trial[1])];
  const bottom = Math.floor(Math.min(...levels, -10) / 10) * 10, top = Math.ceil(Math.max(...levels, 20) / 10) * 10;
  const first = Math.log(frequency[0]), last = Math.log(frequency[frequency.length - 1]);
  const x = (hertz) => 50 + 730 * (Math.log(hertz) - first) / (last - first);
  const y = (level) => 265 - 245 * (level - bottom) / (top - bottom);
  for (let level = bottom; level <= top; level += 10) {
    nodes.push(draw("line", { class: "grid", x1: 50, x2: 790, y1: y(level), y2: y(level) }));
    nodes.push(draw("text", { x: 42, y: y(level) + 4, "text-anchor": "end" }, String(level)));
  }
  for (const hertz of [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500]) {
    if (Math.log(hertz) < first || Math.log(hertz) > last) continue;
    nodes.push(draw("line", { class: "grid", x1: x(hertz), x2: x(hertz), y1: 20, y2: 265 }));
    nodes.push(draw("text", { x: x(hertz), y: 279, "text-anchor": "middle" }, String(hertz)));
  }
  const there = frequency.map((hertz, i) => `${x(hertz)},${y(picture.high_db_sl[i])}`);
  const back = frequency.map((hertz, i) => `${x(hertz)},${y(picture.low_db_sl[i])}`).reverse();
  nodes.push(draw("polygon", { class: "band", points: [...there, ...back].join(" ") }));
  nodes.push(draw("polyline", { class: "line", points: frequency.map((hertz, i) => `${x(hertz)},${y(picture.level_db_sl[i])}`).join(" ") }));
  for (const [hertz, level, right] of picture.trials) {
    nodes.push(draw("circle", { class: right ? "right" : "wrong", cx: x(hertz), cy: y(level), r: 3 }));
  }
  const warning = picture.chance ? word("curve_guessed") : "";
  nodes.push(draw("text", { x: 420, y: 296, "text-anchor": "middle" }, word("curve_axis") + warning));
  svg.replaceChildren(...nodes);
}
