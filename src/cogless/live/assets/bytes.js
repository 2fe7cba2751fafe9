"use strict";
// The engine's descriptions of all runs, as bytes, and changed values in their places (src/cogless/live/keys.py finds these).
const liveBytes = (page) => {
  const READ = { d: "getFloat64", f: "getFloat32", q: "getBigInt64", Q: "getBigUint64", I: "getUint32", i: "getInt32", H: "getUint16", B: "getUint8", "?": "getUint8" };
  const keys = new Map(page.keys.map((key) => [key.key, key]));
  const runs = new Map(Object.entries(page.runs).map(([place, run]) => [place, { ...run, data: liveBytes.of(run.bytes) }]));
  const read = (view, [offset, format]) => Number(view[READ[format]](offset, true));
  const write = (view, offset, format, x) => view[READ[format].replace("get", "set")](offset, "qQ".includes(format) ? BigInt(x) : x, true);
  const even = (x) => { // rounded as Python rounds
    const below = Math.floor(x), part = x - below;
    return part < 0.5 ? below : part > 0.5 ? below + 1 : below + (below % 2);
  };

  const share = (name, values) => (values.get(name) ?? keys.get(name).start) / keys.get(name).start;
  // R_s / L as a share of the study's; the curve over its logarithm, by Lagrange's polynomial (src/cogless/live/own_motor.py).
  const ratio = (values) => share(page.motor.over, values) / share(page.motor.under, values);
  const pairs = (values, key = keys.get(page.motor.pole_pairs)) => (values.get(key.key) ?? key.start) - key.least; // counted from the least
  function between(curve, at) {
    const { nodes } = page.motor, exact = nodes.indexOf(at);
    if (exact >= 0) return curve[exact];
    let above = 0, below = 0;
    curve.forEach((x, j) => {
      const weight = ((-1) ** j * Math.sin(((2 * j + 1) * Math.PI) / (2 * nodes.length))) / (at - nodes[j]);
      above += weight * x;
      below += weight;
    });
    return above / below;
  }

  // A run's description with these values, by key, in it. off: learning never starts.
  function described(place, values, off = false) {
    const run = runs.get(place), data = run.data.slice(), view = new DataView(data.buffer);
    for (const [offset, format, start, powers, factors, curve] of page.motor?.products[place] ?? []) {
      const all = [...Object.keys(powers), ...(factors.length ? [page.motor.pole_pairs] : []), ...(curve.length ? [page.motor.over, page.motor.under] : [])];
      if (!all.some((name) => values.has(name))) continue;
      let x = start;
      for (const [name, power] of Object.entries(powers)) x *= share(name, values) ** power;
      if (factors.length) x *= factors[pairs(values)];
      if (curve.length) x *= between(curve, Math.log(ratio(values)));
      write(view, offset, format, "fd".includes(format) ? x : even(x));
    }
    for (const [name, x] of values) {
      const key = keys.get(name);
      for (const [offset, format, ...how] of key.lands[place] ?? []) {
        if (key.stops.length) {
          const row = how[0][key.stops.indexOf(x)];
          write(view, offset, format, Array.isArray(row) ? row[pairs(values)] : row);
        } else {
          const si = (key.unit ? x * key.factor : x) * how[0];
          write(view, offset, format, how[1] ? even(si) : si);
        }
      }
    }
    if (off) write(view, ...run.off);
    return { data, view, run };
  }
  return { keys, runs, described, read, ratio };
};
liveBytes.of = (base64) => Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
