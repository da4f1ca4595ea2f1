// What if the loop were gentler or quicker: the designs of the server from the model of a run.
// While the slider moves, the picture between two designs is interpolated. Gains are never interpolated: the slider
// comes to rest on a design, and that one is proved.
import { about, drawStyle } from "./charts.js";
import { post } from "./state.js";

const $ = (id) => document.getElementById(id);
const CURVES = ["before", "after", "low", "high", "output"], STEPS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 };
let designs = [], signals = {}, entry = null, does = null, plots = [];
const gainText = (v) => String(Number(v.toPrecision(4)));  // as the reports write gains
const short = (v) => (v === null || v === undefined ? "–" : String(Number(v.toPrecision(3))));

export function make(fields) {
  signals = Object.fromEntries(fields.axes.map((axis) => [axis.name, axis.signal]));
  const slider = $("style-slider");
  slider.oninput = draw;
  slider.onchange = () => rest(nearest());
  slider.onkeydown = (event) => {
    if (!STEPS[event.key]) return;
    event.preventDefault();
    rest(Math.max(0, Math.min(designs.length - 1, nearest() + STEPS[event.key])));
  };
  $("prove").onclick = prove;
}

// Shows what the server has computed for *of*, a run of the archive.
export async function show(of, doing) {
  entry = of;
  does = doing;
  $("what-if").hidden = !of.loop;
  $("what-if-styles").hidden = true;
  if (!of.loop || !of.files.includes("styles.json")) return;
  const answer = await fetch(`files/${encodeURIComponent(of.name)}/styles.json`).catch(() => null);
  if (!answer || !answer.ok || entry !== of) return;
  designs = (await answer.json()).styles;
  if (!Array.isArray(designs)) return;  // of an earlier version: to be computed again
  $("what-if-styles").hidden = false;
  redraw();
}

// After a change of the colours or the width, or with other designs.
export function redraw() {
  plots.forEach((plot) => plot.destroy());
  plots = [];
  if (entry && !$("what-if-styles").hidden) draw();
}

const at = () => Number($("style-slider").value);
const nearest = () => designs.reduce((best, one, k) => (Math.abs(one.at - at()) < Math.abs(designs[best].at - at()) ? k : best), 0);

function rest(k) {
  $("style-slider").value = designs[k].at;
  draw();
}

const mix = (a, b, share) => (a === null || b === null ? (share < 0.5 ? a : b) : a + share * (b - a));

// The design at the slider. Between two designs: what is predicted, without gains.
function shown() {
  const k = designs.findIndex((one) => one.at >= at()), high = designs[k], low = designs[Math.max(k - 1, 0)];
  if (high.at === at() || low.error || high.error) return designs[nearest()];
  const share = (at() - low.at) / (high.at - low.at);
  const each = (one, other) => Object.fromEntries(Object.keys(one).filter((name) => typeof one[name] === "number" || one[name] === null)
    .map((name) => [name, mix(one[name], other[name], share)]));
  const t = low.step.t.filter((time) => time <= high.step.t[high.step.t.length - 1]);
  const step = { size: low.step.size, t };
  for (const name of CURVES) {
    const other = resampled(high.step.t, high.step[name], t);
    step[name] = t.map((_, i) => mix(low.step[name][i], other[i], share));
  }
  return {
    step, margins: each(low.margins, high.margins), largest_output: mix(low.largest_output, high.largest_output, share),
    metrics: { before: each(low.metrics.before, high.metrics.before), after: each(low.metrics.after, high.metrics.after) },
  };
}

function resampled(times, values, wanted) {
  let k = 1;
  return wanted.map((t) => {
    while (k < times.length - 1 && times[k] < t) k++;
    return mix(values[k - 1], values[k], (t - times[k - 1]) / (times[k] - times[k - 1]));
  });
}

function draw() {
  const style = shown(), kind = about(signals[entry.loop]), name = style.style || "";
  const told = name ? (isNaN(name) ? name : `${name} of 100`) : `${at()} of 100, between two designs`;
  $("style-name").textContent = told;
  $("style-slider").setAttribute("aria-valuetext", told);
  const changed = (style.gains || []).filter((gain) => gain.old !== gain.new);
  $("style-figure").hidden = $("style-gains").hidden = Boolean(style.error);
  $("prove-row").hidden = $("prove-help").hidden = !changed.length;
  if (style.error) { $("style-told").textContent = `No gains: ${style.error}`; return; }
  const { before, after } = style.metrics, m = style.margins;
  const settles = (one) => (one.settling === null ? "does not settle in the time shown" : `settles in ${short(one.settling)} s`);
  $("style-told").textContent = `Predicted: ${settles(after)} (present gains: ${settles(before)}), overshoot ${Math.round(100 * after.overshoot)} % `
    + `(${Math.round(100 * before.overshoot)} %). Smallest margins over the 95 % region: a factor of ${m.gain === null ? "any size" : short(m.gain)} in gain, `
    + `${m.phase === null ? "any" : `${Math.round(m.phase * 180 / Math.PI)}°`} of phase. Largest output ${Math.round(100 * style.largest_output)} % of full.`;
  $("style-gains").textContent = !name ? "The slider comes to rest on the nearest design and shows its gains."
    : changed.length ? changed.map((gain) => `${gain.parameter} ${gainText(gain.old)} → ${gainText(gain.new)}`).join(", ")
    : "The present gains stay: the design found none better in this style.";
  $("style-caption").textContent = `Predicted step: ${kind.name} [${kind.unit}], and output below, over time [s]`;
  plots = drawStyle($("style-chart"), style.step, signals[entry.loop], plots);
}

// A simulated vehicle ended with its run: the next one starts with the gains that the designs start from.
function linkNow(gains) {
  if (!entry.link.startsWith("sitl:")) return entry.link;
  const present = gains.map((gain) => `param=${gain.parameter}=${gain.old}`).join("&");
  return `${entry.link}${entry.link.includes("?") ? "&" : "?"}${present}`;
}

async function prove() {
  const again = entry.again || {}, { style, gains } = designs[nearest()];
  const told = await post("start", {
    ...again, job: "tune", axis: entry.loop, connect: linkNow(gains), style, model: `${entry.name}/styles.json`, dry_run: false,
  });
  if (told.ok) does.started();
  else does.refused(`Not started: ${told.error || "no reason given by the server"}`);
}
