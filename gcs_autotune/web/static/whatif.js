// What if the loop were gentler or quicker: the styles as designed by the server from the model of a run.
import { about, drawStyle } from "./charts.js";
import { post } from "./state.js";

const $ = (id) => document.getElementById(id);
let styles = [], signals = {}, entry = null, does = null, plots = [];
const short = (v) => (v === null || v === undefined ? "–" : String(Number(v.toPrecision(3))));

export function make(fields) {
  styles = fields.styles;
  signals = Object.fromEntries(fields.axes.map((axis) => [axis.name, axis.signal]));
  $("style-slider").max = styles.length - 1;
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
  const found = (await answer.json()).styles;
  $("what-if-styles").hidden = false;
  $("style-slider").oninput = () => draw(found);
  draw(found);
}

function draw(found) {
  const name = styles[$("style-slider").value], style = found[name], kind = about(signals[entry.loop]);
  $("style-name").textContent = name;
  $("style-slider").setAttribute("aria-valuetext", name);
  plots.forEach((plot) => plot.destroy());
  plots = [];
  $("style-figure").hidden = $("style-gains").hidden = Boolean(style.error);
  if (style.error) { $("style-told").textContent = `No gains: ${style.error}`; return; }
  const { before, after } = style.metrics, m = style.margins;
  const settles = (one) => (one.settling === null ? "does not settle" : `settles in ${short(one.settling)} s`);
  $("style-told").textContent = `Predicted: ${settles(after)} (present gains: ${settles(before)}), overshoot ${Math.round(100 * after.overshoot)} % `
    + `(${Math.round(100 * before.overshoot)} %). Smallest margins over the 95 % region: a factor of ${m.gain === null ? "any size" : short(m.gain)} in gain, `
    + `${m.phase === null ? "any" : `${Math.round(m.phase * 180 / Math.PI)}°`} of phase. Largest output ${Math.round(100 * style.largest_output)} % of full.`;
  const changed = style.gains.filter((gain) => gain.old !== gain.new);
  $("style-gains").textContent = changed.length ? changed.map((gain) => `${gain.parameter} ${short(gain.old)} → ${short(gain.new)}`).join(", ")
    : "The present gains stay: no others are better in this style.";
  $("style-caption").textContent = `Predicted step: ${kind.name} [${kind.unit}], and output below, over time [s]`;
  plots = drawStyle($("style-chart"), style.step, signals[entry.loop]);
}

async function prove() {
  const again = entry.again || {};
  const told = await post("start", {
    ...again, job: "tune", axis: entry.loop, connect: entry.link, style: styles[$("style-slider").value],
    model: `${entry.name}/model.json`, dry_run: false,
  });
  if (told.ok) does.started();
  else does.refused(`Not started: ${told.error || "no reason given by the server"}`);
}
