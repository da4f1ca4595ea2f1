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
  $("job").replaceChildren(...fields.jobs.map((job) => option(job.name, job.title)));
  $("axis").replaceChildren(...fields.axes.map((axis) => option(axis.name, axis.name)));
  $("job").onchange = $("axis").onchange = offer;
  $("connect").value ||= fields.link || "";
  offer();
  $("form").onsubmit = async (event) => {
    event.preventDefault();
    $("start").disabled = true;
    $("form-error").textContent = "";
    const answer = await post("start", chosen());
    $("start").disabled = false;
    if (answer.ok) started();
    else $("form-error").textContent = `Not started: ${answer.error || "the server did not say why"}`;
  };
}

function chosen() {
  const numbers = {};
  for (const node of document.querySelectorAll("#numbers input")) if (node.value.trim()) numbers[node.name] = node.value.trim();
  return { job: $("job").value, axis: $("axis").value, connect: $("connect").value.trim(), dry_run: $("dry").checked, numbers };
}

function offer() {
  const axis = table.axes.find((each) => each.name === $("axis").value);
  const tune = $("job").value === "tune";
  $("example").textContent = axis.example;
  $("dry-row").hidden = !tune;
  const kept = chosen().numbers;
  const groups = [];
  for (const [heading, numbers] of Object.entries(table.numbers)) {
    const fields = numbers.filter((n) => tune || !n.tune_only).map((n) => field(n, axis.name, kept)).filter(Boolean);
    if (!fields.length) continue;
    const group = document.createElement("details"), title = document.createElement("summary");
    title.textContent = heading;
    group.append(title, ...fields);
    group.open = fields.some((each) => each.querySelector("input").value);
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
  label.textContent = `${number.name}${limit.unit ? ` [${limit.unit}]` : ""}`;
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
