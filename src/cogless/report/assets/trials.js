"use strict";
// Plots of a scenario of trials; `page`: what every scenario's plots share.
const trialsPlots = (page) => {
  const { report, style, colour, make, about, number, unpack } = page;
  const FONT = "11px system-ui, sans-serif";
  const ROW = 15; // of marks' names, in pixels

  // Choice of a sheet's waveforms: of one controller several trials, or of one trial all controllers.
  const views = new Map(); // sheet -> {by: "trial" or "controller", trial, trials, controller}

  function draw(shown, sheet) {
    const { part, zoomed } = sheet;
    overTrials(sheet, shown.over_trials, zoomed.get("trials"));
    const waves = shown.waveforms.panels.length > 0;
    if (waves && !views.has(sheet)) views.set(sheet, beginning(shown));
    part("waveforms").hidden = !waves;
    if (waves) waveforms(sheet, zoomed.get("waves"));
    certificate(sheet, shown.certificate);
    part("gains").hidden = !part("gains").querySelector("table");
  }

  // --- over the trials

  function overTrials({ part, panel, zoomTo, zoomButtons }, { charts, trials, marks, zooms }, kept) {
    part("over-trials").hidden = !charts.length;
    const parent = part("over-trials").querySelector(".panels");
    charts.forEach((chart, i) => {
      const xs = Array.from({ length: trials }, (_, k) => k + 1);
      const series = chart.series.map((s) => ({ controller: s.controller, values: unpack(s.values).map((v) => (v == null ? null : 10 ** v)) }));
      panel(parent, {
        ...about(chart), xs, series, height: i ? 360 : 440, group: "trials",
        readX: (k) => `trial ${k}`,
        adapt: (o) => {
          o.scales.y = { distr: 3, range: (u, low, high) => logRange(low, high, chart.floor) };
          for (const s of o.series.slice(1)) s.points = { size: 5 }; // dots where there is room for them
          o.axes[0].incrs = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 20000];
          o.padding = [8 + ROW * rowsOf(marks), 12, 0, 0];
          o.hooks.drawAxes = [(u) => drawMarks(u, marks)]; // below the curves
          if (chart.floor != null) o.hooks.drawAxes.push((u) => drawLevel(u, chart.floor, chart.floor_name));
        },
      });
      if (chart.note) make("p", parent, chart.note, "note");
    });
    zoomButtons(part("over-trials"), "trials", zooms);
    if (kept) zoomTo("trials", kept);
  }

  // Range of an axis: at least a decade.
  function logRange(low, high, floor) {
    const levels = [low, high, floor].filter((v) => v > 0);
    if (!levels.length) return [0.1, 10];
    const [bottom, top] = [Math.min(...levels) / 1.1, Math.max(...levels) * 1.1];
    const lack = Math.max(1, Math.sqrt(10 / (top / bottom)));
    return uPlot.rangeLog(bottom / lack, top * lack, 10, false);
  }

  const rowsOf = (marks) => Math.min(4, marks.length);

  function canvas(u, paint) {
    const { ctx } = u;
    ctx.save();
    ctx.font = `${devicePixelRatio * parseFloat(FONT)}${FONT.slice(FONT.indexOf("px"))}`;
    ctx.fillStyle = ctx.strokeStyle = style("--soft");
    ctx.lineWidth = devicePixelRatio;
    paint(ctx, devicePixelRatio);
    ctx.restore();
  }

  // A vertical line at each change; its name above the plot, in the highest row where no line crosses another's name.
  function drawMarks(u, marks) {
    canvas(u, (ctx, px) => {
      const { left, top, width, height } = u.bbox;
      const ends = Array(rowsOf(marks)).fill(0); // of the names so far, the lowest row first
      ctx.textBaseline = "middle";
      ctx.textAlign = "left";
      for (const mark of marks) {
        const x = u.valToPos(mark.trial, "x", true);
        if (x < left - 1 || x > left + width + 1) continue;
        const wide = ctx.measureText(mark.name).width;
        const begin = Math.min(x + 4 * px, left + width - wide);
        const taken = ends.findIndex((end) => end > Math.min(begin, x));
        const row = (taken < 0 ? ends.length : taken) - 1;
        if (row >= 0) {
          ends[row] = begin + wide + 10 * px;
          ctx.fillText(mark.name, begin, top - (row + 0.5) * ROW * px);
        }
        ctx.setLineDash([2 * px, 3 * px]);
        ctx.beginPath();
        ctx.moveTo(x, top - (row + 1) * ROW * px);
        ctx.lineTo(x, top + height);
        ctx.stroke();
      }
    });
  }

  // A horizontal line with its name.
  function drawLevel(u, value, name, dash = [6, 4]) {
    canvas(u, (ctx, px) => {
      const { left, width } = u.bbox;
      const y = u.valToPos(value, "y", true);
      ctx.setLineDash(dash.map((d) => d * px));
      ctx.beginPath();
      ctx.moveTo(left, y);
      ctx.lineTo(left + width, y);
      ctx.stroke();
      ctx.textAlign = "right";
      ctx.fillText(name, left + width - 5 * px, y - 5 * px);
    });
  }

  // --- chosen trials

  // The first trial after the first change with all controllers; without a change, how one controller learns.
  function beginning({ waveforms: { phases, panels }, controllers }) {
    const last = panels.at(-1).series.at(-1).controller;
    const phase = phases[1] ?? phases[0];
    return { by: phases.length > 1 && controllers.length > 1 ? "trial" : "controller", trial: phase.trials[0], trials: new Set(phase.trials), controller: last };
  }

  function waveforms(sheet, kept) {
    const { shown, zoomed, zoomTo } = sheet;
    const { phases, note } = shown.waveforms;
    const view = views.get(sheet);
    const [kinds, chooser, told, panels] = [".views", ".chooser", ".about", ".panels"].map((name) => sheet.part("waveforms").querySelector(name));
    kinds.textContent = chooser.textContent = "";
    const again = (change) => () => {
      change();
      const zoom = zoomed.get("waves");
      sheet.clear(panels);
      waveforms(sheet, zoom);
      sheet.resize();
    };
    const choice = (parent, text, chosen, change) => {
      const button = make("button", parent, text);
      button.type = "button";
      button.setAttribute("aria-pressed", chosen);
      button.onclick = again(change);
      return button;
    };
    const byTrial = view.by === "trial";
    choice(kinds, "one trial, all controllers", byTrial, () => { view.by = "trial"; });
    choice(kinds, "one controller, several trials", !byTrial, () => { view.by = "controller"; });
    const chosen = [...view.trials].sort((a, b) => a - b).join(", ");
    told.textContent = (byTrial
      ? `Trial ${view.trial}, all controllers. `
      : `${report.controllers[view.controller].label}, trials ${chosen || view.trial}, the earliest palest. A phase's name chooses all of its trials. `) +
      `Of each phase the first, second, fifth and last trial can be chosen. ${note}`;
    if (!byTrial) {
      const row = make("div", chooser, "", "choice chips");
      for (const controller of shown.controllers) {
        const button = choice(row, report.controllers[controller].label, controller === view.controller, () => { view.controller = controller; });
        button.style.setProperty("--colour", colour(controller));
      }
    }
    const row = make("div", chooser, "", "choice");
    for (const phase of phases) {
      const group = make("span", row, "", "phase");
      if (byTrial) make("span", group, phase.name, "phase-name");
      else choice(group, phase.name, false, () => { view.trials = new Set(phase.trials); }).className = "phase-name";
      for (const trial of phase.trials)
        choice(group, String(trial), byTrial ? trial === view.trial : view.trials.has(trial), () => {
          view.trial = trial;
          if (!byTrial) view.trials.has(trial) ? view.trials.delete(trial) : view.trials.add(trial);
        }).setAttribute("aria-label", `trial ${trial}`);
    }
    drawWaves(sheet, panels, view, byTrial);
    if (kept) zoomTo("waves", kept);
  }

  function drawWaves({ shown, panel }, parent, view, byTrial) {
    const { panels, phases, x, start, step } = shown.waveforms;
    const trials = byTrial ? [view.trial] : [...view.trials].sort((a, b) => a - b);
    const wanted = trials.length ? trials : [view.trial];
    const of = new Set(wanted.map((trial) => phases.findIndex((p) => p.trials.includes(trial))));
    const known = panels.filter((p) => byTrial || p.series.some((s) => s.controller === view.controller));
    known.forEach((p, i) => {
      const references = [...of].filter((k) => p.references[k]).map((k) => p.references[k]);
      const distinct = references.filter((r, k) => references.findIndex((o) => o.data === r.data && o.scale === r.scale && o.offset === r.offset) === k);
      const series = [];
      if (byTrial) for (const s of p.series) series.push({ controller: s.controller, values: unpack(s.trials[view.trial]) });
      else {
        const own = p.series.find((s) => s.controller === view.controller);
        wanted.forEach((trial, k) => {
          const share = wanted.length > 1 ? 0.3 + (0.7 * k) / (wanted.length - 1) : 1;
          series.push({ stroke: mixed(colour(view.controller), style("--card"), share), width: 1 + 0.8 * share, label: `trial ${trial}:`, values: unpack(own.trials[trial]) });
        });
      }
      for (const r of distinct) series.push({ dash: true, label: "reference", values: unpack(r) }); // on top
      const xs = Array.from({ length: Math.max(...series.map((s) => s.values.length)) }, (_, k) => start + k * step);
      panel(parent, {
        ...about({ x: i === known.length - 1 ? x : "", ...p }), xs, series, group: "waves", readX: (t) => `${t.toFixed(4)} s`,
      });
    });
  }

  // Two colours, #rrggbb, as one: `share` of the first.
  function mixed(first, second, share) {
    const parts = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
    const b = parts(second);
    return `rgb(${parts(first).map((v, i) => Math.round(share * v + (1 - share) * b[i])).join(",")})`;
  }

  // --- certificate

  function certificate({ part, panel }, charts) {
    part("certificate").hidden = !charts.length && !part("certificate").querySelector("table");
    for (const chart of charts) {
      const xs = chart.frequency;
      const series = chart.series.map((s) => ({ ...s, values: unpack(s.values), label: s.dash && "unfiltered" }));
      panel(part("certificate").querySelector(".panels"), {
        ...about(chart), xs, series, readX: (f) => `${number(f)} Hz`,
        adapt: (o) => {
          o.scales.x = { time: false, distr: 3, range: (u, low, high) => [low, high] };
          o.scales.y = { range: (u, low, high) => [0, 1.1 * Math.max(1, high ?? 1)] };
          o.hooks.drawAxes = [(u) => drawLevel(u, 1, "above 1 the error may grow", [])];
        },
      });
    }
  }

  return draw;
};
