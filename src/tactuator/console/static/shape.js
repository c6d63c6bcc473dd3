// What a person may change of a controller: the factors, and their parameters, whose ranges the server sends.
export const KINDS = {
  integrator: { title: "integrator", add: {}, sides: [0, 1] },
  zero: { title: "zero", add: { hz: 30 }, sides: [1, 0] },
  pole: { title: "pole", add: { hz: 300 }, sides: [0, 1] },
  zeros: { title: "pair of zeros", add: { hz: 30, damping: 0.8 }, sides: [2, 0] },
  poles: { title: "pair of poles", add: { hz: 300, damping: 1 }, sides: [0, 2] },
  lead: { title: "lead or lag", add: { hz: 40, ratio: 3 }, sides: [1, 1] },
  notch: { title: "notch", add: { hz: 60, damping: 0.5, depth_db: 12 }, sides: [2, 2] },
};

export const PARAMETERS = {
  hz: { title: "frequency", unit: "Hz", log: true },
  damping: { title: "damping", unit: "", log: true },
  ratio: { title: "pole over zero", unit: "", log: true },
  depth_db: { title: "depth", unit: "dB", log: false },
};

export const titleOf = (factor) => KINDS[factor.kind]?.title ?? factor.kind;
export const namesOf = (factor) => Object.keys(factor).filter((name) => name in PARAMETERS);
export const second = (factor) => ["damping", "ratio", "depth_db"].filter((name) => name in factor).at(-1);
export const copied = (shape) => structuredClone(shape);

const ranges = {};
export const setRanges = (received) => Object.assign(ranges, received);
export const highest = (name) => ranges[name][1];

export function limited(name, value) {
  const [low, high] = ranges[name];
  return Math.min(high, Math.max(low, value));
}

// The value after so many steps: of 2 % each, or half a unit where the parameter is not logarithmic.
export function stepped(name, value, steps) {
  return limited(name, PARAMETERS[name].log ? value * 1.02 ** steps : value + 0.5 * steps);
}

export function excessZeros(shape) {
  let excess = 0;
  for (const { kind, im } of shape.factors) {
    const [zeros, poles] = KINDS[kind]?.sides ?? (kind === "zero in z" ? [im ? 2 : 1, 0] : [0, im ? 2 : 1]);
    excess += zeros - poles;
  }
  return excess;
}
