"use strict";
(() => {
  const report = JSON.parse(document.getElementById("data").textContent);
  const hidden = new Set();
  let scenario = 0;
  let plots = [];
  let zooming = false;
  let view = null; // the zoom of the waveforms, kept when they are drawn anew

  const $ = (selector) => document.querySelector(selector);
  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const colour = (controller) => style("--c" + report.controllers[controller].colour);
  const make = (tag, parent, text = "", className = "") => {
    const element = parent.appendChild(document.createElement(tag));
    element.textContent = text;
    element.className = className;
    return element;
  };
  const number = (x) => (x == null ? "–" : Math.abs(x) >= 1e5 || (x !== 0 && Math.abs(x) < 1e-4) ? x.toExponential(2) : String(Number(x.toPrecision(4))));

  // Packed series: base64 of little-endian 16-bit integers; the lowest integer stands for a gap.
  const unpack = ({ data, scale, offset }) => {
    const text = atob(data);
    const bytes = new DataView(Uint8Array.from(text, (c) => c.charCodeAt(0)).buffer);
    return Array.from({ length: text.length / 2 }, (_, i) => {
      const integer = bytes.getInt16(2 * i, true);
      return integer === -32768 ? null : offset + scale * integer;
    });
  };

  const axis = (label, side) => ({
    label, side, labelSize: label ? 20 : 0, labelFont: "12px system-ui, sans-serif", font: "12px system-ui, sans-serif",
    size: side === 3 ? 58 : 34, labelGap: 0, stroke: style("--soft"),
    grid: { stroke: style("--grid"), width: 1 }, ticks: { stroke: style("--grid"), width: 1, size: 4 },
    ...(side === 3 && { values: (_, ticks) => ticks.map((tick) => (tick == null ? "" : number(tick))) }),
  });

  // One plot in a card: a title, the values under the cursor, the axes with their units.
  function panel(parent, { title, x, y, xs, series, height = 180, bars = false, group = null, readX = number }) {
    const card = make("div", parent, "", "panel");
    const head = make("header", card);
    make("strong", head, title);
    const readout = make("span", head, "", "readout");
    const show = (u) => {
      readout.textContent = "";
      const i = u.cursor.idx;
      if (i == null) return;
      make("span", readout, readX(xs[i]));
      const inOrder = series.map((s, k) => [s, k]).sort(([a], [b]) => (a.controller ?? -1) - (b.controller ?? -1));
      inOrder.forEach(([s, k]) => {
        if (!u.series[k + 1].show) return;
        const value = number(u.data[k + 1][i]);
        if (s.dash) make("span", readout, `reference ${value}`);
        else make("span", readout, value, "key").style.setProperty("--colour", colour(s.controller));
      });
    };
    const zoom = (u, key) => {
      if (key !== "x" || group == null || zooming) return;
      zooming = true;
      const { min, max } = u.scales.x;
      if (group === "time") view = { from: min, to: max };
      for (const other of plots) if (other.group === group && other.u !== u) other.u.setScale("x", { min, max });
      zooming = false;
    };
    const options = {
      width: card.clientWidth - 16, height,
      legend: { show: false },
      cursor: { y: false, sync: group == null ? undefined : { key: group, setSeries: false, scales: ["x", null] }, drag: { x: !bars, y: false }, points: { show: !bars } },
      scales: { x: { time: false, ...(bars && { range: () => [-0.6, xs.length - 0.4] }) }, y: bars ? barScale(series) : {} },
      axes: [axis(x, 2), axis(y, 3)],
      series: [{}, ...series.map((s) => ({
        stroke: s.dash ? style("--soft") : colour(s.controller), width: s.dash ? 1 : 1.4, dash: s.dash ? [5, 4] : undefined,
        points: { show: false }, paths: bars ? () => null : undefined, show: s.dash || !hidden.has(s.controller), spanGaps: false,
      }))],
      hooks: { setCursor: [show], setScale: [zoom], draw: bars ? [(u) => drawBars(u, series)] : [] },
    };
    if (bars) {
      options.axes[0].splits = () => xs.map((_, i) => i);
      options.axes[0].values = (u, splits) => {
        const every = Math.ceil(24 / (u.over.clientWidth / xs.length || 24));
        return splits.map((i) => (i % every ? "" : xs[i]));
      };
      options.axes[0].grid.show = false;
    }
    const u = new uPlot(options, [bars ? xs.map((_, i) => i) : xs, ...series.map((s) => s.values)], card);
    u.over.addEventListener("dblclick", () => u.setScale("x", { min: u.data[0][0], max: u.data[0].at(-1) }));
    plots.push({ u, card, series, group });
  }

  function barScale(series) {
    const values = series.flatMap((s) => [...s.values, ...(s.early ?? [])]).filter((v) => v > 0);
    const top = Math.max(...values, 1e-12);
    if (!$("#log").checked) return { range: () => [0, 1.08 * top] };
    return { distr: 3, range: () => [Math.max(Math.min(...values), 1e-4 * top) / 1.5, 1.5 * top] };
  }

  // A group of bars for each order; a hollow tick where the controller began.
  function drawBars(u, series) {
    const { ctx } = u;
    const shown = series.filter((s) => !hidden.has(s.controller));
    const slot = u.valToPos(1, "x", true) - u.valToPos(0, "x", true);
    const width = Math.min((0.78 * slot) / Math.max(1, shown.length), 26 * devicePixelRatio);
    const floor = u.bbox.top + u.bbox.height;
    const height = (value) => Math.min(floor, u.valToPos(Math.max(value, u.scales.y.min), "y", true));
    ctx.save();
    shown.forEach((s, k) => {
      ctx.fillStyle = ctx.strokeStyle = colour(s.controller);
      ctx.lineWidth = 1.5 * devicePixelRatio;
      s.values.forEach((value, i) => {
        const left = u.valToPos(i, "x", true) + (k - shown.length / 2) * width;
        if (value > 0) ctx.fillRect(left, height(value), width - devicePixelRatio, floor - height(value));
        if (s.early?.[i] > 0) ctx.strokeRect(left, height(s.early[i]), width - devicePixelRatio, 0);
      });
    });
    ctx.restore();
  }

  const lines = (list) => list.map((s) => ({ ...s, values: unpack(s.values), detail: s.detail && unpack(s.detail) }));
  const longest = (series) => Math.max(...series.map((s) => s.values.length));
  const padded = (series, length) => {
    for (const s of series) while (s.values.length < length) s.values.push(null);
    return series;
  };

  function drawTimes(parent, chart, group, options = {}) {
    const decoded = chart.panels.map((p) => ({ ...p, series: lines(p.series) }));
    const length = Math.max(...decoded.map((p) => longest(p.series)));
    const grid = ({ start, step }, count) => Array.from({ length: count }, (_, i) => start + i * step);
    let xs = grid(chart, length);
    for (const p of decoded) padded(p.series, length);
    if (chart.detail) { // the last part has finer points
      const kept = xs.filter((x) => x < chart.detail.start).length;
      const fine = Math.max(...decoded.flatMap((p) => p.series.map((s) => s.detail.length)));
      xs = [...xs.slice(0, kept), ...grid(chart.detail, fine)];
      for (const p of decoded) for (const s of p.series) s.values = [...s.values.slice(0, kept), ...s.detail];
    }
    decoded.forEach((p, i) => panel(parent, {
      title: p.title, x: i === decoded.length - 1 || options.grid ? chart.x : "", y: `${p.quantity} (${p.unit})`, xs, series: padded(p.series, xs.length), group,
      readX: (t) => `${t.toFixed(4)} s`, ...options,
    }));
  }

  function draw() {
    const wanted = view;
    for (const { u } of plots) u.destroy();
    plots = [];
    for (const parent of document.querySelectorAll(".panels")) parent.textContent = "";
    const shown = report.scenarios[scenario];
    if (!shown) return;
    document.querySelectorAll(".chips button").forEach((chip, i) => { chip.hidden = !shown.controllers.includes(i); });

    drawTimes($("#waveforms .panels"), shown.waveforms, "time");
    const zooms = $(".zooms");
    zooms.textContent = "";
    const zoom = ({ from, to }) => plots.find((p) => p.group === "time")?.u.setScale("x", { min: from, max: to });
    for (const z of shown.zooms) make("button", zooms, z.name).onclick = () => zoom(z);
    const named = (name) => shown.zooms.find((z) => z.name === name);
    const first = wanted ?? shown.zooms.find((z) => z.first) ?? named("after start-up") ?? shown.zooms[0];
    if (first) zoom(first);

    $("#spectra").hidden = !shown.spectra.length;
    for (const s of shown.spectra)
      panel($("#spectra .panels"), {
        title: s.title, x: s.x, y: `${s.quantity} (${s.unit})`, xs: s.orders, series: s.series, bars: true, height: 230, readX: (n) => `order ${n}`,
      });

    $("#map").hidden = !shown.maps.length;
    for (const m of shown.maps)
      panel($("#map .panels"), {
        title: m.title, x: m.x, y: "current (A)", xs: m.angle, series: m.series, height: 230, readX: (a) => `${number(a)}°`,
      });

    $("#events").hidden = !shown.events.length;
    shown.events.forEach((e, i) => drawTimes($("#events .panels"), e, "event" + i, { height: 210, grid: true }));
    resize();
  }

  function resize() {
    for (const { u, card } of plots) u.setSize({ width: card.clientWidth - 16, height: u.height });
  }

  function select(index) {
    scenario = index;
    view = null;
    document.querySelectorAll(".tabs button").forEach((b, i) => b.setAttribute("aria-pressed", i === index));
    document.querySelectorAll(".scenario").forEach((e) => { e.hidden = Number(e.dataset.scenario) !== index; });
    draw();
  }

  document.querySelectorAll("[data-select]").forEach((b) => { b.onclick = () => select(Number(b.dataset.select)); });
  document.querySelectorAll(".chips button").forEach((button, controller) => {
    button.onclick = () => {
      hidden.has(controller) ? hidden.delete(controller) : hidden.add(controller);
      button.setAttribute("aria-pressed", !hidden.has(controller));
      for (const { u, series } of plots) {
        series.forEach((s, k) => { if (!s.dash && s.controller === controller) u.setSeries(k + 1, { show: !hidden.has(controller) }); });
        u.redraw();
      }
    };
  });
  $("#log").onchange = draw;
  addEventListener("resize", resize);
  addEventListener("beforeprint", resize);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  select(0);
})();
