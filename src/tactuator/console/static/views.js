// The views: their name in the address, their title, and the module that draws each, loaded when it is opened.
export const VIEWS = {
  start: { title: "Start", load: async () => (await import("./start.js")).Start },
  display: { title: "Display", load: async () => (await import("./display.js")).Display },
  identify: { title: "Identify", load: async () => (await import("./identify.js")).Identify },
  loop: { title: "Loop", ofDisplay: true, load: async () => (await import("./loop.js")).Loop },
  prefilter: { title: "Prefilter", ofDisplay: true, load: async () => (await import("./prefilter.js")).Prefilter },
  speech: { title: "Speech", ofDisplay: true, load: async () => (await import("./speech.js")).Speech },
  experiment: { title: "Experiment", load: async () => (await import("./experiment.js")).Experiment },
  response: { title: "Response", load: async () => (await import("./response.js")).Response },
  scope: { title: "Scope", load: async () => (await import("./scope.js")).Scope },
};
