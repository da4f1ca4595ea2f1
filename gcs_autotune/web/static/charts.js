// The four pictures: signal and output by uPlot, track and phase portrait on canvases of our own.
const WINDOW = 120;  // seconds of the vehicle's time that are drawn
const LEAST = 1;  // metres that the track's picture shows at least: an ROV stays within decimetres
const MARGIN = 15;  // pixels around what the track's picture shows
const GAP = 3;  // seconds without a sample after which no line is drawn across
const DEG = 180 / Math.PI;
export const SIGNALS = {
  psi: { name: "heading", unit: "°", factor: DEG, rate: "°/s" }, r: { name: "turn rate", unit: "°/s", factor: DEG, rate: "°/s²" },
  z: { name: "depth", unit: "m", factor: 1, rate: "m/s" }, x: { name: "position ahead", unit: "m", factor: 1, rate: "m/s" },
  d: { name: "distance ahead", unit: "m", factor: 1, rate: "m/s" }, y: { name: "position abeam", unit: "m", factor: 1, rate: "m/s" },
  phi: { name: "roll", unit: "°", factor: DEG, rate: "°/s" }, theta: { name: "pitch", unit: "°", factor: DEG, rate: "°/s" },
  v: { name: "speed abeam", unit: "m/s", factor: 1, rate: "m/s²" }, u: { name: "speed", unit: "m/s", factor: 1, rate: "m/s²" },
};
export const about = (signal) => SIGNALS[signal] || { name: signal || "signal", unit: "", factor: 1, rate: "" };

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
let plots = null;

function makePlot(node, series, least, legend, label) {
  const axis = { stroke: css("soft"), grid: { stroke: css("faint"), width: 1 }, ticks: { stroke: css("faint") } };
  return new uPlot({
    width: node.clientWidth, height: 205, cursor: { show: false }, legend: { show: legend, live: false },
    scales: { x: { time: false }, y: { range: (u, low, high) => spread(low, high, least()) } },
    axes: [{ ...axis, size: 34 }, { ...axis, size: 52, values: (u, ticks) => ticks.map(label) }],
    series: [{}, ...series],
  }, [[], ...series.map(() => [])], node);
}

// A picture that is drawn again for other colours or another width, for as long as its *node* is on the page.
const pictures = new Map();
export function kept(node, make) {
  pictures.set(node, { make, plots: make() });
}
export function redraw() {
  forget();
  for (const [node, picture] of pictures) {
    picture.plots.forEach((plot) => plot.destroy());
    if (!node.isConnected) pictures.delete(node);
    else {
      picture.plots = picture.make();
      picture.plots.forEach((plot) => plot.batch(() => {}));  // at once, see draw
    }
  }
}

// The proof of a tune: the same step with the old and the new gains, from the moment of the step
// to the step back. The step back is not shown: each flight steps back at a time of its own.
export function drawProof(node, before, after, signal) {
  const kind = about(signal), sides = [before, after].map((rows) => fromStep(rows, kind.factor));
  const line = (label, name, dash) => ({ label, stroke: css(name), width: 2, dash, points: { show: false }, spanGaps: true });
  const axis = { stroke: css("soft"), grid: { stroke: css("faint"), width: 1 }, ticks: { stroke: css("faint") } };
  const [old, made] = sides, longest = old.t[old.t.length - 1] > made.t[made.t.length - 1] ? old : made;
  return new uPlot({
    width: node.clientWidth, height: 220, cursor: { show: false }, legend: { show: true, live: false },
    scales: { x: { time: false } }, axes: [{ ...axis, size: 34 }, { ...axis, size: 52 }],
    series: [{}, line("target", "wanted", [8, 5]), line("before", "soft"), line("after", "measured")],
  }, uPlot.join([[longest.t, longest.target], [old.t, old.value], [made.t, made.value]]), node);
}

// What a style would do: the step with the present and the new gains, and the output for it. Returns the plots.
// *plots*: those that it returned before, to be filled again.
export function drawStyle(node, step, signal, plots = []) {
  const k = about(signal).factor, axis = { stroke: css("soft"), grid: { stroke: css("faint"), width: 1 }, ticks: { stroke: css("faint") } };
  const line = (label, name, dash, width = 2) => ({ label, stroke: css(name), width, dash, points: { show: false } });
  const plot = (series, data, height) => new uPlot({
    width: node.clientWidth, height, cursor: { show: false }, legend: { show: true, live: false },
    scales: { x: { time: false } }, axes: [{ ...axis, size: 34 }, { ...axis, size: 52 }], series: [{}, ...series],
  }, data, node);
  const scaled = (values) => values.map((v) => v * k);
  const data = [[step.t, step.t.map(() => step.size * k), ...["before", "after", "low", "high"].map((name) => scaled(step[name]))],
    [step.t, step.output.map((v) => 100 * v)]];
  if (plots.length) { plots.forEach((each, i) => each.setData(data[i])); return plots; }
  return [
    plot([line("target", "wanted", [8, 5]), line("present gains", "soft"), line("new gains", "measured"),
      line("95 % range: low", "measured", [2, 4], 1), line("high", "measured", [2, 4], 1)],
    data[0], 230),
    plot([line("output [% of full]", "measured")], data[1], 150),
  ];
}

function fromStep(rows, factor) {
  const shown = rows.filter((r) => r[2] !== null && r[3] !== null);
  let at = shown.findIndex((r, k) => k > 0 && r[3] !== shown[k - 1][3]);
  const base = at > 0 ? shown[at - 1][3] : shown[0][2];
  if (at < 0) at = 0;
  const from = Math.max(0, at - 40), t0 = shown[at][1];
  const back = at > 0 ? shown.findIndex((r, k) => k > at && r[3] === base) : -1;
  const part = shown.slice(from, back < 0 ? shown.length : back);
  return { t: part.map((r) => r[1] - t0), value: part.map((r) => (r[2] - base) * factor), target: part.map((r) => (r[3] - base) * factor) };
}

function spread(low, high, least) {
  if (low === null || high === null) return [-least, least];
  const middle = (low + high) / 2, half = Math.max((high - low) * 0.55, least);
  return [middle - half, middle + half];
}

export function forget() {
  if (plots) { plots.signal.destroy(); plots.output.destroy(); }
  plots = null;
}

// A heading runs on past north in what is drawn, and is read off from 0 to 360 as a compass has it.
let isHeading = false;
const onCompass = (degrees) => ((degrees % 360) + 360) % 360;

let least = 1;
function made() {
  if (plots) return plots;
  const line = (label, name, dash) => ({ label, stroke: css(name), width: 2, dash, points: { show: false } });
  plots = {
    signal: makePlot(document.getElementById("chart-signal"),
      [line("measured", "measured"), line("target", "wanted", [8, 5])], () => least, true,
      (v) => String(isHeading ? onCompass(v) : v)),
    output: makePlot(document.getElementById("chart-output"), [line("% of full", "measured")], () => 10, false, String),
  };
  return plots;
}

// rows: [leg, t, value, target, output, rate, x, y, psi]
export function draw(state) {
  const { rows, legs } = state;
  if (document.getElementById("track").clientWidth <= 2 * MARGIN) return;  // in a hidden frame: no scale, no grid
  for (const name of ["signal", "output", "phase"]) document.getElementById(`figure-${name}`).hidden = !rows.length;
  if (!rows.length) { drawTrack(rows, legs, state); return; }
  const signal = legs.length ? legs[legs.length - 1].signal : "";
  const kind = about(signal), last = rows.length ? rows[rows.length - 1][1] : 0;
  const first = rows.length ? rows[0][1] : 0;
  let begin = rows.length;
  while (begin > 0 && legs[rows[begin - 1][0]].signal === signal && last - rows[begin - 1][1] < WINDOW) begin -= 1;
  const shown = [];
  for (const row of rows.slice(begin)) {
    const before = shown[shown.length - 1];
    if (before && row[1] - before[1] > GAP) shown.push([row[0], (before[1] + row[1]) / 2, ...Array(row.length - 2).fill(null)]);
    shown.push(row);
  }
  const scaled = (v) => (v === null || v === undefined ? null : v * kind.factor);
  const x = shown.map((r) => r[1] - first);
  isHeading = signal === "psi";
  least = kind.unit === "°" || kind.unit === "°/s" ? 5 : 0.2;
  const { signal: one, output: two } = made();
  // In a batch, which draws at once: Firefox copies the canvases for print before what waits is drawn.
  one.batch(() => one.setData([x, shown.map((r) => scaled(r[2])), shown.map((r) => scaled(r[3]))]));
  two.batch(() => two.setData([x, shown.map((r) => (r[4] === null ? null : r[4] * 100))]));
  say("caption-signal", `${capital(kind.name)} [${kind.unit || "1"}] over time [s], the last ${WINDOW} s: measured, target`);
  drawTrack(rows, legs, state);
  drawPhase(shown.filter((r) => r[0] === legs.length - 1), kind);
}

const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
function say(id, text) { const node = document.getElementById(id); if (node.textContent !== text) node.textContent = text; }

function canvas(id) {
  const node = document.getElementById(id), ratio = window.devicePixelRatio || 1;
  const width = node.clientWidth, height = node.clientHeight;
  if (node.width !== Math.round(width * ratio) || node.height !== Math.round(height * ratio)) {
    node.width = Math.round(width * ratio);
    node.height = Math.round(height * ratio);
  }
  const pen = node.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "12px system-ui, sans-serif";
  return { pen, width, height };
}

function niceStep(range) {
  const rough = range / 6, power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((k) => k * power >= rough);
}

// The predicted track on the ground: from where the craft lay, and once its run is flown, from where that began.
function foretold(track, rows, legs) {
  if (!track) return [];
  const start = rows.find((r) => legs[r[0]].stage === track.run && r[6] !== null && r[7] !== null);
  const [x, y, psi] = start ? [start[6], start[7], start[8]] : [track.x, track.y, track.psi];
  const c = Math.cos(psi || 0), s = Math.sin(psi || 0);
  return track.ahead.map((a, k) => [(x || 0) + a * c - track.abeam[k] * s, (y || 0) + a * s + track.abeam[k] * c]);
}

function drawTrack(rows, legs, { room, track }) {
  const { pen, width, height } = canvas("track");
  const points = rows.filter((r) => r[6] !== null && r[7] !== null);
  const predicted = foretold(track, rows, legs);
  if (!points.length && !predicted.length) {
    say("caption-track", "Track: the vehicle reports no position");
    return;
  }
  let [north, south, east, west] = [-Infinity, Infinity, -Infinity, Infinity];
  for (const r of points) {
    north = Math.max(north, r[6]); south = Math.min(south, r[6]); east = Math.max(east, r[7]); west = Math.min(west, r[7]);
  }
  for (const [n, e] of predicted) {
    north = Math.max(north, n); south = Math.min(south, n); east = Math.max(east, e); west = Math.min(west, e);
  }
  const zones = (room && room.zones) || [];
  for (const [corners, radius] of zones) for (const [n, e] of corners) {
    north = Math.max(north, n + radius); south = Math.min(south, n - radius);
    east = Math.max(east, e + radius); west = Math.min(west, e - radius);
  }
  const scale = Math.min((width - 2 * MARGIN) / Math.max(east - west, LEAST), (height - 2 * MARGIN) / Math.max(north - south, LEAST));
  const px = (e) => width / 2 + (e - (east + west) / 2) * scale;
  const py = (n) => height / 2 - (n - (north + south) / 2) * scale;
  const step = niceStep(width / scale);
  pen.strokeStyle = css("faint"); pen.lineWidth = 1; pen.beginPath();
  const reach = (low, high) => [Math.ceil(low / step), Math.floor(high / step)];
  const halfE = width / 2 / scale, halfN = height / 2 / scale, midE = (east + west) / 2, midN = (north + south) / 2;
  for (let [k, to] = reach(midE - halfE, midE + halfE); k <= to; k++) { pen.moveTo(px(k * step), 0); pen.lineTo(px(k * step), height); }
  for (let [k, to] = reach(midN - halfN, midN + halfN); k <= to; k++) { pen.moveTo(0, py(k * step)); pen.lineTo(width, py(k * step)); }
  pen.stroke();
  pen.strokeStyle = css("limit"); pen.lineWidth = 2;
  let limit = "";
  if (room && room.x !== null && room.y !== null && room.distance !== null) {
    pen.setLineDash([6, 4]); pen.beginPath();
    pen.arc(px(room.y), py(room.x), room.distance * scale, 0, 2 * Math.PI); pen.stroke(); pen.setLineDash([]);
    cross(pen, px(room.y), py(room.x));
    limit = `; limit ${room.distance} m from the cross`;
  }
  for (const [corners, radius, inside] of zones) {
    pen.setLineDash(inside ? [] : [2, 4]); pen.beginPath();
    if (corners.length === 1) pen.arc(px(corners[0][1]), py(corners[0][0]), radius * scale, 0, 2 * Math.PI);
    else { corners.forEach(([n, e], i) => (i ? pen.lineTo(px(e), py(n)) : pen.moveTo(px(e), py(n)))); pen.closePath(); }
    pen.stroke(); pen.setLineDash([]);
  }
  if (zones.length) limit += "; area and fence shown (dotted: keep out)";
  if (predicted.length) {
    pen.strokeStyle = css("wanted"); pen.setLineDash([8, 5]); pen.beginPath();
    predicted.forEach(([n, e], i) => (i ? pen.lineTo(px(e), py(n)) : pen.moveTo(px(e), py(n))));
    pen.stroke(); pen.setLineDash([]);
    limit += "; dashed: predicted";
  }
  pen.strokeStyle = css("measured"); pen.beginPath();
  points.forEach((r, i) => (i ? pen.lineTo(px(r[7]), py(r[6])) : pen.moveTo(px(r[7]), py(r[6]))));
  pen.stroke();
  const now = points.length ? points[points.length - 1] : [0, 0, 0, 0, 0, 0, track.x || 0, track.y || 0, track.psi];
  bow(pen, px(now[7]), py(now[6]), now[8] || 0);
  say("caption-track", `Track from above, north up; grid ${Number(step.toPrecision(2))} m${limit}`);
}

function cross(pen, x, y) {
  pen.beginPath(); pen.moveTo(x - 6, y); pen.lineTo(x + 6, y); pen.moveTo(x, y - 6); pen.lineTo(x, y + 6); pen.stroke();
}

function bow(pen, x, y, psi) {
  const turned = (ahead, abeam) => [x + ahead * Math.sin(psi) + abeam * Math.cos(psi), y - ahead * Math.cos(psi) + abeam * Math.sin(psi)];
  pen.fillStyle = css("wanted"); pen.beginPath();
  [[13, 0], [-7, 5], [-4, 0], [-7, -5]].forEach(([a, b], i) => (i ? pen.lineTo(...turned(a, b)) : pen.moveTo(...turned(a, b))));
  pen.closePath(); pen.fill();
}

// Text that stays readable where a curve runs under it.
function note(pen, text, x, y) {
  pen.fillStyle = css("card"); pen.globalAlpha = 0.8; pen.fillRect(x - 2, y - 11, pen.measureText(text).width + 4, 15);
  pen.fillStyle = css("soft"); pen.globalAlpha = 1; pen.fillText(text, x, y);
}

function drawPhase(rows, kind) {
  const { pen, width, height } = canvas("phase");
  const points = rows.filter((r) => r[2] !== null && r[5] !== null).map((r) => [(r[2] - (r[3] ?? r[2])) * kind.factor, r[5] * kind.factor]);
  if (!points.length || rows.every((r) => r[3] === null)) {
    say("caption-phase", "Phase portrait: shown only while there is a target");
    return;
  }
  const most = (k, floor) => Math.max(floor, ...points.map((p) => Math.abs(p[k]))) * 1.15;
  const a = most(0, least / 2), b = most(1, least / 5);
  const px = (v) => width / 2 + (v / a) * (width / 2), py = (v) => height / 2 - (v / b) * (height / 2);
  pen.strokeStyle = css("faint"); pen.lineWidth = 1; pen.beginPath();
  pen.moveTo(0, height / 2); pen.lineTo(width, height / 2); pen.moveTo(width / 2, 0); pen.lineTo(width / 2, height); pen.stroke();
  pen.strokeStyle = css("measured"); pen.lineWidth = 1.5; pen.beginPath();
  points.forEach(([v, w], i) => (i ? pen.lineTo(px(v), py(w)) : pen.moveTo(px(v), py(w))));
  pen.stroke();
  const [v, w] = points[points.length - 1];
  pen.fillStyle = css("wanted"); pen.beginPath(); pen.arc(px(v), py(w), 5, 0, 2 * Math.PI); pen.fill();
  const of = (value, unit) => `${value.toPrecision(2)}${unit.startsWith("°") ? "" : " "}${unit}`;
  const end = of(a, kind.unit);
  note(pen, end, width - pen.measureText(end).width - 2, height / 2 - 5);
  note(pen, of(b, kind.rate), width / 2 + 5, 14);
  say("caption-phase", `Phase portrait: error of the ${kind.name} (horizontal) and its rate (vertical)`);
}
