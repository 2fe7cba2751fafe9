"use strict";
// Metrics of a trace, as src/cogless/results/metrics.py computes them: a test holds each against it.
const liveMetrics = (() => {
  const TAU = 2 * Math.PI;
  const DERIVED = {
    omega_error: ["omega_ref", "omega_m", (a, b) => a - b],
    omega_error_measured: ["omega_ref", "omega_measured", (a, b) => a - b],
    omega_sensor_error: ["omega_measured", "omega_m", (a, b) => a - b],
    i_amplitude: ["i_d", "i_q", Math.hypot],
    tau_motor: ["tau_e", "tau_cogging", (a, b) => a + b],
    theta_error: ["theta_ref", "theta_m", (a, b) => a - b],
    theta_error_measured: ["theta_ref", "theta_measured", (a, b) => a - b],
    theta_sensor_error: ["theta_measured", "theta_m", (a, b) => a - b],
    y_error: ["y_ref", "y", (a, b) => a - b],
  };
  const ERRORS = ["omega_error", "omega_error_measured"];
  const REFERENCES = { omega_m: "omega_ref", omega_measured: "omega_ref", i_d: "i_d_ref", i_q: "i_q_ref" };
  const TURNING = ["rad", "rad/s"];
  const REFERENCE_SPREAD_MOST = 1e-9; // of the speed: so much a constant reference varies by rounding
  const ROWS_OF_PULSES_LEAST = 16; // in a period of the PWM: fewer miss most of its short pulses
  const TURN_SHORTFALL_MOST = 1e-3; // of a revolution, that a window of whole ones may be short

  // A trace's signals by name, recorded or derived, each made when it is first asked for.
  class Trace {
    constructor({ rows, count, columns, names }) {
      Object.assign(this, { rows, count, columns, names, made: new Map() });
      this.time = this.get("time");
      this.period = count > 1 ? (this.time[count - 1] - this.time[0]) / (count - 1) : 0;
    }
    has(name) {
      return this.names.includes(name) || (name in DERIVED && DERIVED[name].slice(0, 2).every((n) => this.names.includes(n)));
    }
    get(name) {
      if (!this.made.has(name)) this.made.set(name, this.names.includes(name) ? this.column(this.names.indexOf(name)) : this.derived(name));
      return this.made.get(name);
    }
    column(k) {
      const all = new Float64Array(this.count);
      for (let i = 0, at = k; i < this.count; i++, at += this.columns) all[i] = this.rows[at];
      return all;
    }
    derived(name) {
      const [a, b, of] = DERIVED[name], x = this.get(a), y = this.get(b), all = new Float64Array(this.count);
      for (let i = 0; i < this.count; i++) all[i] = of(x[i], y[i]);
      return all;
    }
    // First row at or after t, and the one behind the last at or before it.
    left(t) { return this.search((x) => x < t); }
    right(t) { return this.search((x) => x <= t); }
    search(before) {
      let low = 0, high = this.count;
      while (low < high) {
        const middle = (low + high) >> 1;
        if (before(this.time[middle])) low = middle + 1; else high = middle;
      }
      return low;
    }
    window(from, to) {
      const slack = 1e-6 * this.period, first = this.left(from - slack);
      return [first, Math.max(first, this.right(to + slack))];
    }
  }

  const sum = (x) => { // with Kahan's correction, to be as near to the sum as numpy's
    let total = 0, lost = 0;
    for (let i = 0; i < x.length; i++) {
      const y = x[i] - lost, t = total + y;
      lost = t - total - y;
      total = t;
    }
    return total;
  };
  const mean = (x) => sum(x) / x.length;
  const extreme = (x, better) => {
    let found = x[0];
    for (let i = 1; i < x.length; i++) if (!(better * (x[i] - found) <= 0)) found = Number.isNaN(found) ? found : x[i];
    return found;
  };
  const largest = (x) => extreme(x, 1);
  const smallest = (x) => extreme(x, -1);

  function declared(m, end) {
    if (m.last != null) return [Math.max(0, end - m.last), end];
    return m.window;
  }
  function span(m, trace, about) {
    const end = trace.count ? trace.time[trace.count - 1] : 0;
    const found = declared(m, end);
    if (found) return found;
    if (m.event == null) return [0, end];
    const after = m.event + trace.period / 2;
    return [m.event, about.events.filter((t) => t > after).reduce((a, t) => Math.min(a, t - trace.period), end)];
  }

  function input(m, trace, about) {
    const [first, last] = trace.window(...span(m, trace, about));
    const turned = m.frame === "electrical" && m.kind !== "order" && TURNING.includes(m.signal_unit) ? about.pole_pairs : 1;
    const part = (name, [a, b]) => {
      const x = trace.get(name).subarray(a, b);
      return turned === 1 || !TURNING.includes(m.units[name] ?? m.signal_unit) ? x : x.map((v) => turned * v);
    };
    const own = () => {
      if (m.smooth == null) return part(m.signal, [first, last]);
      const all = part(m.signal, [0, trace.count]), half = even(m.smooth / trace.period / 2), total = new Float64Array(all.length + 1);
      all.forEach((v, i) => { total[i + 1] = total[i] + v; });
      return Float64Array.from({ length: last - first }, (_, k) => {
        const row = first + k, end = row < last ? last : all.length;
        const from = Math.max(row - half, 0), to = Math.min(row + half + 1, end);
        return (total[to] - total[from]) / (to - from);
      });
    };
    const x = m.signal ? own() : null;
    return { m, trace, about, first, last, part, x, time: trace.time.subarray(first, last) };
  }

  function meanBefore({ m, trace, about, part, first, last }) {
    const previous = about.events.filter((t) => t < m.event - trace.period / 2).reduce((a, t) => Math.max(a, t), 0);
    const rows = trace.window((previous + m.event) / 2, m.event - trace.period);
    if (rows[0] === rows[1]) return part(m.signal, [first, last])[0];
    const theta = trace.get("theta_m").subarray(...rows), end = theta[theta.length - 1];
    return mean(part(m.signal, rows).filter((_, i) => Math.abs(theta[i] - end) <= TAU));
  }
  // Whether the signal has a target that stays the same from the row before the window on.
  function targetStays({ m, trace, part, first, last }) {
    const reference = REFERENCES[m.signal];
    if (!reference || !trace.has(reference)) return ERRORS.includes(m.signal);
    const target = part(reference, [Math.max(first - 1, 0), last]);
    return target.every((v) => v === target[0]);
  }
  function outside(at, otherwise) {
    const { m, trace, part, x, first, last } = at, found = [];
    const reference = REFERENCES[m.signal];
    const target = ERRORS.includes(m.signal) ? 0 : reference && trace.has(reference) ? part(reference, [first, last]) : otherwise();
    x.forEach((v, i) => { if (!(Math.abs(v - (typeof target === "number" ? target : target[i])) <= m.band)) found.push(i); });
    return found;
  }

  const gcd = (a, b) => (b ? gcd(b, a % b) : a);
  const lcm = (a, b) => (a / gcd(a, b)) * b;

  // Rows of the longest way in one direction; an angle that is passed more than once counts at its last passage.
  function onward(theta, x) {
    let low = 0, high = 0;
    for (let i = 0; i < theta.length; i++) {
      if (!Number.isFinite(theta[i])) return null;
      if (theta[i] < theta[low]) low = i;
      if (theta[i] > theta[high]) high = i;
    }
    const [first, last] = [Math.min(low, high), Math.max(low, high)], direction = high >= low ? 1 : -1;
    let back = first + 1;
    while (back <= last && direction * (theta[back] - theta[back - 1]) >= 0) back++;
    if (back > last) return [theta.subarray(first, last + 1), x.subarray(first, last + 1)]; // it never turns back
    const keep = [];
    let least = Infinity;
    for (let i = last; i >= first; i--) {
      const travelled = Math.abs(theta[i] - theta[first]);
      least = Math.min(least, travelled);
      if (travelled <= least) keep.push(i);
    }
    keep.reverse();
    return [Float64Array.from(keep, (i) => theta[i]), Float64Array.from(keep, (i) => x[i])];
  }
  // The last whole revolutions over the angle: [angle, x], or null. `each`: so many have whole periods of every order.
  function whole(theta, x, each, poles, electrical) {
    const way = theta.length ? onward(theta, x) : null;
    if (!way) return null;
    const frame = electrical ? way[0].map((t) => t * poles) : way[0];
    const n = frame.length;
    const turns = Math.abs(frame[n - 1] - frame[0]) / TAU, row = turns / Math.max(1, n - 1);
    for (const period of electrical ? [lcm(each, poles), each] : [each]) {
      const count = Math.floor((turns + Math.max(2 * row, TURN_SHORTFALL_MOST)) / period);
      if (count) return lastPart(frame, way[1], Math.min(turns, count * period) * TAU);
    }
    return null;
  }
  function lastPart(angle, x, length) {
    const n = angle.length, direction = angle[n - 1] >= angle[0] ? 1 : -1;
    const travelled = (i) => direction * (angle[i] - angle[0]);
    const start = Math.max(0, travelled(n - 1) - length);
    let first = 0;
    while (first < n - 2 && travelled(first + 1) <= start) first++;
    const share = (start - travelled(first)) / (travelled(first + 1) - travelled(first) || 1);
    const cut = (from, values) => {
      const part = values.slice(first);
      part[0] = from;
      return part;
    };
    return [cut(angle[0] + direction * start, angle), cut(x[first] + share * (x[first + 1] - x[first]), x)];
  }
  function amplitudes(theta, x, orders, each, poles, electrical) {
    const part = whole(theta, x, each, poles, electrical);
    if (!part) return orders.map(() => NaN);
    const [angle, values] = part, n = angle.length, length = angle[n - 1] - angle[0];
    const integral = (y) => {
      let total = 0;
      for (let i = 1; i < n; i++) total += (angle[i] - angle[i - 1]) * (y[i] + y[i - 1]);
      return total / 2;
    };
    const offset = integral(values) / length, re = new Float64Array(n), im = new Float64Array(n);
    return orders.map((order) => {
      for (let i = 0; i < n; i++) {
        re[i] = (values[i] - offset) * Math.cos(order * angle[i]);
        im[i] = (values[i] - offset) * Math.sin(order * angle[i]);
      }
      return (2 * Math.hypot(integral(re), integral(im))) / Math.abs(length);
    });
  }

  const std = (x) => {
    const middle = mean(x);
    return Math.sqrt(mean(x.map((v) => (v - middle) ** 2)));
  };
  const KINDS = {
    "peak-to-peak": ({ x }) => largest(x) - smallest(x),
    rms: ({ x }) => Math.sqrt(mean(x.map((v) => v * v))),
    "ripple-rms": ({ x }) => std(x),
    "three-sigma": ({ x }) => 3 * std(x),
    "switching-ripple": ({ trace, about, x }) => {
      const count = trace.period ? even(about.pwm_period / trace.period) : 0;
      const half = Math.floor(count / 2), end = count % 2 ? 1 : 0.5;
      if (count < ROWS_OF_PULSES_LEAST || x.length < 2 * half + 1) return NaN;
      return Math.sqrt(mean(x.subarray(half, x.length - half).map((v, n) => {
        let total = end * (x[n] + x[n + 2 * half]);
        for (let k = n + 1; k < n + 2 * half; k++) total += x[k];
        return (v - total / count) ** 2;
      })));
    },
    "ripple-ratio": ({ x }) => {
      const high = largest(x), low = smallest(x);
      return high + low ? (high - low) / Math.abs(high + low) : NaN;
    },
    mean: ({ x }) => mean(x),
    maximum: ({ x }) => largest(x.map(Math.abs)),
    order: ({ m, trace, about, first, last, x }) => amplitudes(trace.get("theta_m").subarray(first, last), x, m.order, m.revolutions, about.pole_pairs, m.frame === "electrical"),
    dip: (at) => {
      const before = meanBefore(at);
      return largest(at.x.map((v) => Math.abs(v - before)));
    },
    settling: (at) => {
      const out = outside(at, () => meanBefore(at)), end = out.at(-1);
      if (!out.length) return 0;
      return end >= 0.95 * (at.time.length - 1) ? null : Math.max(0, at.time[end] - at.m.event);
    },
    overshoot: (at) => {
      const end = mean(at.x.subarray(at.x.length - Math.max(1, Math.floor(at.x.length / 4))));
      let { x } = at, start = meanBefore(at);
      if (targetStays(at)) {
        const off = x.map((v) => Math.abs(v - start));
        const diverged = off.findIndex(Number.isNaN);
        x = x.subarray(diverged < 0 ? off.indexOf(largest(off)) : diverged);
        start = x[0];
      }
      const direction = end - start < 0 ? -1 : 1;
      return Math.max(0, largest(x.map((v) => direction * (v - end))));
    },
    exceeds: (at) => {
      const out = outside(at, () => mean(at.x.subarray(0, Math.max(1, Math.floor(at.x.length / 10)))));
      return out.length ? at.time[out[0]] : null;
    },
    "time-to-learn": ({ m, trace, part, first, last }) => {
      const x = part(m.signal, [first, last]), each = Math.max(1, even(m.smooth / trace.period));
      const pieces = Math.floor(x.length / each);
      if (!pieces) return NaN;
      let learned = pieces; // the first piece of those at the end that are within the band
      while (learned > 0 && Math.sqrt(mean(x.subarray((learned - 1) * each, learned * each).map((v) => v * v))) <= m.band) learned--;
      return learned === pieces ? null : learned * each * trace.period;
    },
    "copper-loss": ({ trace, about, first, last }) => {
      const d = trace.get("i_d").subarray(first, last), q = trace.get("i_q").subarray(first, last);
      return about.power_factor * about.R_s * mean(d.map((v, i) => v * v + q[i] * q[i]));
    },
    chattering: ({ trace, about, first, last, time }) => {
      const period = about.speed_period, slack = 1e-6 * trace.period;
      if (trace.period > period * (1 + 1e-6)) return NaN;
      const from = Math.ceil((time[0] - slack) / period), to = Math.floor((time[time.length - 1] + slack) / period);
      const asked = trace.get("i_q_ref"), samples = Float64Array.from({ length: to - from + 1 }, (_, i) => asked[Math.min(last - 1, trace.left((from + i) * period - slack))]);
      return samples.length < 2 ? NaN : mean(samples.subarray(1).map((v, i) => Math.abs(v - samples[i])));
    },
    "carriage-ripple": ({ m, trace, about, first, last, time }) => {
      const reference = trace.get("omega_ref").subarray(first, last);
      if (largest(reference) - smallest(reference) > REFERENCE_SPREAD_MOST * largest(reference.map(Math.abs))) return NaN;
      const x = trace.get(m.signal).subarray(first, last), middle = mean(x), t0 = mean(time);
      const t = time.map((v) => v - t0), angle = x.map((v) => v - middle);
      const slope = sum(t.map((v, i) => v * angle[i])) / (sum(t.map((v) => v * v)) || 1);
      const line = t.map((v) => slope * v), off = angle.map((v, i) => v - line[i]);
      const found = amplitudes(line, off, m.carriage_orders, 1, about.pole_pairs, true);
      return m.radius * Math.sqrt(sum(found.map((a) => a * a)) / 2);
    },
  };

  // Value of a metric in SI; a list for kind "order"; null: it never happened; undefined: the trace has no such signal.
  function evaluate(m, trace, about) {
    if (m.signal && !trace.has(m.signal)) return undefined;
    const at = input(m, trace, about);
    return at.first === at.last ? NaN : KINDS[m.kind](at);
  }
  // Rows over which a metric is judged, as src/cogless/report/speed_tracking.py has them: its window, from its event on, else
  // those of the last order metric, else the last quarter.
  function judged(m, metrics, trace, about) {
    const end = trace.count ? trace.time[trace.count - 1] : 0;
    if (declared(m, end) || m.event != null) return trace.window(...span(m, trace, about));
    const order = metrics.findLast((one) => one.kind === "order" && declared(one, end)?.[0] < end);
    if (order) return trace.window(...declared(order, end));
    return trace.window(Math.max(0.75 * end, ...about.events.filter((t) => t < end).map((t) => 0.5 * (t + end))), end);
  }
  // When a bit of the status was set in these rows: first and last time and how long, s; null: never.
  function held(bit, [first, last], trace) {
    if (!trace.has("status")) return null;
    const status = trace.get("status");
    let rows = 0, from = 0, to = 0;
    for (let i = first; i < last; i++) {
      if (!(status[i] & bit)) continue;
      if (!rows++) from = trace.time[i];
      to = trace.time[i];
    }
    return rows ? [from, to, rows * trace.period] : null;
  }
  // How the speed missed its reference in these rows, as src/cogless/results/held_speed.py judges it, rad/s: what it was
  // of what was wanted; null: it was held.
  function missed([first, last], trace, tracking) {
    if (first === last || !trace.has("omega_ref")) return null;
    const { torque } = tracking; // when an outer loop's current acts in place of the speed loop, s
    if (torque && trace.time[first] < torque[1] && trace.time[last - 1] > torque[0]) return null;
    const part = (name, from) => trace.get(name).subarray(from, last);
    const found = (from) => off(part("omega_ref", from), part("omega_m", from), tracking);
    return found(first + ((last - first) >> 1)) && found(first);
  }
  function off(wanted, got, { far, jerks, lost, drift, one_way }) {
    const size = mean(wanted.map(Math.abs)), middle = mean(wanted), turned = mean(got);
    if (!got.every(Number.isFinite)) return { kind: "speed", got: NaN, wanted: middle };
    const is_one_way = Math.abs(middle) > one_way * size;
    if (is_one_way && Math.abs(turned - middle) > far * size) {
      return { kind: "mean", got: Math.abs(turned) > 1e-3 * size ? turned : 0, wanted: middle };
    }
    const error = rms(got.map((v, i) => v - wanted[i])), amplitude = rms(wanted);
    return error > ((is_one_way ? jerks * size : lost * amplitude) || drift) ? { kind: "error, rms,", got: error, wanted: amplitude } : null;
  }
  // Root of the mean square of x.
  const rms = (x) => KINDS.rms({ x });
  // Metrics of a study of trials with one number for each phase, from the RMS of each trial; `starts`: the phases' first ones.
  const OF_PHASES = {
    "first-rms": (m, own) => own[0],
    "final-rms": (m, own) => rms(own.subarray(own.length - Math.max(1, even(own.length / 2)))),
    "trials-to-floor": (m, own) => {
      const n = own.findIndex((x) => x <= m.floor);
      return n < 0 ? Infinity : n + 1;
    },
  };
  const even = (x) => (x % 1 === 0.5 ? 2 * Math.round(x / 2) : Math.round(x)); // rounded as Python rounds
  function ofPhases(m, rmsOfTrials, starts) {
    const all = Float64Array.from(rmsOfTrials);
    return starts.map((start, n) => {
      const own = all.subarray(start - 1, starts[n + 1] - 1 || all.length);
      return own.length ? OF_PHASES[m.kind](m, own) : undefined;
    });
  }
  return { Trace, evaluate, judged, held, missed, ofPhases, rms, whole, kinds: Object.keys(KINDS), TAU, mean, largest, smallest };
})();
