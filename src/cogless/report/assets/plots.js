"use strict";
// What the reports share: plots in cards that zoom together, buttons for scenarios and controllers.
// `report`: {controllers: [{label, colour}], scenarios}; `draw` draws the chosen scenario.
const reportPage = (report, draw) => {
  const hidden = new Set(); // controllers
  const zoomed = new Map(); // group of plots -> its {from, to}, kept when they are drawn anew
  let scenario = 0;
  let plots = [];
  let zooming = false;

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
  const quantity = (name, unit) => (unit ? `${name} (${unit})` : name);

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

  // One plot in a card: a title, the values under the cursor, the axes with their units. A series has `values` and a
  // `controller` (`fade`: 0 to 1, how much of its colour), or a `stroke` of its own; `label`: its name beside the value. `adapt` may change uPlot's options.
  function panel(parent, { title, x, y, xs, series, height = 180, group = null, readX = number, cursor = {}, adapt = () => {} }) {
    const card = make("div", parent, "", "panel");
    const head = make("header", card);
    make("strong", head, title);
    const readout = make("span", head, "", "readout");
    const faded = (s) => colour(s.controller) + (s.fade == null ? "" : Math.round(255 * s.fade).toString(16).padStart(2, "0"));
    const stroke = (s) => s.stroke ?? (s.controller == null ? style("--soft") : faded(s));
    const show = (u) => {
      readout.textContent = "";
      const i = u.cursor.idx;
      if (i == null) return;
      make("span", readout, readX(xs[i]));
      const inOrder = series.map((s, k) => [s, k]).sort(([a], [b]) => (a.controller ?? -1) - (b.controller ?? -1));
      inOrder.forEach(([s, k]) => {
        if (!u.series[k + 1].show) return;
        const value = number(u.data[k + 1][i]);
        const text = s.label ? `${s.label} ${value}` : value;
        make("span", readout, text, s.controller == null && !s.stroke ? "" : "key").style.setProperty("--colour", stroke(s));
      });
    };
    const zoom = (u, key) => {
      if (key !== "x" || group == null || zooming) return;
      zooming = true;
      const { min, max } = u.scales.x;
      zoomed.set(group, { from: min, to: max });
      for (const other of plots) if (other.group === group && other.u !== u) other.u.setScale("x", { min, max });
      zooming = false;
    };
    const options = {
      width: card.clientWidth - 16, height,
      legend: { show: false },
      cursor: { y: false, sync: group == null ? undefined : { key: group, setSeries: false, scales: ["x", null] }, drag: { x: true, y: false }, points: { show: true }, ...cursor },
      scales: { x: { time: false }, y: {} },
      axes: [axis(x, 2), axis(y, 3)],
      series: [{}, ...series.map((s) => ({
        stroke: stroke(s), width: s.width ?? (s.dash ? 1 : 1.4), dash: s.dash ? [5, 4] : undefined,
        points: { show: false }, show: !hidden.has(s.controller), spanGaps: false,
      }))],
      hooks: { setCursor: [show], setScale: [zoom], drawClear: [], draw: [] },
    };
    adapt(options);
    const u = new uPlot(options, [xs, ...series.map((s) => s.values)], card);
    u.over.addEventListener("dblclick", () => u.setScale("x", { min: u.data[0][0], max: u.data[0].at(-1) }));
    plots.push({ u, card, series, group });
    return u;
  }

  // Show a part of all plots of a group.
  const zoomTo = (group, { from, to }) => plots.find((p) => p.group === group)?.u.setScale("x", { min: from, max: to });

  // Remove the plots in `parent`, or all of them.
  function clear(parent = document) {
    plots = plots.filter(({ u, card }) => {
      const gone = parent.contains(card);
      if (gone) u.destroy();
      return !gone;
    });
    const cards = parent === document ? document.querySelectorAll(".panels") : [parent];
    for (const element of cards) element.textContent = "";
  }

  function redraw() {
    clear();
    const shown = report.scenarios[scenario];
    if (!shown) return;
    document.querySelectorAll(".bar .chips button").forEach((chip, i) => { chip.hidden = !shown.controllers.includes(i); });
    draw(shown);
    resize();
  }

  function resize() {
    for (const { u, card } of plots) u.setSize({ width: card.clientWidth - 16, height: u.height });
  }

  function select(index) {
    scenario = index;
    zoomed.clear();
    document.querySelectorAll(".tabs button").forEach((b, i) => b.setAttribute("aria-pressed", i === index));
    document.querySelectorAll(".scenario").forEach((e) => { e.hidden = Number(e.dataset.scenario) !== index; });
    redraw();
  }

  function begin() {
    document.querySelectorAll("[data-select]").forEach((b) => { b.onclick = () => select(Number(b.dataset.select)); });
    document.querySelectorAll(".bar .chips button").forEach((button, controller) => {
      button.onclick = () => {
        hidden.has(controller) ? hidden.delete(controller) : hidden.add(controller);
        button.setAttribute("aria-pressed", !hidden.has(controller));
        for (const { u, series } of plots) {
          series.forEach((s, k) => { if (s.controller === controller) u.setSeries(k + 1, { show: !hidden.has(controller) }); });
          u.redraw();
        }
      };
    });
    addEventListener("resize", resize);
    addEventListener("beforeprint", resize);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
    select(0);
  }

  return { $, style, colour, make, number, quantity, unpack, panel, zoomed, zoomTo, hidden, clear, redraw, resize, begin };
};
