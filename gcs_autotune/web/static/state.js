// What is known, kept in step with the server: WebSocket, or server-sent events where that does not come about.
const ROWS = 4000, WORDS = 300, RETRY = 1500;
const LISTS = { rows: ROWS, words: WORDS, legs: Infinity };

// In the notation of the reports, a number and its unit on one line.
export const signed = (text) => text.replace(/(?<=\d)%/g, " %").replace(/(?<=\d) deg(?!\w)/g, "°").replace(/(?<=\d) s\^2/g, " s²")
  .replace(/(?<=\d) (?=%|(?:min|ms|m|s|Hz|V)[²³]?(?:\/s[²³]?)?(?!\w))|(?<=\d min) (?=\d+ s(?!\w))/g, "\u00a0")
  .replace(/(?<=[\d%°²]) (?=-> -?\d)/g, "\u00a0").replaceAll("-> ", "\u2192\u00a0");

export const empty = () => ({ run: null, legs: [], rows: [], words: [] });

export const link = { connected: false, since: performance.now(), heard: performance.now(), flown: 0 };

export function apply(state, delta) {
  if (delta.whole) state = Object.assign(empty(), delta.whole);
  else if (delta.fresh) state = empty();
  for (const [key, value] of Object.entries(delta)) {
    if (key === "whole" || key === "fresh") continue;
    if (key.startsWith("+")) {
      const list = state[key.slice(1)];
      list.push(...value);
      const most = LISTS[key.slice(1)];
      if (list.length > most) list.splice(0, list.length - most);
    } else state[key] = value;
  }
  if (delta.whole || delta.vitals || delta["+rows"] || delta.fresh) link.heard = performance.now();
  if (delta.now) link.flown = performance.now();
  return state;
}

// --- the connection -------------------------------------------------------------------------------------------------

export function connect(take) {
  let failures = 0;
  const told = (text) => {
    if (!link.connected) { link.connected = true; failures = 0; }
    link.since = performance.now();
    take(JSON.parse(text));
  };
  const lost = () => {
    if (link.connected) { link.connected = false; link.since = performance.now(); }
    failures += 1;
    setTimeout(open, RETRY);
  };
  const open = async () => {
    const seat = await seated();
    return failures % 2 === 0 && "WebSocket" in window ? bySocket(told, lost, seat) : byEvents(told, lost, seat);
  };
  open();
}

function bySocket(told, lost, seat) {
  const address = new URL(`live${seat}`, location.href);
  address.protocol = address.protocol.replace("http", "ws");
  address.hash = "";
  let socket;
  try { socket = new WebSocket(address.href); } catch { return lost(); }
  let watch = setTimeout(() => socket.close(), 5000);
  socket.onmessage = (event) => {
    clearTimeout(watch);
    watch = setTimeout(() => socket.close(), 5000);  // the server says something every second
    told(event.data);
  };
  socket.onclose = () => { clearTimeout(watch); lost(); };
}

function byEvents(told, lost, seat) {
  const source = new EventSource(`events${seat}`);
  let watch = setTimeout(end, 5000);
  function end() { clearTimeout(watch); source.close(); lost(); }
  source.onmessage = (event) => { clearTimeout(watch); watch = setTimeout(end, 5000); told(event.data); };
  source.onerror = end;
}

// Who has the token gets a key to a seat that no other viewer can take. The token itself never stands in an address.
async function seated() {
  if (token() === "none") return "";
  const told = await post("token");
  return told.ok && told.seat ? `?seat=${encodeURIComponent(told.seat)}` : "";
}

// --- touching -------------------------------------------------------------------------------------------------------

const KEY = "gcs-autotune-token";
if (location.hash.length > 8) {
  try { localStorage.setItem(KEY, location.hash.slice(1)); } catch { /* private mode: this page only */ }
  link.token = location.hash.slice(1);
  history.replaceState(null, "", location.pathname + location.search);
}
export function token() {
  try { return link.token || localStorage.getItem(KEY) || "none"; } catch { return link.token || "none"; }
}

// Returns {ok, status, ...the answer}; status 0 when the server cannot be reached.
export async function post(where, what = {}) {
  try {
    const answer = await fetch(where, {
      method: "POST", keepalive: true, body: JSON.stringify(what),
      headers: { "Content-Type": "application/json", "X-Autotune-Token": token() },
      signal: AbortSignal.timeout ? AbortSignal.timeout(3000) : undefined,
    });
    return { ok: answer.ok, status: answer.status, ...(await answer.json().catch(() => ({}))) };
  } catch {
    return { ok: false, status: 0, error: "the server cannot be reached" };
  }
}
