"use strict";
// Draws a run: level against trial, open circles right, filled ones wrong.
function drawTrack(svg, levels, correct) {
  const draw = (name, attributes, text) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    if (text !== undefined) node.textContent = text;
    return node;
  };
  const nodes = [];
  const low = Math.min(...levels, 0), high = Math.max(...levels, 10);
  const step = high - low > 40 ? 10 : 5;
  const bottom = Math.floor(low / step) * step, top = Math.ceil(high / step) * step;
  const x = (trial) => 50 + 730 * (trial + 0.5) / Math.max(levels.length, 40);
  const y = (level) => 265 - 245 * (level - bottom) / (top - bottom);
  for (let level = bottom; level <= top; level += step) {
    nodes.push(draw("line", { class: "grid", x1: 50, x2: 790, y1: y(level), y2: y(level) }));
    nodes.push(draw("text", { x: 42, y: y(level) + 4, "text-anchor": "end" }, String(level)));
  }
  nodes.push(draw("text", { x: 420, y: 292, "text-anchor": "middle" }, word("track_axis")));
  nodes.push(draw("polyline", { class: "line", points: levels.map((level, i) => `${x(i)},${y(level)}`).join(" ") }));
  levels.forEach((level, i) => {
    nodes.push(draw("circle", { class: correct[i] ? "right" : "wrong", cx: x(i), cy: y(level), r: 4 }));
  });
  svg.replaceChildren(...nodes);
}
