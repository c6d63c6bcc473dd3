// The views: their name in the address, their title, and the module that draws each, loaded when it is opened.
export const VIEWS = {
  start: { title: "Start", load: async () => (await import("./start.js")).Start },
  loop: { title: "Loop", ofDisplay: true, load: async () => (await import("./loop.js")).Loop },
};
