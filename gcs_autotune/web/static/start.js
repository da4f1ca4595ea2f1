// The form a run is started with: fields and ranges are the server's table of limits.
import { post } from "./state.js";

const $ = (id) => document.getElementById(id);
let table = null;

function option(value, text) {
  const node = document.createElement("option");
  node.value = value;
  node.textContent = text;
  return node;
}

export function make(fields, started) {
  table = fields;
  $("job").replaceChildren(...fields.jobs.map((job) => option(job.name, job.title.split(": ")[0])));
  $("axis").replaceChildren(...fields.axes.map((axis) => option(axis.name, axis.name)));
  $("manoeuvre").replaceChildren(...fields.manoeuvres.map((kind) => option(kind.name, kind.name)));
  $("style").replaceChildren(...fields.styles.map((style) => option(style, style)));
  $("style").value = "normal";
  $("first-to").replaceChildren(...fields.sides.map((side) => option(side, side)));
  $("job").onchange = $("axis").onchange = $("force").onchange = offer;
  $("manoeuvre").onchange = () => { forces(); offer(); };
  forces();
  models();
  $("craft").onchange = choose;
  $("listen").onclick = listen;
  $("connect").value ||= fields.link || "";
  offer();
  $("form").onsubmit = async (event) => {
    event.preventDefault();
    $("start").disabled = true;
    $("form-error").textContent = "";
    const answer = await post("start", chosen());
    $("start").disabled = false;
    if (answer.ok) started();
    else $("form-error").textContent = `Not started: ${answer.error || "no reason given by the server"}`;
  };
}

// The models that runs and the desk have left; none chosen: the run finds its own.
export async function models(wanted = null) {
  const { entries } = await fetch("runs").then((answer) => answer.json()).catch(() => ({ entries: [] }));
  known = [];
  for (const each of entries) {
    const link = each.again && each.again.connect;
    if (link && !link.startsWith("sitl:") && !known.some((other) => other.link === link)) known.push({ ...each, link });
  }
  crafts();
  const found = entries.flatMap((each) => (each.models || []).map((file) => `${each.name}/${file}`));
  const before = wanted ?? $("model").value;
  if (before.endsWith("/styles.json")) found.push(before);  // a proof of What if, again
  $("model").replaceChildren(option("", "none"), ...found.map((path) => option(path, path.replace(/(.*)\/styles.json$/, "gains of What if: $1"))));
  $("model").value = found.includes(before) ? before : "";
}

function chosen() {
  const numbers = {};
  for (const node of document.querySelectorAll("#numbers input")) if (node.value.trim()) numbers[node.name] = node.value.trim();
  return {
    job: $("job").value, style: $("style").value, axis: $("axis").value, manoeuvre: $("manoeuvre").value, force: $("force").value,
    craft: $("craft").value.startsWith("preset ") ? $("craft").value.slice(7) : "",
    first_to: $("first-to").value, area: $("area").value.trim(), model: $("model").value, connect: $("connect").value.trim(),
    dry_run: $("dry").checked, fetch_log: $("fetch").checked, numbers,
  };
}

// The same choices again, to be looked through before they are started.
export function fill(choice) {
  const ids = { job: "job", axis: "axis", manoeuvre: "manoeuvre", style: "style", first_to: "first-to", area: "area", connect: "connect" };
  $("style").replaceChildren(...table.styles.map((style) => option(style, style)));
  $("style").value = "normal";
  if (choice.style && !table.styles.includes(choice.style)) $("style").append(option(choice.style, `${choice.style} of 100`));
  for (const [name, id] of Object.entries(ids)) if (choice[name]) $(id).value = choice[name];
  $("craft").value = choice.craft && table.presets[choice.craft] ? `preset ${choice.craft}` : "";
  $("dry").checked = choice.dry_run === true;
  $("fetch").checked = choice.fetch_log === true;
  forces();
  if (choice.force) $("force").value = choice.force;
  offer();
  for (const node of document.querySelectorAll("#numbers input")) node.value = (choice.numbers || {})[node.name] || "";
  models(choice.model || "");
  offer();
}

// Craft to choose from: simulated, received on a port, and those of earlier runs with their settings.
let known = [], received = [];
function crafts() {
  if (!table) return;  // opened or updated before the server's table arrived; make() calls this again
  const before = $("craft").value, groups = [["Simulated", Object.entries(table.crafts).map(([name, uri]) => [uri, name])],
    ["Received now", received.map((port) => [port.uri, `${port.told} on ${port.uri}`])],
    ["Of gcs-autotune.toml", Object.keys(table.presets).map((name) => [`preset ${name}`, name])],
    ["Earlier runs, with their settings", known.map((each, k) => [`run ${k}`, `${each.link} (${each.name})`])]];
  $("craft").replaceChildren(option("", "as in Link below"), ...groups.filter(([, all]) => all.length).map(([label, all]) => {
    const group = document.createElement("optgroup");
    group.label = label;
    group.append(...all.map(([value, text]) => option(value, text)));
    return group;
  }));
  $("craft").value = [...$("craft").options].some((one) => one.value === before) ? before : "";
}

function choose() {
  const value = $("craft").value;
  if (value.startsWith("run ")) fill(known[Number(value.slice(4))].again);
  else if (value.startsWith("preset ")) {
    const { connect, numbers } = table.presets[value.slice(7)];
    if (connect) $("connect").value = connect;
    for (const node of document.querySelectorAll("#numbers input")) node.value = numbers[node.name] || node.value;
  } else if (value) $("connect").value = value;
}

async function listen() {
  const told = await post("work", { verb: "ports" });
  if (!told.ok) $("listen-told").textContent = told.error;
}

// Called with every change of the state: what the ports gave.
let heard = "";
export function show(state, may) {
  const desk = state.desk && state.desk.verb === "ports" ? state.desk : null;
  $("listen").disabled = !may;
  if (!desk || JSON.stringify(desk) === heard) return;
  heard = JSON.stringify(desk);
  if (desk.running) { $("listen-told").textContent = "Listening on every port …"; return; }
  try { received = JSON.parse(desk.text.slice(desk.text.indexOf("{"))).ports.filter((port) => port.systems.length); } catch { received = []; }
  $("listen-told").textContent = received.length ? `Received: ${received.length}. Choose it above.`
    : desk.code === 0 ? "No vehicle was received. Check its power, the cable and the baud rate." : "Listening ended early.";
  crafts();
}

const manoeuvre = () => table.manoeuvres.find((each) => each.name === $("manoeuvre").value);

function forces() {
  const names = Object.keys(manoeuvre().forces);
  $("force").replaceChildren(...names.map((name) => option(name, name)));
  $("force-row").hidden = !names.length;
}

function offer() {
  const job = $("job").value, flies = job === "fly", kind = manoeuvre();
  const one = ["tune", "experiment"].includes(job);  // loop
  const axis = !flies && !one ? { name: "", example: table.jobs.find((each) => each.name === job).example } : flies ? { name: "", example: kind.forces[$("force").value] || kind.example }
    : table.axes.find((each) => each.name === $("axis").value);
  $("example").textContent = axis.example;
  $("axis-row").hidden = !one;
  $("style-row").hidden = !["all", "tune"].includes(job);
  $("fly-rows").hidden = !flies;
  $("job-help").textContent = table.jobs.find((each) => each.name === job).title.split(": ")[1];
  $("manoeuvre-help").textContent = `${kind.help}. Space: ${kind.room}.`;
  $("dry-row").hidden = job === "experiment";
  $("model-row").hidden = !["tune", "fly"].includes(job);
  $("model-help").textContent = flies ? "for the preview. None: the preview uses the vehicle's own parameters"
    : "for the design, without relay experiments. None: the model that this run identifies";
  $("dry-label").textContent = flies ? "Preview only: time, space and track; nothing moves"
    : "Dry run: fly, identify and design, but write no parameter";
  const kept = chosen().numbers;
  const groups = [];
  const tables = flies ? { [`Options of ${kind.name}`]: kind.options, ...table.numbers } : table.numbers;
  for (const [heading, numbers] of Object.entries(tables)) {
    const fields = numbers.filter((n) => n.jobs.includes(job)).map((n) => field(n, axis.name, kept)).filter(Boolean);
    if (!fields.length) continue;
    const group = document.createElement("details"), title = document.createElement("summary");
    title.textContent = heading;
    group.append(title, ...fields);
    group.open = heading === table.everyday || numbers === kind.options || fields.some((each) => each.querySelector("input").value);
    groups.push(group);
  }
  $("numbers").replaceChildren(...groups);
}

function field(number, axis, kept) {
  const limit = number.by_axis[axis] || number.by_axis[""];
  if (!limit) return null;
  const row = document.createElement("div"), label = document.createElement("label");
  const input = document.createElement("input"), help = document.createElement("small");
  row.className = "row";
  label.htmlFor = input.id = `n-${number.name}`;
  const name = number.name.replaceAll("-", " ");
  label.textContent = `${name.charAt(0).toUpperCase()}${name.slice(1)}${limit.unit ? ` [${limit.unit}]` : ""}`;
  input.name = number.name;
  input.inputMode = "decimal";
  input.autocomplete = "off";
  input.placeholder = limit.usual;
  input.value = kept[number.name] || "";
  help.id = `h-${number.name}`;
  help.textContent = `${limit.meaning}; ${limit.range}${limit.usual ? `; empty: ${limit.usual}` : ""}`;
  input.setAttribute("aria-describedby", help.id);
  row.append(label, input, help);
  return row;
}
