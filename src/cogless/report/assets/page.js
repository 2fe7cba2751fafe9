"use strict";
// The page: scenarios with their plots in cards that zoom together, buttons for scenarios and controllers.
(() => {
  const report = JSON.parse(document.getElementById("data").textContent); // {controllers: [{label, colour}], scenarios}
  const hidden = new Set(); // controllers
  let chosen = 0; // scenario

  const root = document.documentElement;
  const printing = () => root.classList.contains("printing");
  const style = (name) => getComputedStyle(root).getPropertyValue(name).trim();
  const colour = (controller) => style("--c" + report.controllers[controller].colour);
  const make = (tag, parent, text = "", className = "") => {
    const element = parent.appendChild(document.createElement(tag));
    element.textContent = text;
    element.className = className;
    return element;
  };
  const number = (x) => (x == null ? "–" : Math.abs(x) >= 1e5 || (x !== 0 && Math.abs(x) < 1e-4) ? x.toExponential(2) : String(Number(x.toPrecision(4))));
  // Title and axes of a chart.
  const about = ({ title, x, quantity, unit }) => ({ title, x, y: unit ? `${quantity} (${unit})` : quantity });

  // Packed series: base64 of little-endian 16-bit integers; the lowest integer stands for a gap.
  const unpack = ({ data, scale, offset }) => {
    const text = atob(data);
    const bytes = new DataView(Uint8Array.from(text, (c) => c.charCodeAt(0)).buffer);
    return Array.from({ length: text.length / 2 }, (_, i) => {
      const integer = bytes.getInt16(2 * i, true);
      return integer === -32768 ? null : offset + scale * integer;
    });
  };

  const SOME = 24; // rows of a plot's table
  const HIGH = 360; // px of a plot
  const PAPER = 0.6; // of that on paper
  const CYCLE = 9; // px of what goes up and down once: with less, lines become a block
  const PARTS = [1, 2, 3, 4, 6, 8, 12, 18, 24, 36]; // of a revolution

  // The part of a revolution with so many cycles that a plot can show as lines.
  const legible = (cycles, width) => 1 / (PARTS.find((n) => n * width >= CYCLE * cycles) ?? PARTS.at(-1));
  const FONT = "12px system-ui, sans-serif";
  const WIDE = 7.5; // px that a character takes at most

  // A number on an axis whose numbers are so far apart: with as many digits as tell them from each other.
  const tick = (x, apart) => {
    const digits = (first) => Math.min(15, Math.max(0, 1 + Math.ceil(first - Math.log10(apart))));
    const large = Math.abs(x);
    if (large >= 1e5 || (x && apart < 1e-4)) return x.toExponential(digits(Math.log10(large))).replace(/\.?0*e\+?/, "e");
    return String(Number(x.toFixed(digits(0))));
  };
  const ticks = (u, splits, i, space, apart) => {
    const log = u.scales[u.axes[i].scale].distr === 3;
    return splits.map((x) => (x == null ? "" : log ? number(x) : tick(x, apart)));
  };

  const axis = (label, side) => ({
    label, side, labelSize: label ? 20 : 0, labelFont: FONT, font: FONT,
    size: side === 3 ? (u, texts) => Math.max(58, 14 + WIDE * Math.max(0, ...(texts ?? []).map((t) => String(t ?? "").length))) : 34,
    // Beside each other there must be room for the longest number.
    ...(side === 2 && { space: (u, i, low, high, length) => {
      const apart = Math.max(high - low, 1e-12) / Math.max(1, length / 50);
      const between = low + (high - low) / Math.E; // not round: it has every digit that a number may need
      return 16 + WIDE * Math.max(...[low, between, high].map((x) => tick(x, apart).length));
    } }),
    // Above each other, at least two: neighbouring steps differ by a factor of two or more.
    ...(side === 3 && { space: (u, i, low, high, length) => Math.min(30, length / 4) }),
    labelGap: 0, stroke: style("--soft"), values: ticks,
    grid: { stroke: style("--grid"), width: 1 }, ticks: { stroke: style("--grid"), width: 1, size: 4 },
  });

  // A scenario's part of the page, with its plots.
  function sheet(article, scenario) {
    const shown = report.scenarios[scenario];
    const zoomed = new Map(); // group of plots -> its {from, to}, kept when they are drawn anew
    let plots = [];
    let zooming = false;
    const part = (name) => article.querySelector(`[data-part="${name}"]`);

    // A card with its title, and its numbers as a table that is made when it is opened.
    // columns: headings; rows(): at most some dozens of them, numbers.
    function cardOf(parent, title, columns, rows) {
      const card = make("div", parent, "", "panel");
      const head = make("header", card);
      make("strong", head, title);
      const readout = make("span", head, "", "readout");
      const box = make("div", card, "", "plot");
      const fold = make("details", card, "", "data");
      make("summary", fold, "as a table").setAttribute("aria-label", `${title} as a table`);
      fold.ontoggle = () => {
        fold.querySelector(".scroll")?.remove();
        if (!fold.open) return;
        const scroll = make("div", fold, "", "scroll");
        Object.entries({ tabindex: 0, role: "region", "aria-label": `${title} as a table` }).forEach(([k, v]) => scroll.setAttribute(k, v));
        const table = make("table", scroll, "", "numbers");
        const row = (group, tag, cells) => {
          const line = make("tr", group);
          cells.forEach((c, i) => make(i ? tag : "th", line, typeof c === "string" ? c : number(c)).setAttribute("scope", tag === "th" ? "col" : i ? "" : "row"));
        };
        row(make("thead", table), "th", columns);
        const body = make("tbody", table);
        for (const cells of rows()) row(body, "td", cells);
      };
      return { card, readout, box };
    }

    // A card with a canvas of its own; paint(context, width, height) in CSS pixels.
    function canvas(parent, { title, height, paint, columns, rows }) {
      const { card, box } = cardOf(parent, title, columns, rows);
      const element = make("canvas", box);
      element.setAttribute("role", "img");
      element.setAttribute("aria-label", title);
      const u = {
        height, destroy() {}, setSeries() {}, setScale() {},
        setSize({ width }) {
          const px = devicePixelRatio;
          Object.assign(element, { width: width * px, height: height * px });
          Object.assign(element.style, { width: `${width}px`, height: `${height}px`, display: "block" });
          u.redraw();
        },
        redraw() {
          const ctx = element.getContext("2d"), px = devicePixelRatio;
          ctx.setTransform(px, 0, 0, px, 0, 0);
          ctx.clearRect(0, 0, element.width, element.height);
          paint(ctx, element.width / px, height);
        },
      };
      plots.push({ u, card, box, series: [], group: null, least: 0, title });
      u.setSize({ width: box.clientWidth });
    }

    // One plot in a card: a title, the values under the cursor, the axes with their units. A series has `values` and a
    // `controller` (`fade`: 0 to 1, how much of its colour), or a `stroke` of its own; `label`: its name beside the value.
    // `least`: px below which it scrolls sideways instead. `adapt` may change uPlot's options.
    function panel(parent, { title, x, y, xs, series, height = HIGH, least = 0, group = null, readX = number, cursor = {}, adapt = () => {}, columns = null, rows = null }) {
      const names = () => [x, ...series.map((s) => [s.controller == null ? "" : report.controllers[s.controller].label, s.label || ""].filter(Boolean).join(", ") || y)];
      const { card, readout, box } = cardOf(parent, title, columns ?? names(), rows ?? (() => someRows(u)));
      const faded = (s) => colour(s.controller) + (s.fade == null ? "" : Math.round(255 * s.fade).toString(16).padStart(2, "0"));
      const stroke = (s) => s.stroke ?? (s.controller == null ? style("--ink") : faded(s));
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
        width: box.clientWidth, height: printing() ? PAPER * height : height,
        legend: { show: false },
        cursor: { y: false, sync: group == null ? undefined : { key: `${scenario} ${group}`, setSeries: false, scales: ["x", null] }, drag: { x: true, y: false }, points: { show: true }, ...cursor },
        scales: { x: { time: false }, y: {} },
        axes: [axis(x, 2), axis(y, 3)],
        series: [{}, ...series.map((s) => ({
          stroke: stroke(s), width: s.width ?? (s.dash && s.controller != null ? 1 : 1.4), dash: s.dash ? [5, 4] : undefined,
          points: { show: false }, show: !hidden.has(s.controller), spanGaps: false,
        }))],
        hooks: { setCursor: [show], setScale: [zoom], drawClear: [], draw: [] },
      };
      adapt(options);
      const u = new uPlot(options, [xs, ...series.map((s) => s.values)], box);
      u.over.addEventListener("dblclick", () => u.setScale("x", { min: u.data[0][0], max: u.data[0].at(-1) }));
      plots.push({ u, card, box, series, group, least, title });
      return u;
    }

    // Some of the rows that a plot shows, evenly.
    function someRows(u) {
      const [from, to] = u.series[0].idxs ?? [0, u.data[0].length - 1];
      const every = Math.max(1, Math.ceil((to - from + 1) / SOME));
      const found = [];
      for (let i = from; i <= to; i += every) found.push(u.data.map((column) => column[i]));
      return found;
    }

    // Show a part of all plots of a group.
    const zoomTo = (group, { from, to }) => plots.find((p) => p.group === group)?.u.setScale("x", { min: from, max: to });

    // Buttons of a section for parts of a group's plots.
    function zoomButtons(section, group, zooms) {
      const buttons = section.querySelector(".zooms");
      buttons.textContent = "";
      for (const z of zooms) make("button", buttons, z.name).onclick = () => zoomTo(group, z);
    }

    // Remove the plots in `parent`, or all of them.
    function clear(parent = article) {
      plots = plots.filter(({ u, card }) => {
        const gone = parent.contains(card);
        if (gone) u.destroy();
        return !gone;
      });
      const cards = parent === article ? article.querySelectorAll(".panels") : [parent];
      for (const element of cards) element.textContent = "";
    }

    // The scenario's answer: a revolution, or a trial, before and after; then what is left over the time.
    function answer(charts, options = () => ({})) {
      const section = part("answer"), parent = section.querySelector(".panels");
      charts.forEach((chart, i) => {
        const series = chart.series.map((s, k) => ({ ...s, width: i || !k ? 1.5 : 2.2, values: Array.isArray(s.values) ? s.values : unpack(s.values) }));
        const count = Math.max(...series.map((s) => s.values.length));
        for (const s of series) while (s.values.length < count) s.values.push(null);
        const xs = Array.from({ length: count }, (_, k) => chart.start + k * chart.step);
        panel(parent, { ...about(chart), xs, series, group: `answer${i}`, readX: (x) => `${Number(x.toPrecision(5))} ${chart.about}`, ...options(chart, i, series) });
      });
      const share = turnShown();
      section.querySelector(".zooms").textContent = "";
      if (!charts[0]?.cycles) return;
      const end = charts[0].start + charts[0].step * (unpack(charts[0].series[0].values).length - 1), some = { from: 0, to: end * Math.min(share, 1 / 6) };
      zoomButtons(section, "answer0", [{ name: "one revolution", from: 0, to: end }, { name: `${number(some.to)}°`, ...some }]);
      const first = zoomed.get("answer0") ?? (share < 1 && { from: 0, to: end * share });
      if (first) zoomTo("answer0", first);
    }

    // The part of a revolution that is shown first.
    const turnShown = () => legible(shown.answer?.[0]?.cycles ?? 0, article.clientWidth - 90);

    function redraw() {
      clear();
      answer(shown.answer ?? [], draw[shown.kind].options?.(shown));
      draw[shown.kind](shown, self);
      resize();
    }

    function resize() {
      for (const { u, box, least, title } of plots) {
        const room = box.clientWidth;
        const scrolls = least > room && !printing(); // paper doesn't scroll
        u.setSize({ width: scrolls ? least : room, height: u.height });
        if (scrolls) Object.entries({ tabindex: 0, role: "region", "aria-label": title }).forEach(([k, v]) => box.setAttribute(k, v));
        else ["tabindex", "role", "aria-label"].forEach((k) => box.removeAttribute(k));
      }
    }

    // Redraw after a controller was shown or hidden.
    function toggle(controller) {
      for (const { u, series } of plots) {
        series.forEach((s, k) => { if (s.controller === controller) u.setSeries(k + 1, { show: !hidden.has(controller) }); });
        u.redraw();
      }
    }

    const self = { article, shown, part, turnShown, panel, canvas, zoomed, zoomTo, zoomButtons, clear, redraw, resize, toggle };
    return self;
  }

  const page = { report, hidden, style, colour, make, about, number, unpack };
  const draw = { speed: speedPlots(page), trials: trialsPlots(page), sweep: sweepPlots(page) };
  const sheets = [...document.querySelectorAll("article.scenario")].map(sheet);

  function select(index) {
    sheets[chosen].clear();
    chosen = index;
    document.querySelectorAll(".tabs button").forEach((b, i) => b.setAttribute("aria-pressed", i === index));
    sheets.forEach(({ article }, i) => { article.hidden = i !== index; });
    document.querySelectorAll(".bar .chips button").forEach((chip, i) => { chip.hidden = !sheets[index].shown.controllers.includes(i); });
    sheets[index].redraw();
  }

  // Paper has all scenarios, at its own width and in light colours.
  function print(on) {
    root.classList.toggle("printing", on);
    sheets.forEach((sheet, i) => (on || i === chosen ? sheet.redraw() : sheet.clear()));
  }

  function begin() {
    if (!sheets.length) return;
    document.querySelectorAll("[data-select]").forEach((b) => { b.onclick = () => select(Number(b.dataset.select)); });
    document.querySelectorAll(".bar .chips button").forEach((button, controller) => {
      button.onclick = () => {
        hidden.has(controller) ? hidden.delete(controller) : hidden.add(controller);
        button.setAttribute("aria-pressed", !hidden.has(controller));
        sheets[chosen].toggle(controller);
      };
    });
    addEventListener("resize", () => sheets[chosen].resize());
    addEventListener("beforeprint", () => print(true));
    addEventListener("afterprint", () => print(false));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => sheets[chosen].redraw());
    select(0);
  }

  begin();
})();
