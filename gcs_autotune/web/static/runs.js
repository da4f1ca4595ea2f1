// What is on disk: runs and dropped logs, their replay on the charts of the live view, and work on them.
import { draw, forget } from "./charts.js";
import { offer } from "./result.js";
import * as whatIf from "./whatif.js";
import { empty, post, signed, token } from "./state.js";

const $ = (id) => document.getElementById(id);
const say = (id, text) => { if ($(id).textContent !== text) $(id).textContent = text; };
const NO_SUMMARY = "This run has no result: it is in progress, or it ended before it wrote its summary. Its records are listed below.";
const MOST_ROWS = 6000;
const VERBS = ["list", "identify", "diagnose", "compare", "what-if"];
let entries = [];
let does = null, entry = null, touch = () => false, desk = null, replay = null;

function item(...nodes) {
  const node = document.createElement("li");
  node.append(...nodes);
  return node;
}

function press(text, act) {
  const node = document.createElement("button");
  node.type = "button";
  node.className = "link";
  node.textContent = text;
  node.onclick = act;
  return node;
}

const address = (name, file) => `files/${encodeURIComponent(name)}/${file.split("/").map(encodeURIComponent).join("/")}`;

export function make(dofs, doing, mayTouch) {
  does = doing;
  touch = mayTouch;
  $("dof").replaceChildren(...dofs.map((dof) => new Option(dof, dof)));
  for (const verb of VERBS) $(`work-${verb}`).onclick = () => work(verb);
  $("filter").oninput = filter;
  $("drop").onchange = () => { if ($("drop").files.length) takeIn($("drop").files[0]); };
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    const files = event.dataTransfer ? event.dataTransfer.files : [];
    if (files.length && touch()) takeIn(files[0]);
  });
  $("play").onclick = () => { if (replay) { replay.playing = !replay.playing; if (replay.at >= 1) replay.at = 0; } };
  $("at").oninput = () => { if (replay) { replay.at = $("at").value / 1000; replay.playing = false; redraw(); } };
  $("replay-close").onclick = () => close();
  setInterval(step, 100);
}

export async function list() {
  try {
    entries = (await (await fetch("runs")).json()).entries;
    $("runs").replaceChildren(...(entries.length ? entries.map(row) : [cells("No recorded runs yet.")]));
    filter();
    others();
  } catch {
    say("runs-error", "The list of runs could not be loaded. Reload the page.");
  }
}

function cells(...contents) {
  const node = document.createElement("tr");
  for (const content of contents) {
    const cell = document.createElement("td");
    cell.append(content);
    node.append(cell);
  }
  return node;
}

function row(each) {
  const page = each.report ? report(each.name, each.report, each.report.split(".")[0]) : "";
  return cells(press(each.name, () => open(each.name)), each.when, each.craft, each.log || each.title, each.ending || (each.log ? "" : "none"), each.change, page);
}

function filter() {
  const words = $("filter").value.toLowerCase().split(/\s+/);
  const rows = [...$("runs").children];
  for (const node of rows) node.hidden = !words.every((word) => node.textContent.toLowerCase().includes(word));
  say("runs-none", entries.length && rows.every((node) => node.hidden) ? "No run contains these words. Clear the field to show all runs." : "");
}

function others() {
  const rest = entries.filter((each) => !entry || each.name !== entry.name);
  $("other").replaceChildren(...rest.map((each) => new Option(`${each.name} ${each.log || each.title}`, each.name)));
}

function report(name, file, text) {
  const link = document.createElement("a");
  link.href = address(name, file);
  link.target = "_blank";
  link.rel = "noopener";
  link.textContent = text;
  return link;
}

async function open(name) {
  say("runs-error", "");
  const answer = await fetch(`runs/${encodeURIComponent(name)}`);
  if (!answer.ok) { say("runs-error", "This run no longer exists. Reload the page."); return; }
  entry = await answer.json();
  $("entry").hidden = false;
  say("entry-title", entry.log || `${entry.title} (${entry.name})`);
  say("entry-reason", entry.reason || (entry.ending || entry.log ? "" : NO_SUMMARY));
  $("entry-resume").hidden = !entry.way_on.command;
  say("entry-resume-text", entry.way_on.text || "");
  say("entry-resume-command", entry.way_on.command || "");
  $("trials").replaceChildren(...entry.trials.map((trial) => item(press(trial.name, () => play(entry.name, trial)), ` ${signed(trial.ending)}`)));
  if (!entry.trials.length) $("trials").replaceChildren(item("This run contains no record to replay."));
  $("files").replaceChildren(...entry.files.map((file) => item(report(entry.name, file, file))));
  others();
  offer($("entry-offer"), entry, does);
  whatIf.show(entry, does);
  $("entry").scrollIntoView({ block: "nearest" });
}

async function takeIn(file) {
  say("runs-error", `Uploading ${file.name} …`);
  try {
    const answer = await fetch(`drop?name=${encodeURIComponent(file.name)}`, {
      method: "POST", body: file, headers: { "X-Autotune-Token": token() },
    });
    const told = await answer.json();
    say("runs-error", answer.ok ? "" : `Not uploaded: ${told.error}`);
    if (answer.ok) { await list(); await open(told.name); }
  } catch {
    say("runs-error", "Not uploaded: the connection was lost. Check the size of the file.");
  }
  $("drop").value = "";
}

async function work(verb) {
  if (!entry) return;
  const told = await post("work", { name: entry.name, verb, dof: $("dof").value, other: $("other").value });
  say("runs-error", told.ok ? "" : told.error);
}

let shownDesk = null;
export function show(state, mayTouch) {
  desk = state.desk || null;
  for (const verb of VERBS) $(`work-${verb}`).disabled = !mayTouch || Boolean(desk && desk.running);
  $("drop").disabled = !mayTouch;
  const mine = desk && entry && desk.name === entry.name;
  const what = mine ? JSON.stringify(desk) : "";
  if (what === shownDesk) return;
  const ended = mine && !desk.running && shownDesk !== null;
  shownDesk = what;
  say("desk-told", !mine ? "" : desk.running ? `${desk.verb}: running …` : `${desk.verb}: ${desk.code === 0 ? "done" : `ended with code ${desk.code}`}`);
  $("desk-text").hidden = !mine || !desk.text;
  say("desk-text", mine ? desk.text : "");
  if (ended) open(entry.name);  // what it wrote is among the files now
}

// --- replay ---------------------------------------------------------------------------------------------------------

const RATES = { psi: "r", z: "w", x: "u", u: "", r: "" };

export function parse(text, trial) {
  const lines = text.trim().split("\n"), names = lines[0].split(",").map((head) => head.split("[")[0].trim());
  const at = Object.fromEntries(names.map((name, k) => [name, k])), now = {};
  const force = trial.force || ({ z: "Z", u: "X", x: "X" }[trial.signal] || "N"), rows = [];
  const keep = Math.max(1, Math.ceil(lines.length / MOST_ROWS));
  for (let k = 1; k < lines.length; k++) {
    const cells = lines[k].split(",");
    for (const name of names) if (cells[at[name]]) now[name] = Number(cells[at[name]]);
    if (k % keep || !cells[at[trial.signal]]) continue;
    let target = typeof trial.reference === "number" ? trial.reference : null;
    for (const [t, value] of trial.targets) if (t <= now.t) target = value;
    const of = (name) => (Number.isFinite(now[name]) ? now[name] : null);
    rows.push([0, now.t, of(trial.signal), target, of(force), of(RATES[trial.signal]), of("x"), of("y"), of("psi")]);
  }
  return rows;
}

async function play(name, trial) {
  const answer = await fetch(address(name, trial.file));
  if (!answer.ok) { say("runs-error", "The record could not be loaded. Try again."); return; }
  const rows = parse(await answer.text(), trial);
  if (!rows.length) { say("runs-error", "This record contains no signal to plot."); return; }
  replay = { rows, trial, at: 0, playing: true };
  say("replay-title", `${trial.name} of ${name}`);
  $("replay").hidden = false;
  $("replay-charts").append($("charts"));
  $("charts").hidden = false;
  forget();
  redraw();
  $("replay").scrollIntoView({ block: "start" });
}

export function close() {
  if (!replay) return;
  replay = null;
  $("replay").hidden = true;
  $("tiles").after($("charts"));
  forget();
}

function step() {
  if (!replay || !replay.playing || document.hidden) return;
  const whole = replay.rows[replay.rows.length - 1][1] - replay.rows[0][1];
  replay.at = Math.min(1, replay.at + (0.1 * Number($("pace").value)) / Math.max(whole, 1));
  if (replay.at >= 1) replay.playing = false;
  redraw();
}

export function redraw() {
  if (!replay) return;
  const { rows, trial, at } = replay, first = rows[0][1], until = first + at * (rows[rows.length - 1][1] - first);
  let count = rows.findIndex((r) => r[1] > until);
  if (count < 0) count = rows.length;
  $("at").value = Math.round(at * 1000);
  say("at-time", `${(until - first).toFixed(1)} s`);
  say("play", replay.playing ? "Pause" : "Play");
  draw({ ...empty(), legs: [{ signal: trial.signal }], rows: rows.slice(0, Math.max(count, 1)) });
}
