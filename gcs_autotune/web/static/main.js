// The page: what is known is shown, as text and never as HTML; STOP; questions.
import { about, draw, redraw } from "./charts.js";
import { apply, connect, empty, link, post, signed, token } from "./state.js";
import { offer } from "./result.js";
import { fill, make, models, show as showCrafts } from "./start.js";
import * as runs from "./runs.js";
import * as whatIf from "./whatif.js";

const $ = (id) => document.getElementById(id);
let state = empty(), fresh = true, mayTouch = false, isKnown = false, wantStop = 0, refused = "", view = "live";
const write = (id, text) => { if ($(id).textContent !== text) $(id).textContent = text; };
const say = (id, text) => write(id, signed(text));
const running = () => Boolean(state.run && !state.end);

// --- STOP -----------------------------------------------------------------------------------------------------------

async function stop() {
  if (!running() || !mayTouch) return;
  if (!wantStop) wantStop = performance.now();
  const mine = wantStop;
  for (;;) {
    const answer = await post("stop");
    if (answer.ok || wantStop !== mine || !running()) break;
    refused = answer.status ? answer.error : "";
    show();
    if (answer.status >= 400 && answer.status < 500 && answer.status !== 429) break;
    await new Promise((done) => setTimeout(done, 300));
  }
  show();
}
$("stop").onclick = stop;
// Capturing, so that no button takes the space for itself while a run is under way.
for (const kind of ["keydown", "keyup"]) {
  document.addEventListener(kind, (event) => {
    if (event.code !== "Space" || !running() || !mayTouch) return;
    const type = event.target.tagName === "INPUT" ? event.target.type : "";
    if (type === "text") return;
    event.preventDefault();
    event.stopPropagation();
    if (kind === "keydown" && !event.repeat) stop();
  }, true);
}

// --- questions ------------------------------------------------------------------------------------------------------

let asked = null, answering = null;
async function answer(yes) {
  const id = answering = asked;
  if (id === null) return;
  show();
  const told = await post("answer", { id, yes });
  if (!told.ok) {
    refused = `your answer did not reach the server: ${told.error}`;
    answering = null;
    show();
  }
}
$("yes").onclick = () => answer(true);
$("no").onclick = () => answer(false);

function showQuestion() {
  const question = running() ? state.question : null;
  $("question").hidden = !question;
  if (!question) { asked = answering = null; return; }
  $("yes").disabled = $("no").disabled = !mayTouch || answering === question.id;
  say("question-text", question.text);
  $("intentions").hidden = !state.intentions || Boolean(state.now);
  $("offer").hidden = !state.proposal;
  say("question-track", state.track && !state.now ? `Predicted: ${state.track.told}.${state.track.trouble ? ` Do not fly this: ${state.track.trouble}.` : ""}` : "");
  if (asked === question.id) return;
  asked = question.id;
  $("offer").replaceChildren(...(state.proposal ? gains(state.proposal) : []));
  announce();
  $("question").tabIndex = -1;
  $("question").focus();
}

// The announcement is the run's own table; a sentence without a row stands in full below it.
function announce() {
  const { each = [], texts = [] } = state.intentions || {};
  const rows = each.filter((one) => one.row);
  $("intentions-table").hidden = !rows.length;
  $("intentions-table").replaceChildren(...rows.map((one) => line("td", [one.row, one.brief], "th")));
  $("intentions-full").open = !rows.length;
  $("intentions-list").replaceChildren(...items(texts));
}

function line(tag, cells, first = tag) {
  const row = document.createElement("tr");
  cells.forEach((text, k) => {
    const cell = document.createElement(k ? tag : first);
    if (first !== tag && !k) cell.scope = "row";
    cell.textContent = text;
    row.append(cell);
  });
  return row;
}

const STATES = { open: "to do", flying: "in progress", rejected: "not possible", skipped: "left out", aborted: "ended early",
  kept: "new gains kept", restored: "old gains restored" };

function showSteps() {
  const steps = state.steps ? state.steps.steps : [];
  $("steps").hidden = !steps.length || !running();  // how each ended is told with the end
  const of = JSON.stringify(steps);
  if ($("steps").dataset.of === of) return;
  $("steps").dataset.of = of;
  $("steps-list").replaceChildren(...steps.map((step) => {
    const told = step.reason && step.state !== "kept" ? `: ${step.reason}` : "";
    const row = line("td", [step.name, `${STATES[step.state] || step.state}${told}`, step.seconds ? signed(duration(step.seconds)) : ""], "th");
    if (step.state === "flying") row.setAttribute("aria-current", "step");
    return row;
  }));
}

function items(texts) {
  return texts.map((text) => {
    const item = document.createElement("li");
    text.split("`").forEach((part, k) => {  // a command to type stands between backquotes
      const command = document.createElement("code");
      command.textContent = part;
      item.append(k % 2 ? command : signed(part));
    });
    return item;
  });
}

// --- gains ----------------------------------------------------------------------------------------------------------

const short = (number) => (number === null || number === undefined ? "–" : String(Number(number.toPrecision(4))));

function gains(offer) {
  const table = document.createElement("table");
  // "what a gain does: how it was chosen"; a way that several share is said once, below.
  const parts = (v) => { const k = v.reason.indexOf(": "); return k < 0 ? [v.reason, ""] : [v.reason.slice(0, k), v.reason.slice(k + 2)]; };
  const shared = offer.values.map((v) => parts(v)[1]).find((how, k, all) => how && all.indexOf(how) !== k);
  const why = (v) => (parts(v)[1] === shared ? parts(v)[0] : v.reason);
  table.append(line("th", ["Parameter", "Old", "New", shared ? "Purpose" : "Reason"]));
  for (const v of offer.values) table.append(line("td", [v.parameter, short(v.old), short(v.new), why(v)]));
  const told = document.createElement("p");
  if (shared) told.textContent = `${offer.values.every((v) => parts(v)[1] === shared) ? "All are" : "The others are"} ${shared}. `;
  if (offer.cost_after !== null) {
    told.textContent += `Predicted with the identified model: ITAE of the step ${short(offer.cost_before)} → ${costs(offer.cost_after, offer.cost_worst)} s². Lower is better. "At worst" includes the uncertainty of the model.`;
  }
  return [table, told];
}

function costs(nominal, worst) {
  return short(nominal) + (worst === null || worst === undefined ? "" : ` (at worst ${short(worst)})`);
}

// --- the whole ------------------------------------------------------------------------------------------------------

function duration(seconds) {
  if (seconds === null || seconds === undefined) return "";
  const whole = Math.max(0, Math.round(seconds));
  return whole >= 60 ? `${Math.floor(whole / 60)} min ${whole % 60} s` : `${whole} s`;
}

function showBar() {
  const now = state.now;
  let stage = "No run in progress", times = "", done = 0, waits = running() && state.question;
  if (!link.connected && !state.run) stage = "Connecting to the server …";
  else if (running()) {
    stage = now ? `${now.steps ? `Step ${now.step} of ${now.steps}: ` : ""}${now.stage || now.manoeuvre}` : `${state.run.title}: ${waits ? "not started" : "starting"}`;
    if (now && performance.now() - link.flown > 2000) stage += ", flown";  // what comes next is told beside it
    if (now && now.elapsed !== null) times = `${duration(now.elapsed)} flown`;
    if (now && now.left !== null) {
      times += `, about ${duration(now.left)} left`;
      done = 100 * now.elapsed / Math.max(now.elapsed + now.left, 1);
    }
    if (state.run.simulated) times += " (simulated time)";
  } else if (state.end) { stage = `${state.run.title}: over`; times = state.end.meaning; }
  say("stage", stage);
  const mine = state.words.filter((word) => word.severity === null);
  say("latest", waits ? "Waiting for your answer" : running() && mine.length ? mine[mine.length - 1].text : "");
  say("times", times);
  $("progress").hidden = !running();
  $("progress").setAttribute("aria-valuenow", String(Math.round(done)));
  $("progress-done").style.width = `${done}%`;
  const button = $("stop"), stopping = running() && (state.stopping || wantStop);
  button.disabled = !running() || !mayTouch;
  for (const each of document.querySelectorAll(".starts")) each.disabled = !does.may();
  button.classList.toggle("stopping", Boolean(stopping));
  say("stop", stopping ? "STOPPING: restoring the vehicle" : "STOP");
  document.title = `${stopping ? "STOPPING – " : running() ? "▶ " : ""}gcs-autotune`;
}

function showAlarm() {
  const quiet = (performance.now() - link.heard) / 1000, away = (performance.now() - link.since) / 1000;
  const alarms = [];
  if (refused) alarms.push(refused);
  if (running() && wantStop && !state.stopping && performance.now() - wantStop > 700 && !refused) {
    alarms.push("STOP is not confirmed yet. Sending it again. Use your transmitter or the switch on the vehicle.");
  }
  if (!link.connected && away > 2) {
    alarms.push(`No connection to the server for ${duration(away)}.${running() ? " The run does not depend on this page: it continues, or if the server has ended, it stops and restores the vehicle." : ""}`);
  } else if (running() && state.vitals && !state.run.simulated && quiet > 3) {
    alarms.push(`No messages from the vehicle for ${duration(quiet)}.`);
  }
  $("alarm").hidden = !alarms.length;
  if (alarms.length) say("alarm", alarms.join(" "));
}

function showTiles() {
  const now = (running() && state.now) || {}, vitals = state.vitals || {}, kind = about(now.signal);
  const reading = (v) => {
    if (v === null || v === undefined) return "–";
    const shown = v * kind.factor;
    return now.signal === "psi" ? `${(((shown % 360) + 360) % 360).toFixed(1)}°` : `${shown.toFixed(2)} ${kind.unit}`;
  };
  const percent = (v) => (v === null || v === undefined ? "–" : `${Math.round(v * 100)} %`);
  $("charts").hidden = !state.rows.length && !state.track;
  $("tiles").hidden = !running() || !(state.vitals || state.now);  // "now": of an ended run nothing is known but its end
  for (const name of ["signal", "output", "guard"]) $(`tile-${name}`).parentElement.hidden = !state.now;  // before it moves
  $("tile-periods").parentElement.hidden = !now.periods_needed;
  say("tile-signal", now.signal ? `${kind.name} ${reading(now.value)}${now.target !== null ? `, target ${reading(now.target)}` : ""}` : "–");
  say("tile-output", percent(now.output));
  say("tile-periods", now.periods_needed ? `${now.periods} of ${now.periods_needed} agree` : "");
  say("tile-guard", now.guard ? `${now.guard}, ${percent(now.guard_share)} used` : "–");
  say("tile-mode", state.vitals ? `${vitals.mode}, ${vitals.armed ? "armed" : "disarmed"}` : "–");
  const battery = [];
  if (vitals.battery_voltage != null) battery.push(`${vitals.battery_voltage.toFixed(1)} V`);
  if (vitals.battery_remaining != null) battery.push(percent(vitals.battery_remaining));
  say("tile-battery", state.vitals ? battery.join(", ") || "not reported" : "–");
  const radio = [];
  if (vitals.round_trip != null) radio.push(`${Math.round(vitals.round_trip * 1000)} ms round trip`);
  if (vitals.attitude_rate != null) radio.push(`attitude ${Math.round(vitals.attitude_rate)} Hz`);
  say("tile-link", radio.join(", ") || "–");
  const cost = state.proposal && state.proposal.cost_after !== null
    ? [state.proposal.cost_after, state.proposal.cost_worst] : state.cost ? [state.cost.nominal, state.cost.worst] : null;
  $("tile-cost").parentElement.hidden = !cost;  // most runs predict none
  say("tile-cost", cost ? `${costs(...cost)} s²` : "");
}

let shownWords = -1;
function showWords() {
  const last = state.words.length ? state.words[state.words.length - 1].n : 0;
  if (last === shownWords) return;
  shownWords = last;
  $("words").replaceChildren(...state.words.slice(-200).reverse().map((word) => {
    const item = document.createElement("li");
    item.textContent = word.severity === null ? signed(word.text) : `Vehicle: ${word.text}`;
    if (word.severity !== null) item.className = word.severity <= 3 && !word.note ? "severe" : "vehicle";
    if (word.note) item.append(` – ${word.note}`);
    return item;
  }));
}

function showEnd() {
  const end = state.end;
  $("end").hidden = !end;
  if (!end) return;
  $("end").classList.toggle("bad", !end.fine);
  say("end-title", `${state.run.title}: ${end.meaning}`);
  $("end-report").hidden = !end.report;
  say("end-report-link", `The ${end.report.split(".")[0]} of this run`);
  $("end-report-link").href = `files/${state.run.name}/${end.report}`;
  const resume = end.resume || {};
  $("end-resume").hidden = !resume.command;
  say("end-resume-text", resume.text || "");
  write("end-resume-command", resume.command || "");
  say("end-reason", end.meaning.startsWith(end.reason) ? "" : end.reason);
  if ($("put-back").dataset.of === state.run.begun) return;
  $("put-back").dataset.of = state.run.begun;
  $("end-offer").replaceChildren();
  if (!end.undone) offerMore(state.run.name);
  $("flown").replaceChildren(...items(end.flown || []));
  $("put-back").replaceChildren(...items(end.put_back));
  $("put-back-title").hidden = !end.put_back.length;
}

// What can follow the run: it is asked of the archive, which a reload finds as it is.
const does = {
  may: () => mayTouch && !running(),
  read: runs.parse,
  again: (chosen) => { fill(chosen); look("start"); },
  started: () => look("live"),
  refused: (why) => { refused = why; show(); },
};
async function offerMore(name) {
  const answer = await fetch(`runs/${encodeURIComponent(name)}`).catch(() => null);
  if (answer && answer.ok && state.run && state.run.name === name) offer($("end-offer"), await answer.json(), does);
}

let drawn = 0;
function show() {
  showBar(); showAlarm(); showQuestion(); showEnd();
  $("idle").hidden = Boolean(state.run);
  $("live").hidden = !state.run;
  $("view-live").hidden = view !== "live";
  $("view-start").hidden = view !== "start";
  $("view-runs").hidden = view !== "runs";
  for (const name of ["live", "start", "runs"]) $(`tab-${name}`).setAttribute("aria-pressed", String(view === name));
  $("look-only").hidden = mayTouch || !isKnown;
  $("start").disabled = !mayTouch || running();
  if (view === "start") showCrafts(state, mayTouch && !running());
  if (view === "runs") runs.show(state, mayTouch);
  if (!state.run || view !== "live" || document.hidden) return;
  showTiles(); showWords(); showSteps();
  write("command", `The same in a terminal: ${state.run.command}`);
  $("gains").hidden = !state.proposal;
  if (state.proposal && $("gains").dataset.of !== JSON.stringify(state.proposal)) {
    $("gains").dataset.of = JSON.stringify(state.proposal);
    $("gains-table").replaceChildren(...gains(state.proposal));
  }
  if (fresh && (state.rows.length || state.track) && performance.now() - drawn > 90) { fresh = false; drawn = performance.now(); draw(state); }
}

function take(delta) {
  const before = state.run && state.run.begun, wasRunning = running();
  state = apply(state, delta);
  if (wasRunning && !running() && view === "runs") runs.list();  // the run that ended is in the list now
  if (delta.whole || delta.fresh || delta["+rows"] || delta.room || delta.track) fresh = true;
  if ((state.run && state.run.begun) !== before) { wantStop = 0; refused = ""; shownWords = -1; answering = null; }
  if (!running()) { wantStop = 0; }
  requestAnimationFrame(show);
}

function look(at) {
  if (view !== at && at === "runs") runs.list();
  if (view !== at && at === "start") models();
  if (at !== "runs") runs.close();
  view = at;
  show();
  again();
}

// Every picture once more: after a change of the colours, the width, or what is shown.
function again() {
  redraw();
  whatIf.redraw();
  runs.redraw();
  fresh = true;
  drawn = 0;
  show();
}
$("tab-runs").onclick = () => look("runs");
$("tab-live").onclick = () => look("live");
$("tab-start").onclick = $("go-start").onclick = () => look("start");
for (const media of ["(prefers-color-scheme: dark)", "print"]) matchMedia(media).addEventListener("change", again);
let wide = innerWidth;
addEventListener("resize", () => {  // a phone's address bar that comes and goes changes the height alone
  if (wide === innerWidth) return;
  wide = innerWidth;
  again();
});
document.addEventListener("visibilitychange", () => { fresh = true; show(); });
setInterval(show, 500);

async function begin() {
  const fields = await (await fetch("about")).json();
  say("version", ` ${fields.version}`);
  mayTouch = !fields.token_needed || (token() !== "none" && (await post("token")).ok);
  isKnown = true;
  make(fields, () => look("live"));
  whatIf.make(fields);
  runs.make(fields.dofs, does, () => { if (mayTouch) look("runs"); return mayTouch; });
  show();
}
begin().catch(() => setTimeout(() => location.reload(), 3000));
connect(take);
