// The views by their name in the address, which is that of the module that draws each: its title, and whether it is of a display.
export const VIEWS = {
  start: { title: "Start" },
  display: { title: "Display" },
  identify: { title: "Identify" },
  loop: { title: "Loop", ofDisplay: true },
  prefilter: { title: "Prefilter", ofDisplay: true },
  speech: { title: "Speech", ofDisplay: true },
  experiment: { title: "Experiment" },
  response: { title: "Response" },
  scope: { title: "Scope" },
};
