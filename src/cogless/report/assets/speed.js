"use strict";
// Plots of a scenario of speed; `page`: what every scenario's plots share.
const speedPlots = (page) => {
  const { about, colour, number, unpack, hidden } = page;
  const BAR = 3; // px, at least
  const AXES = 80; // px beside a plot, about
  const SHRINKS = 10; // times: from there on a log axis
  const FILLED = 0.78; // of an order's place by its bars

  // Groups of bars over names, such as orders, in place of lines over numbers.
  function bars(sheet, parent, { xs, series, ...options }) {
    sheet.panel(parent, {
      ...options, xs: xs.map((_, i) => i), series, readX: (i) => options.readX(xs[i]), cursor: { drag: { x: false, y: false }, points: { show: false } },
      least: AXES + xs.length * Math.max(24, (BAR * series.length) / FILLED),
      adapt: (o) => {
        o.scales.x.range = () => [-0.6, xs.length - 0.4];
        o.scales.y = barScale(series, sheet.article.querySelector(".log").checked);
        for (const s of o.series.slice(1)) s.paths = () => null;
        o.hooks.draw.push((u) => drawBars(u, series));
        o.axes[0].splits = () => xs.map((_, i) => i);
        o.axes[0].values = (u, splits) => {
          const wide = 8 + 7.5 * String(xs.at(-1)).length;
          const every = Math.ceil((wide * xs.length) / (u.width - AXES));
          return splits.map((i) => (i % every ? "" : xs[i]));
        };
        o.axes[0].grid.show = false;
      },
    });
  }

  function barScale(series, log) {
    const values = series.flatMap((s) => [...s.values, ...(s.early ?? [])]).filter((v) => v > 0);
    const top = Math.max(...values, 1e-12);
    if (!log) return { range: () => [0, 1.08 * top] };
    return { distr: 3, range: () => [Math.max(Math.min(...values), 1e-4 * top) / 1.5, 1.5 * top] };
  }

  // A group of bars for each order; a hollow tick where the controller began.
  function drawBars(u, series) {
    const { ctx } = u;
    const shown = series.filter((s) => !hidden.has(s.controller));
    const slot = u.valToPos(1, "x", true) - u.valToPos(0, "x", true);
    const width = Math.min((FILLED * slot) / Math.max(1, shown.length), 26 * devicePixelRatio);
    const bar = width - Math.min(devicePixelRatio, width / 4);
    const floor = u.bbox.top + u.bbox.height;
    const height = (value) => Math.min(floor, u.valToPos(Math.max(value, u.scales.y.min), "y", true));
    ctx.save();
    shown.forEach((s, k) => {
      ctx.fillStyle = ctx.strokeStyle = colour(s.controller);
      ctx.lineWidth = 1.5 * devicePixelRatio;
      s.values.forEach((value, i) => {
        const left = u.valToPos(i, "x", true) + (k - shown.length / 2) * width;
        if (value > 0) ctx.fillRect(left, height(value), bar, floor - height(value));
        if (s.early?.[i] > 0) ctx.strokeRect(left, height(s.early[i]), bar, 0);
      });
    });
    ctx.restore();
  }

  const lines = (list) => list.map((s) => ({ ...s, label: s.dash && (s.label ?? "reference"), values: unpack(s.values), details: s.details.map(unpack) }));
  const longest = (series) => Math.max(...series.map((s) => s.values.length));
  const padded = (series, length) => {
    for (const s of series) while (s.values.length < length) s.values.push(null);
    return series;
  };

  function drawTimes(sheet, parent, chart, group, options = () => ({})) {
    const decoded = chart.panels.map((p) => ({ ...p, series: lines(p.series) }));
    const length = Math.max(...decoded.map((p) => longest(p.series)));
    const grid = ({ start, step }, count) => Array.from({ length: count }, (_, i) => start + i * step);
    let xs = grid(chart, length);
    for (const p of decoded) padded(p.series, length);
    for (const [k, fine] of chart.details.entries()) { // parts with finer points, in order of time
      const at = grid(fine, Math.max(...decoded.flatMap((p) => p.series.map((s) => s.details[k].length))));
      const from = xs.findIndex((x) => x >= at[0]);
      const until = xs.findIndex((x) => x > at.at(-1));
      const joined = (list, part) => [...list.slice(0, from < 0 ? list.length : from), ...part, ...(until < 0 ? [] : list.slice(until))];
      for (const p of decoded) for (const s of p.series) s.values = joined(s.values, s.details[k]);
      xs = joined(xs, at);
    }
    decoded.forEach((p, i) => sheet.panel(parent, {
      ...about({ x: chart.x, ...p }), xs, series: padded(p.series, xs.length), group,
      readX: (t) => `${t.toFixed(4)} s`, ...options(i),
    }));
    return xs;
  }

  const LABELS = 20; // px above a plot, for names

  // Draws within a plot's axes and so far above them.
  const within = (u, paint, above = 0) => {
    const { ctx, bbox } = u;
    const top = above * devicePixelRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top - top, bbox.width, bbox.height + top);
    ctx.clip();
    ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    ctx.textBaseline = "alphabetic";
    paint(ctx, bbox, devicePixelRatio);
    ctx.restore();
  };

  // Marks of what broke: its time shaded, and if `named` its name above.
  const shade = (marks, named) => (o) => {
    const place = (u, { from, to }) => {
      const left = u.valToPos(from, "x", true);
      return [left, Math.max(u.valToPos(to, "x", true) - left, 2 * devicePixelRatio)];
    };
    o.hooks.drawClear.push((u) => within(u, (ctx, bbox) => {
      ctx.fillStyle = page.style("--broken");
      for (const mark of marks) {
        const [left, width] = place(u, mark);
        ctx.fillRect(left, bbox.top, width, bbox.height);
      }
    }));
    if (!named || !marks.length) return;
    o.padding = [LABELS, null, null, null];
    o.hooks.draw.push((u) => within(u, (ctx, bbox, px) => {
      const right = bbox.left + bbox.width;
      ctx.fillStyle = page.style("--bad");
      let free = 0; // up to where names stand already
      for (const mark of marks) {
        const [left, width] = place(u, mark);
        if (left > right || left + width < bbox.left) continue;
        const { width: long } = ctx.measureText(mark.label);
        const start = Math.max(bbox.left, Math.min(left, right - long));
        if (start < free) continue;
        ctx.fillText(mark.label, start, bbox.top - 6 * px);
        free = start + long + 8 * px;
      }
    }, LABELS));
  };

  // Lanes of the controllers' states: a lane for each state, with a bar for each controller while it held.
  function drawStrip(sheet, parent, lanes, xs, marks) {
    const count = Math.max(...lanes.map((l) => l.runs.length));
    const [name, bar] = [16, 6];
    const lane = name + bar * count + 4;
    sheet.panel(parent, {
      title: "Status of the controllers: when each state held", x: "time (s)", y: " ", xs, series: [], height: lanes.length * lane + 72, group: "time", readX: (t) => `${t.toFixed(4)} s`,
      adapt: (o) => {
        o.scales.y.range = () => [0, 1];
        o.axes[1].values = (_, ticks) => ticks.map(() => "");
        o.axes[1].grid.show = o.axes[1].ticks.show = false;
        shade(marks, false)(o);
        o.hooks.draw.push((u) => within(u, (ctx, bbox, px) => lanes.forEach((l, k) => {
          const top = bbox.top + k * lane * px;
          ctx.fillStyle = page.style("--soft");
          ctx.fillText(l.name, bbox.left + 4 * px, top + 12 * px);
          l.runs.filter((r) => !hidden.has(r.controller)).forEach(({ controller, spans }, row) => {
            ctx.fillStyle = colour(controller);
            for (let i = 0; i < spans.length; i += 2) {
              const left = u.valToPos(spans[i], "x", true);
              const width = Math.max(u.valToPos(spans[i + 1], "x", true) - left, px);
              ctx.fillRect(left, top + (name + bar * row) * px, width, (bar - 2) * px);
            }
          });
        })));
      },
    });
  }

  const overFrequency = (o) => {
    o.scales.x.distr = 3;
    o.axes[0].values = (_, ticks) => ticks.map((f) => (f != null && Math.abs(Math.log10(f) % 1) < 1e-6 ? number(f) : ""));
  };

  // Factors over frequency against one, and upright lines where something grew.
  function drawCriterion(sheet, parent, chart) {
    const { frequency, series, marks } = chart;
    const one = { values: frequency.map(() => 1), dash: true, label: "limit" };
    sheet.panel(parent, {
      ...about(chart), xs: frequency, series: [...series, one], readX: (f) => `${number(f)} Hz`,
      adapt: (o) => {
        overFrequency(o);
        o.hooks.draw.push((u) => {
          const { ctx, bbox } = u;
          ctx.save();
          for (const { controller, at } of marks.filter((m) => !hidden.has(m.controller))) {
            const x = u.valToPos(at, "x", true);
            ctx.strokeStyle = ctx.fillStyle = colour(controller);
            ctx.lineWidth = 1.5 * devicePixelRatio;
            ctx.beginPath();
            ctx.moveTo(x, bbox.top);
            ctx.lineTo(x, bbox.top + bbox.height);
            ctx.stroke();
            ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
            ctx.textAlign = "right";
            ctx.fillText(`grew: ${number(at)} Hz`, x - 5 * devicePixelRatio, bbox.top + 14 * devicePixelRatio);
          }
          ctx.restore();
        });
      },
    });
  }

  const DECADES = 2; // of the waterfall's colours

  // Cells of amplitude by order and speed in the controller's colour, fuller for larger ones.
  function drawWaterfall(sheet, parent, chart) {
    const { controller, speeds, orders, top } = chart;
    const values = unpack(chart.values);
    const edges = [speeds[0], ...speeds.slice(1).map((v, i) => (v + speeds[i]) / 2), speeds.at(-1)];
    sheet.panel(parent, {
      ...about(chart), title: page.report.controllers[controller].label, xs: Array.from({ length: orders }, (_, i) => i + 1), series: [],
      readX: (n) => `order ${n}`, cursor: { drag: { x: false, y: false } },
      rows: () => speeds.map((v, i) => {
        const row = values.slice(i * orders, (i + 1) * orders);
        const most = Math.max(...row);
        return [v, row.indexOf(most) + 1, most];
      }), columns: [`speed (${chart.unit})`, "strongest order", `amplitude (${chart.unit})`],
      adapt: (o) => {
        o.scales.x.range = () => [0.5, orders + 0.5];
        o.scales.y.range = () => [speeds[0], speeds.at(-1)];
        o.axes[0].grid.show = o.axes[1].grid.show = false;
        o.hooks.draw.push((u) => within(u, (ctx) => {
          if (hidden.has(controller)) return;
          ctx.fillStyle = colour(controller);
          const x = (n) => u.valToPos(n, "x", true), y = (i) => u.valToPos(edges[i], "y", true);
          values.forEach((v, k) => {
            const level = v > 0 ? 1 + Math.log10(v / top) / DECADES : 0;
            if (level <= 0) return;
            const [i, n] = [Math.floor(k / orders), (k % orders) + 1];
            ctx.globalAlpha = Math.min(1, level);
            ctx.fillRect(x(n - 0.5), y(i + 1), Math.max(1, x(n + 0.5) - x(n - 0.5)), y(i) - y(i + 1) + 1);
          });
        }));
      },
    });
  }

  // Log axes whose lower end is a share of the largest value.
  const logY = (series, share) => (o) => {
    const top = Math.max(...series.flatMap((s) => s.values.filter((v) => v > 0)), 1e-12);
    const low = Math.max(top * share, Math.min(...series.flatMap((s) => s.values.filter((v) => v > 0)), top / 10));
    o.scales.y = { distr: 3, range: () => uPlot.rangeLog(low, top, 10, false) };
  };

  const TURN = 2 * Math.PI;

  // A current around the circle: its mean as a line, its least and largest as a band; the middle circle is zero.
  function drawPolar(sheet, parent, chart) {
    const { series, unit, title } = chart;
    const most = Math.max(...series.flatMap((s) => [...s.low, ...s.high]).map(Math.abs), 1e-12);
    const top = Number((1.05 * most).toPrecision(2));
    const label = (x) => `${number(x)} ${unit}`;
    sheet.canvas(parent, {
      title, height: 400, columns: ["angle (°)", ...series.flatMap((s) => ["mean", "least", "largest"].map((w) => `${page.report.controllers[s.controller].label}, ${w} (${unit})`))],
      rows: () => series[0].values.map((_, i) => [i, ...series.flatMap((s) => [s.values[i], s.low[i], s.high[i]])]).filter((_, i) => i % 15 === 0),
      paint: (ctx, width, height) => {
        const [cx, cy, reach] = [width / 2, (height - 50) / 2, Math.min(width, height - 50) / 2 - 34];
        const radius = (v) => reach * (0.55 + (0.45 * v) / top);
        const at = (i, v) => [cx + radius(v) * Math.cos((i / 360) * TURN), cy - radius(v) * Math.sin((i / 360) * TURN)];
        const trace = (values, back) => values.forEach((_, k) => {
          const i = back ? values.length - 1 - k : k;
          ctx[k || back ? "lineTo" : "moveTo"](...at(i, values[i]));
        });
        ctx.font = "12px system-ui, sans-serif";
        ctx.textBaseline = "middle";
        ctx.lineWidth = 1;
        for (const v of [-top, 0, top]) {
          ctx.strokeStyle = page.style(v ? "--grid" : "--soft");
          ctx.beginPath();
          ctx.arc(cx, cy, radius(v), 0, TURN);
          ctx.stroke();
        }
        ctx.strokeStyle = page.style("--grid");
        for (let i = 0; i < 360; i += 45) {
          ctx.beginPath();
          ctx.moveTo(...at(i, -top));
          ctx.lineTo(...at(i, top));
          ctx.stroke();
        }
        for (const s of series.filter((x) => !hidden.has(x.controller))) {
          ctx.fillStyle = ctx.strokeStyle = colour(s.controller);
          ctx.globalAlpha = 0.25;
          ctx.beginPath();
          trace(s.high);
          ctx.closePath();
          ctx.moveTo(...at(0, s.low[0]));
          s.low.forEach((v, i) => ctx.lineTo(...at(i, v)));
          ctx.closePath();
          ctx.fill("evenodd");
          ctx.globalAlpha = 1;
          ctx.lineWidth = 1.4;
          ctx.beginPath();
          trace(s.values);
          ctx.closePath();
          ctx.stroke();
        }
        ctx.fillStyle = page.style("--soft");
        ctx.textAlign = "center";
        ctx.fillText("90°", cx, cy - reach - 14);
        ctx.fillText("270°", cx, cy + reach + 14);
        ctx.fillText("0°", cx + reach + 16, cy);
        ctx.fillText("180°", cx - reach - 16, cy);
        ctx.textAlign = "left";
        [top, 0, -top].forEach((v, i) => {
          const text = `${["outer", "middle", "inner"][i]} circle: ${label(v)}`;
          ctx.fillText(text, 8, height - 46 + 16 * i);
        });
      },
    });
  }

  function draw(shown, sheet) {
    const { part, panel, zoomed, zoomTo } = sheet;
    const panels = (name) => part(name).querySelector(".panels");
    const wanted = zoomed.get("time");
    part("waveforms").hidden = !shown.waveforms.panels.length;
    if (shown.waveforms.panels.length) {
      const xs = drawTimes(sheet, panels("waveforms"), shown.waveforms, "time", (i) => ({ adapt: shade(shown.marks, i === 0) }));
      if (shown.strip.length) drawStrip(sheet, panels("waveforms"), shown.strip, xs, shown.marks);
    }
    sheet.zoomButtons(part("waveforms"), "time", shown.zooms);
    const named = (name) => shown.zooms.find((z) => z.name === name);
    const usual = shown.zooms.find((z) => z.first) ?? named("after start-up") ?? shown.zooms[0];
    const share = usual?.name === "last revolution" ? sheet.turnShown() : 1;
    const first = wanted ?? (usual && { from: usual.to - share * (usual.to - usual.from), to: usual.to });
    if (first) zoomTo("time", first);

    part("spectra").hidden = !shown.spectra.length && !part("spectra").querySelector(".missed");
    for (const s of shown.spectra)
      bars(sheet, panels("spectra"), {
        ...about(s), xs: s.orders, series: s.series, readX: (n) => `order ${n}`,
      });

    part("late").hidden = !part("late").querySelector("table");
    part("waterfall").hidden = !shown.waterfall.length;
    for (const w of shown.waterfall) drawWaterfall(sheet, panels("waterfall"), w);
    part("tracking").hidden = !shown.tracking.length;
    for (const t of shown.tracking)
      panel(panels("tracking"), { ...about(t), xs: t.along, series: t.series, group: "tracking", adapt: logY(t.series, 1e-4) });

    part("map").hidden = !shown.maps.length && !shown.polar.length;
    for (const p of shown.polar) drawPolar(sheet, panels("map"), p);
    for (const m of shown.maps)
      panel(panels("map"), {
        ...about(m), xs: m.angle, series: m.series, readX: (a) => `${number(a)}°`,
      });

    part("angle").hidden = !shown.angle.length;
    for (const a of shown.angle)
      panel(panels("angle"), {
        ...about(a), xs: a.angle, series: a.series, group: "angle", readX: (x) => `${number(x)}°`,
      });

    part("criterion").hidden = !shown.criterion.length;
    for (const c of shown.criterion) drawCriterion(sheet, panels("criterion"), c);

    part("bode").hidden = !shown.bode.length;
    for (const b of shown.bode)
      panel(panels("bode"), { ...about(b), xs: b.frequency, series: b.series, group: "bode", readX: (f) => `${number(f)} Hz`, adapt: overFrequency });

    part("events").hidden = !shown.events.length;
    shown.events.forEach((e, i) => drawTimes(sheet, panels("events"), e, "event" + i, () => ({})));

    part("terms").hidden = !part("terms").querySelector("table");
    part("spectra").querySelector(".log").onchange = sheet.redraw;
  }

  // The next of 1, 2, 5, 10, ... below or above.
  const round = (x, direct) => {
    const decade = 10 ** Math.floor(Math.log10(x)), steps = [1, 2, 5, 10];
    return decade * (direct === Math.floor ? steps.findLast((s) => s * decade <= x) : steps.find((s) => s * decade >= x));
  };

  // Of the answer's plots: what broke is shaded, and ripple that shrinks has a log axis.
  draw.options = (shown) => (chart, i, series) => ({
    adapt: (o) => {
      if (!i && chart.cycles) return;
      shade([...shown.marks, ...(chart.held ?? [])], i === 1)(o);
      const values = series.flatMap((s) => s.values.filter((v) => v > 0));
      const [low, high] = [Math.min(...values), Math.max(...values)];
      if (i && high > SHRINKS * low) o.scales.y = { distr: 3, range: () => [round(low / 1.1, Math.floor), round(high * 1.1, Math.ceil)] };
    },
  });

  return draw;
};
