// What can follow a run: the picture of its proof, undo, the next step of a job, again, download.
import { about, drawProof, kept } from "./charts.js";
import { post } from "./state.js";

const folder = (name) => `files/${encodeURIComponent(name)}`;
const path = (file) => file.split("/").map(encodeURIComponent).join("/");

// Fills *node* with what the archive's *entry* offers. *does*: {may, read, again, started, refused}. What comes late
// goes into a box of its own, so that nothing of one run stands in the card of another.
export async function offer(node, entry, does) {
  const box = document.createElement("div"), buttons = document.createElement("p");
  node.replaceChildren(box);
  box.append(buttons);
  buttons.className = "buttons";
  const press = (text, act) => {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "starts";
    button.textContent = text;
    button.disabled = !does.may();
    button.onclick = act;
    buttons.append(button, " ");
  };
  const start = async (chosen) => {
    const answer = await post("start", chosen);
    if (answer.ok) does.started();
    else does.refused(`Not started: ${answer.error || "no reason given by the server"}`);
  };
  if (entry.resume) press("Continue with the next step", () => start(entry.resume));
  if (entry.undo) press(entry.undo, () => start({ job: "undo", run: entry.name }));
  if (entry.again) press("Again with the same settings", () => does.again(entry.again));
  if (entry.files.length) {
    const link = document.createElement("a");
    link.href = `zip/${encodeURIComponent(entry.name)}`;
    link.textContent = "Download the run";
    buttons.append(link);
  }
  const old = entry.trials.filter((trial) => trial.file.endsWith("-step-before.csv"));
  for (const before of old) {
    const where = before.file.slice(0, before.file.lastIndexOf("/") + 1);
    const after = entry.trials.find((trial) => trial.file.startsWith(where) && trial.file.endsWith("-step-after.csv"));
    if (after) await picture(box, entry.name, before, after, does.read);
  }
}

async function picture(node, name, before, after, read) {
  const texts = await Promise.all([before, after].map(async (trial) => {
    const answer = await fetch(`${folder(name)}/${path(trial.file)}`);
    return answer.ok ? answer.text() : "";
  })).catch(() => []);
  if (texts.length < 2 || !texts[0] || !texts[1]) return;
  const [old, made] = [read(texts[0], before), read(texts[1], after)];
  if (![old, made].every((rows) => rows.some((r) => r[2] !== null && r[3] !== null))) return;
  const figure = document.createElement("figure"), caption = document.createElement("figcaption"), chart = document.createElement("div");
  const kind = about(after.signal);
  caption.textContent = `The same step before and after: ${kind.name} from the start of the step [${kind.unit}] over time [s]`;
  figure.append(caption, chart);
  node.append(figure);
  kept(chart, () => [drawProof(chart, old, made, after.signal)]);
}
