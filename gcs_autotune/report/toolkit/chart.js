"use strict";
// The charts of a report. Each element with `data-chart` (made by chart.py from the figure's own plot) becomes a group of
// uPlot panels: values under the pointer, zoom by dragging, curves to hide. The SVG stays for paper and without scripts.
(() => {
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const shade = (colour) => (colour[0] === "#" ? colour : css(`plot-${colour}`));
  const DASH = { "--": [5, 3], ":": [1.5, 2.5], "-.": [5, 2.5, 1.5, 2.5] };
  const POINT = 4 / 3;  // CSS pixels in a point
  const NEAR = 24;  // CSS pixels within which a curve is read
  const LEFT = 52, RIGHT = 12, TOP = 6, BOTTOM = 26;
  const make = (tag, parent, className, text) => {
    const node = parent.appendChild(document.createElement(tag));
    if (className) node.className = className;
    if (text) node.textContent = text;
    return node;
  };
  const rises = (x) => x.every((v, i) => i === 0 || v === null || x[i - 1] === null || v >= x[i - 1]);
  const key = (part) => [part.c, part.d, part.fill].join(" ");
  const shown = (value, range) => {
    const digits = Math.max(0, Math.min(6, 2 - Math.floor(Math.log10(range || 1))));
    return value.toFixed(digits).replace("-", "\u2212");
  };
  const tick = (v) => String(+v.toPrecision(6)).replace("-", "\u2212");

  function chart(paper) {
    const panels = JSON.parse(paper.dataset.chart);
    const box = document.createElement("div");
    paper.before(box);
    box.className = "chart";
    const state = { off: new Set(), panels };
    legend(box, state);
    const grid = make("div", box, "columns");
    const columns = [...new Set(panels.map((p) => p.column))].map((c) => panels.filter((p) => p.column === c));
    for (const column of columns) {
      const node = make("div", grid);
      column.forEach((panel, i) => {
        Object.assign(panel, { mates: column.filter((p) => p !== panel && sameX(p, panel)), state, parametric: false });
        panel.parametric = panel.equal || panel.parts.some((p) => p.x && p.d && !p.fill && !rises(p.x));
        panel.isLast = i === column.length - 1 || panel.mates.length === 0;
        make("div", node, "unit", panel.title || panel.y.name);
        panel.node = make("div", node);
        if (panel.isLast && panel.x.name) make("div", node, "unit under", panel.x.name);
      });
    }
    state.hint = matchMedia("(hover: hover)").matches
      ? "Point at a curve for its values. Drag to zoom, double-click for the whole." : "Tap a curve for its values.";
    state.read = make("p", box, "read", state.hint);
    new ResizeObserver(() => panels.forEach(fit)).observe(box);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => panels.forEach((p) => p.plot && p.plot.redraw()));
    paper.classList.add("replaced");
  }

  const sameX = (a, b) => a.x.lim[0] === b.x.lim[0] && a.x.lim[1] === b.x.lim[1] && !a.equal && !b.equal;

  function legend(box, state) {
    const names = new Map();
    for (const part of state.panels.flatMap((p) => p.parts)) if (part.n && !names.has(key(part))) names.set(key(part), part);
    state.names = names;
    if (!names.size) return;
    const list = make("div", box, "legend");
    for (const [id, part] of names) {
      const button = make("button", list, "");
      button.type = "button";
      button.setAttribute("aria-pressed", "true");
      const swatch = make("i", button, part.fill ? "wash" : part.d ? "" : "dots");
      const colour = part.hollow || part.c;
      swatch.style.color = colour[0] === "#" ? colour : `var(--plot-${colour})`;
      if (part.d && part.d !== "-") swatch.style.borderTopStyle = part.d === ":" ? "dotted" : "dashed";
      button.append(part.n);
      button.addEventListener("click", () => {
        const isOn = state.off.delete(id);
        if (!isOn) state.off.add(id);
        button.setAttribute("aria-pressed", String(isOn));
        state.panels.forEach((p) => p.plot && p.plot.redraw());
      });
    }
  }

  // Limits of a panel, with equal scales on both axes where the figure has them.
  function limits(panel, x = panel.x.lim, y = panel.y.lim) {
    if (!panel.equal) return [x, y];
    const [wide, high] = size(panel), inner = [wide - LEFT - RIGHT, high - TOP - BOTTOM];
    const per = Math.max((x[1] - x[0]) / inner[0], (y[1] - y[0]) / inner[1]);
    return [x, y].map((r, i) => [(r[0] + r[1] - per * inner[i]) / 2, (r[0] + r[1] + per * inner[i]) / 2]);
  }

  const size = (panel) => [
    panel.node.clientWidth, panel.high + TOP + (panel.isLast ? BOTTOM : TOP),
  ];

  function fit(panel) {
    const [width, height] = size(panel);
    if (width < 40) return;  // in a folded section
    if (!panel.plot) panel.plot = plotted(panel, width, height);
    else if (panel.plot.width !== width) panel.plot.setSize({ width, height });
    if (panel.equal) view(panel, ...limits(panel));
  }

  const sorted = (lim) => [Math.min(...lim), Math.max(...lim)];

  function view(panel, x, y) {
    panel.plot.batch(() => {
      panel.plot.setScale("x", { min: x[0], max: x[1] });
      if (y) panel.plot.setScale("y", { min: y[0], max: y[1] });
    });
  }

  function plotted(panel, width, height) {
    const [x, y] = limits(panel).map(sorted);
    const scale = (about, lim) => ({
      time: false, auto: false, distr: about.log ? 3 : 1, dir: about.lim[0] > about.lim[1] ? -1 : 1, range: () => lim,
    });
    const axis = (about, more) => ({
      stroke: () => css("plot-ink"), grid: { stroke: () => css("plot-grid"), width: 1 }, font: "12px system-ui, sans-serif",
      ticks: { stroke: () => css("plot-grid"), width: 1, size: 4 }, gap: 3, ...ticks(about), ...more,
    });
    const names = (panel.y.ticks || []).map(([, told]) => told.length);
    const scales = { x: { ...scale(panel.x, x), range: (u, low, high) => [low ?? x[0], high ?? x[1]] }, y: scale(panel.y, y) };
    const axes = [
      axis(panel.x, panel.isLast ? { size: BOTTOM } : { size: TOP, values: () => [] }),
      axis(panel.y, { size: Math.max(LEFT, 14 + 7 * Math.max(0, ...names)), space: 18 }),
    ];
    const series = [{}, { scale: "y", paths: () => null, points: { show: false } }];
    const data = [x, [null, null]];
    if (panel.y2) {
      scales.y2 = scale(panel.y2, sorted(panel.y2.lim));
      axes.push({ ...axis(panel.y2, { size: 40, side: 1 }), scale: "y2", grid: { show: false } });
      series.push({ scale: "y2", paths: () => null, points: { show: false } });
      data.push([null, null]);
    }
    const plot = new uPlot({
      width, height, scales, axes, series, padding: [TOP, panel.y2 ? 0 : RIGHT, 0, 0], legend: { show: false },
      cursor: { y: panel.parametric, drag: { x: true, y: true, uni: 30, setScale: false }, points: { show: false } },
      hooks: { draw: [(u) => draw(u, panel)], setCursor: [(u) => read(u, panel)], setSelect: [(u) => zoom(u, panel)] },
    }, data, panel.node);
    plot.over.addEventListener("dblclick", () => {
      view(panel, ...limits(panel).map(sorted));
      panel.mates.forEach((mate) => mate.plot && view(mate, sorted(mate.x.lim), sorted(mate.y.lim)));
    });
    return plot;
  }

  function ticks(about) {
    if (about.ticks) {
      const at = new Map(about.ticks);
      return { splits: () => [...at.keys()], values: (u, splits) => splits.map((v) => at.get(v) ?? "") };
    }
    return { values: (u, splits) => splits.map((v) => (v === null ? "" : tick(v - (about.off || 0)))) };
  }

  function zoom(u, panel) {
    const { left, top, width, height } = u.select;
    if (width < 4 || height < 4) return;
    const x = [u.posToVal(left, "x"), u.posToVal(left + width, "x")];
    const y = sorted([u.posToVal(top, "y"), u.posToVal(top + height, "y")]);
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    view(panel, ...limits(panel, sorted(x), y));
    panel.mates.forEach((mate) => mate.plot && view(mate, sorted(x)));
  }

  function draw(u, panel) {
    const { ctx, bbox } = u, ratio = devicePixelRatio || 1;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    for (const part of panel.parts) if (!panel.state.off.has(key(part))) drawPart(u, part, ratio);
    ctx.restore();
  }

  function drawPart(u, part, ratio) {
    const { ctx, bbox } = u, px = (v) => u.valToPos(v, "x", true), py = (v) => u.valToPos(v, part.s ? "y2" : "y", true);
    ctx.globalAlpha = part.a ?? 1;
    ctx.strokeStyle = ctx.fillStyle = shade(part.c);
    ctx.lineWidth = (part.w || 1) * POINT * ratio;
    ctx.lineJoin = "round";
    ctx.setLineDash((DASH[part.d] || []).map((v) => v * ctx.lineWidth / 1.2));
    ctx.beginPath();
    if (part.t) {
      ctx.font = `${11 * ratio}px system-ui, sans-serif`;
      ctx.textAlign = "center";
      ctx.textBaseline = part.up ? "bottom" : "top";
      ctx.fillText(part.t, px(part.x[0]), py(part.y[0]) + (part.up ? -5 : 5) * ratio);
    } else if (part.h || part.v) {
      const along = part.h ? part.h.map(py) : part.v.map(px);
      const [a, b] = [along[0], along[along.length - 1]];
      if (part.fill && part.h) ctx.fillRect(bbox.left, Math.min(a, b), bbox.width, Math.abs(b - a));
      else if (part.fill) ctx.fillRect(Math.min(a, b), bbox.top, Math.abs(b - a), bbox.height);
      else if (part.h) { ctx.moveTo(bbox.left, a); ctx.lineTo(bbox.left + bbox.width, a); ctx.stroke(); }
      else { ctx.moveTo(a, bbox.top); ctx.lineTo(a, bbox.top + bbox.height); ctx.stroke(); }
    } else {
      if (part.d || part.fill) trace(ctx, part, px, py);
      if (part.fill) ctx.fill();
      else if (part.d) ctx.stroke();
      if (part.m) dots(ctx, part, px, py, part.m * POINT * ratio / 2, ratio);
    }
    ctx.globalAlpha = 1;
    ctx.setLineDash([]);
  }

  function trace(ctx, part, px, py) {
    let down = false, last = 0;
    part.x.forEach((x, i) => {
      const y = part.y[i];
      if (x === null || y === null) { down = false; return; }
      if (down && part.step) ctx.lineTo(px(x), last);
      last = py(y);
      if (down) ctx.lineTo(px(x), last); else ctx.moveTo(px(x), last);
      down = true;
    });
  }

  function dots(ctx, part, px, py, radius, ratio) {
    ctx.setLineDash([]);
    if (part.hollow) { ctx.strokeStyle = shade(part.hollow); ctx.fillStyle = css("plot-paper"); ctx.lineWidth = 1.5 * ratio; }
    part.x.forEach((x, i) => {
      if (x === null || part.y[i] === null) return;
      ctx.beginPath();
      ctx.arc(px(x), py(part.y[i]), radius, 0, 2 * Math.PI);
      ctx.fill();
      if (part.hollow) ctx.stroke();
    });
  }

  // The sample of a curve nearest to a place in the panel, or the value that a stepped line holds there.
  function nearest(u, part, left, top, inX) {
    let best = -1, least = NEAR;
    if (inX && part.step) {
      const x = u.posToVal(left, "x");
      part.x.forEach((v, i) => { if (v !== null && v <= x) best = i; });
      return best;
    }
    part.x.forEach((v, i) => {
      if (v === null || part.y[i] === null) return;
      const dx = u.valToPos(v, "x") - left, far = inX ? Math.abs(dx) : Math.hypot(dx, u.valToPos(part.y[i], part.s ? "y2" : "y") - top);
      if (far < least) { least = far; best = i; }
    });
    return best;
  }

  function read(u, panel) {
    const { left, top } = u.cursor, { state } = panel;
    if (panel.led) return;
    const hit = left >= 0 && top >= 0;
    for (const mate of panel.mates) if (mate.plot) {
      mate.led = true;  // its line follows; the values are read here
      mate.plot.setCursor({ left: hit ? left : -10, top: hit ? 0 : -10 });
      mate.led = false;
    }
    if (!hit) { state.read.textContent = state.hint; return; }
    const shared = [panel, ...(panel.parametric ? [] : panel.mates)].filter((p) => p.plot);
    const about = shared.map((p) => p.x).find((scale) => scale.name) || panel.x;
    const at = panel.parametric ? "" : spoken(about, u.posToVal(left, "x"), each(panel, "x"), true);
    state.read.textContent = [at, ...shared.map((p) => values(p, left, top))].filter(Boolean).join(" \u00b7 ") || state.hint;
  }

  const each = (panel, axis) => Math.abs(panel.plot.scales[axis].max - panel.plot.scales[axis].min);
  const unit = (name) => (/\[([^\]]*)\]/.exec(name) || ["", ""])[1].replace(/^%.*/, "%");
  const noun = (name) => name.replace(/\s*\[.*/, "").replace(/;.*/, "");
  function spoken(about, value, range, named) {
    const near = (about.ticks || []).find(([at]) => Math.abs(at - value) < 0.5);
    if (about.ticks) return near ? near[1] : "";
    const of = unit(about.name), told = shown(value - (about.off || 0), range);
    const all = /^°|^1?$/.test(of) ? told + of.replace("1", "") : `${told}\u00a0${of}`;
    return named ? `${noun(about.name)} ${all}` : all;
  }

  function values(panel, left, top) {
    const { plot: u, state } = panel, found = new Map();
    for (const part of panel.parts) {
      if (!part.x || part.fill || part.t || state.off.has(key(part)) || part.x.length < 2) continue;
      const i = nearest(u, part, left, top, !panel.parametric);
      if (i < 0 || part.y[i] === null) continue;
      const { n = "" } = state.names.get(key(part)) || {}, y = part.s ? panel.y2 : panel.y;
      const of = noun(y.name), told = spoken(y, part.y[i], each(panel, part.s ? "y2" : "y"));
      if (panel.parametric) {
        return `${n && `${n}: `}${spoken(panel.x, part.x[i], each(panel, "x"), true)}, ${of} ${told}`;
      }
      const line = `${n === of ? "" : n} ${told}`.trim();
      if (!found.has(of)) found.set(of, new Set());
      found.get(of).add(line);
    }
    return [...found].map(([of, lines]) => `${of && `${of}: `}${[...lines].join(", ")}`).join(" \u00b7 ");
  }

  document.querySelectorAll("[data-chart]").forEach(chart);
})();
