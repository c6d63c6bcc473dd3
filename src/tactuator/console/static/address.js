// The state of the page is in its address, after the #; the token is taken out of it and kept for this tab.
const TOKEN = "token", SHARED = ["view", "display", "channel", "shapes"];

export const keepToken = (token) => sessionStorage.setItem(TOKEN, token);

export function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1));
  const token = given.get(TOKEN);
  if (token !== null) {
    keepToken(token);
    given.delete(TOKEN);
    history.replaceState(null, "", `#${given}`);
  }
  return token ?? sessionStorage.getItem(TOKEN) ?? "";
}

export function read() {
  const given = new URLSearchParams(location.hash.slice(1));
  let shapes = {};
  try { shapes = JSON.parse(given.get("shapes") ?? "{}"); } catch { /* an address that was cut short says nothing */ }
  const own = Object.fromEntries([...given].filter(([key]) => !SHARED.includes(key)));
  return { view: given.get("view") ?? "start", display: given.get("display"), channel: given.get("channel"), shapes, own };
}

// own: what the view itself keeps, texts by name.
export function address({ view, display, channel, shapes, own }) {
  const given = new URLSearchParams({ view });
  if (display) given.set("display", display);
  if (channel) given.set("channel", channel);
  if (shapes && Object.keys(shapes).length) given.set("shapes", JSON.stringify(shapes));
  for (const [key, value] of Object.entries(own ?? {})) if (value !== "") given.set(key, value);
  return `#${given}`;
}

export const write = (state) => history.replaceState(null, "", address(state));
