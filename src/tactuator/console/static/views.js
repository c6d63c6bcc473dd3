// The views by their name in the address, which is that of the module that draws each: its title, and what it needs.
export const VIEWS = {
  start: { title: "Start" },
  display: { title: "Display" },
  identify: { title: "Identify" },
  loop: { title: "Loop", ofDisplay: true },
  prefilter: { title: "Prefilter", ofDisplay: true },
  speech: { title: "Speech", ofDisplay: true },
  experiment: { title: "Experiment", ofRig: true },
  response: { title: "Response", ofRig: true },
  scope: { title: "Scope", ofRig: true },
};
