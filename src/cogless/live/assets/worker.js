"use strict";
// Carries out one run after the other, and hands back what the page shows: numbers, and curves thinned to its width.
(() => {
  const { Trace, evaluate, judged, held, missed, ofPhases, rms, whole, TAU, largest, smallest } = liveMetrics;
  const POINTS = 600; // of a curve over the whole run: a lowest and a highest value each
  const CELLS = 1024; // of a revolution in the spectrum
  const ORDERS = 160; // of a revolution at most
  const TURN_CELLS = 1440; // of a revolution
  const MOTION_POINTS = 1500; // of the rotor's angle
  const PIECE = 2.0; // s, over which errors are compared
  const SOON = 120; // ms between two pictures of trials that still go on
  const tables = new Map(); // what a commissioning run has learned, by its description
  let compiled = null, module = null;

  // The slow run that fills a table beforehand. Its status says when it is over; it is looked at every second.
  function commissioned({ description, ticks, divider, rate, busy }) {
    const name = description.join();
    if (!tables.has(name)) {
      const engine = new Engine(module), piece = divider * Math.ceil(rate / divider);
      engine.open(description, divider, 0);
      for (let done = 0; !tables.has(name); done += piece) {
        if (done >= ticks) throw new Error("the calibration run is not done after three times its length: expected kp and ki that hold the run's speed");
        engine.advance(piece);
        const { rows, count, columns, names } = engine.take();
        if (!(rows[(count - 1) * columns + names.indexOf("status")] & busy)) tables.set(name, engine.stored());
      }
      if (tables.size > 8) tables.delete(tables.keys().next().value);
    }
    return tables.get(name);
  }

  // The lowest and the highest value of each bucket in their order, at its start and middle: runs of one length have the same times.
  function thin(time, x) {
    const size = Math.max(1, Math.ceil(x.length / POINTS)), at = [], values = [];
    for (let from = 0; from < x.length; from += size) {
      const end = Math.min(from + size, x.length);
      let low = from, high = from;
      for (let i = from + 1; i < end; i++) {
        if (x[i] < x[low]) low = i;
        if (x[i] > x[high]) high = i;
      }
      at.push(time[from]);
      values.push(x[Math.min(low, high)]);
      if (end - from === 1) continue;
      at.push(time[(from + end) >> 1]);
      values.push(x[Math.max(low, high)]);
    }
    return { at, values };
  }

  const cos = Float64Array.from({ length: CELLS }, (_, k) => Math.cos((TAU * k) / CELLS));
  // Amplitudes of a signal's orders, of the mechanical revolution, over its last whole revolutions.
  function spectrum(theta, x) {
    const part = whole(theta, x, 1, 1, false);
    if (!part) return null;
    const [angle, values] = part, turns = Math.round(Math.abs(angle[angle.length - 1] - angle[0]) / TAU);
    const direction = angle[angle.length - 1] >= angle[0] ? 1 : -1, cell = new Float64Array(CELLS);
    for (let i = 0, k = 0; k < turns * CELLS; k++) {
      const at = angle[0] + (direction * k * TAU) / CELLS;
      while (i < angle.length - 2 && direction * (angle[i + 1] - at) < 0) i++;
      const share = Math.min(1, (at - angle[i]) / (angle[i + 1] - angle[i] || 1)); // the window may be a hair short
      cell[k % CELLS] += (values[i] + share * (values[i + 1] - values[i])) / turns;
    }
    return Array.from({ length: ORDERS }, (_, n) => {
      let re = 0, im = 0;
      for (let k = 0; k < CELLS; k++) {
        const phase = ((n + 1) * k) % CELLS;
        re += cell[k] * cos[phase];
        im += cell[k] * cos[(phase + CELLS / 4) % CELLS];
      }
      return (2 / CELLS) * Math.hypot(re, im);
    });
  }

  // Peak-to-peak errors in successive windows.
  function errors(trace, name) {
    const rows = Math.round(PIECE / trace.period), x = trace.get(name), found = [];
    for (let from = 0; rows && from + rows <= x.length; from += rows) {
      const part = x.subarray(from, from + rows);
      found.push(largest(part) - smallest(part));
    }
    return found;
  }

  // The rows of the rotor's last whole revolution; -1: it turns less, or turns back.
  function revolution(theta) {
    const end = theta.length - 1;
    for (let first = end; first >= 0; first--) {
      if (Math.abs(theta[end] - theta[first]) >= TAU) return first;
    }
    return -1;
  }

  // A signal over the rotor's angle in its last revolution, a value each 1 / TURN_CELLS of it; null: it turns less.
  function overAngle(theta, x) {
    const first = revolution(theta);
    if (first < 0) return null;
    const values = new Float64Array(TURN_CELLS + 1).fill(NaN);
    for (let i = first; i < theta.length - 1; i++) {
      const [from, to] = [(theta[i] / TAU) * TURN_CELLS, (theta[i + 1] / TAU) * TURN_CELLS];
      const [low, high] = from < to ? [from, to] : [to, from];
      for (let k = Math.ceil(low); k <= high; k++) {
        const share = from === to ? 0 : (k - from) / (to - from);
        values[((k % TURN_CELLS) + TURN_CELLS) % TURN_CELLS] = x[i] + share * (x[i + 1] - x[i]);
      }
    }
    values[TURN_CELLS] = values[0];
    return Array.from(values, (v) => (Number.isNaN(v) ? null : v));
  }

  // The RMS about its mean of a signal over each time of so many rows, and when each ends.
  function movingRms(trace, x, rows) {
    const hop = Math.max(1, Math.min(Math.floor(rows / 4), Math.ceil(x.length / POINTS))), at = [], values = [];
    const hops = Math.max(1, Math.round(rows / hop)), sums = [0], squares = [0], origin = x[x.length - 1];
    for (let from = 0; from + hop <= x.length; from += hop) {
      let sum = 0, square = 0;
      for (let i = from; i < from + hop; i++) {
        const y = x[i] - origin;
        sum += y;
        square += y * y;
      }
      sums.push(sums.at(-1) + sum);
      squares.push(squares.at(-1) + square);
      const n = sums.length - 1;
      if (n < hops) continue;
      const mean = (sums[n] - sums[n - hops]) / (hops * hop);
      at.push(trace.time[from + hop - 1]);
      values.push(Math.sqrt(Math.max(0, (squares[n] - squares[n - hops]) / (hops * hop) - mean * mean)));
    }
    return { at, values };
  }

  // Rows of a revolution at the mean speed; of a twentieth of the run where the rotor turns less than twice.
  function rowsOfTurn(trace) {
    const theta = trace.get("theta_m"), turns = Math.abs(theta[theta.length - 1] - theta[0]) / TAU;
    return Math.max(4, Math.round(turns >= 2 ? theta.length / turns : theta.length / 20));
  }

  // The rotor's angle over its last revolution, some hundred rows of it.
  function motion(trace, first) {
    const theta = trace.get("theta_m"), every = Math.max(1, Math.ceil((theta.length - first) / MOTION_POINTS)), time = [], angle = [];
    for (let i = first; i < theta.length; i += every) {
      time.push(trace.time[i] - trace.time[first]);
      angle.push(theta[i]);
    }
    return { time, angle };
  }

  // Rows of the last revolution, at most of the last second.
  function lastTurn(trace) {
    const theta = trace.get("theta_m"), end = trace.count - 1, from = trace.left(trace.time[end] - 1);
    let first = end;
    while (first > from && Math.abs(theta[end] - theta[first - 1]) <= TAU) first--;
    return first;
  }

  function carriedOut({ description, ticks, decimation, learned, learn, about, metrics, path }) {
    const begun = performance.now(), engine = new Engine(module);
    engine.open(description, decimation, Math.ceil(ticks / decimation));
    const start = learn ? commissioned(learn) : learned;
    if (start) engine.load(start);
    engine.advance(ticks);
    const stored = engine.stored(), trace = new Trace(engine.take()), ran = performance.now();
    const values = metrics.map((m) => evaluate(m, trace, about)), rows = metrics.map((m) => judged(m, metrics, trace, about));
    const error = path && trace.has("theta_error") ? "theta_error" : "omega_error";
    const first = lastTurn(trace), late = (name) => (trace.has(name) ? Array.from(trace.get(name).subarray(first)) : null);
    const [settledFrom, settledTo] = trace.window(Math.max(0, trace.time[trace.count - 1] - 4), trace.time[trace.count - 1]);
    const map = stored && { cells: stored.cells, channels: stored.channels, values: Array.from(stored.values, (v) => v / about.unit) };
    return {
      values, map, error,
      guarded: rows.map((own) => held(about.guarded, own, trace)),
      missed: rows.map((own) => missed(own, trace, about.tracking)),
      names: trace.names,
      whole: thin(trace.time, trace.get(error)),
      current: thin(trace.time, trace.get("i_q")),
      turn: { time: Array.from(trace.time.subarray(first)), speed: late("omega_m"), wanted: late("omega_ref"), current: late("i_q"), torque: late(trace.has("tau_motor") ? "tau_motor" : "tau_e") },
      revolution: overAngle(trace.get("theta_m"), trace.get("omega_m")),
      ripple: movingRms(trace, trace.get("omega_m"), rowsOfTurn(trace)),
      motion: motion(trace, Math.max(0, revolution(trace.get("theta_m")))),
      orders: spectrum(trace.get("theta_m").subarray(settledFrom, settledTo), trace.get("omega_m").subarray(settledFrom, settledTo)),
      errors: errors(trace, error),
      ms: { engine: ran - begun, all: performance.now() - begun },
    };
  }

  // Trials, some at a time: of each only its metrics are kept, of the chosen ones the curves, too. null: it was stopped.
  async function trials(id, { description, ticks, decimation, about, metrics, judged, panels, chosen }) {
    const begun = performance.now(), engine = new Engine(module), rows = Math.ceil(ticks / decimation);
    const signals = [...new Set([judged.signal, ...metrics.map((m) => m.signal)])];
    const each = Object.fromEntries(signals.map((name) => [name, []])), listed = metrics.map(() => []), curves = {};
    engine.open(description, decimation, rows);
    const result = () => ({
      values: metrics.map((m, n) => (m.titles.length ? ofPhases(m, each[m.signal], about.starts) : listed[n])),
      errors: each[judged.signal], curves,
      settled: ofPhases({ kind: "final-rms" }, each[judged.signal], about.starts),
      counts: judged.floor && ofPhases({ kind: "trials-to-floor", floor: judged.floor * judged.factor }, each[judged.signal], about.starts),
      of: about.trials, ms: { all: performance.now() - begun },
    });
    let told = begun, worked = begun;
    for (let trial = 1; trial <= about.trials; trial++) {
      engine.advance(ticks);
      const trace = new Trace(engine.take());
      for (const name of signals) each[name].push(rms(trace.get(name)));
      metrics.forEach((m, n) => { if (!m.titles.length) listed[n].push(evaluate(m, trace, about)); });
      if (chosen.includes(trial)) {
        const time = trace.time.map((t) => t - trace.time[0]), thinned = (name) => name && trace.has(name) && thin(time, trace.get(name));
        curves[trial] = panels.map(({ signal, reference }) => ({ ...thinned(signal), reference: thinned(reference) }));
      }
      const now = performance.now();
      if (now - worked < SOON / 4) continue;
      await new Promise((go) => { // so that a message comes through
        const { port1, port2 } = new MessageChannel();
        port1.onmessage = () => { port1.close(); go(); };
        port2.postMessage(0);
      });
      if (stopped === id) return null;
      worked = now;
      if (now - told < SOON || trial === about.trials) continue;
      told = now;
      self.postMessage({ id, part: result() });
    }
    return result();
  }

  let stopped = null;
  self.onmessage = async ({ data }) => {
    if (data.module) {
      compiled = WebAssembly.compile(data.module);
      return;
    }
    if (data.stop) {
      stopped = data.stop;
      return;
    }
    try {
      module = await compiled;
      const { id, job } = data;
      self.postMessage({ id, result: job.about.trials ? await trials(id, job) : carriedOut(job) });
    } catch (error) {
      self.postMessage({ id: data.id, error: error.message });
    }
  };
})();
