"use strict";
// What a page shows: a scenario, controllers, a trial, and the values that differ from the study's. The address holds all of it.
// number(x): x as text, for what is told about a value.
const liveState = (page, keys, ratio, number) => {
  const byName = liveState.byName;
  const state = { scenario: page.scenarios[0].name, shown: [], values: new Map(), trial: 0, sensor: 0 }; // values: by key, where not the study's; trial 0: the last
  const notes = new Map(); // by key, what was done with a value that the key does not take
  const scenario = () => byName(page.scenarios, state.scenario);
  const controllers = () => scenario().controllers.map((name) => byName(page.controllers, name));
  const value = (key) => state.values.get(key.key) ?? key.start;
  const usual = () => { // the baseline, and the first that learns
    const here = controllers();
    return [...new Set([here.find((c) => c.baseline), here.find((c) => c.learns), here[0]])].filter(Boolean).slice(0, 2).map((c) => c.name);
  };
  const within = (key) => (key.stops.length ? [key.stops[0], key.stops.at(-1)] : [key.least, key.most]);
  const bounds = (key) => `${within(key).map(number).join(" to ")} ${key.unit}`.trim();
  const milliseconds = (share) => `${number((1e3 * page.motor.time) / share)} ms`;
  const bounded = page.motor ? [page.motor.over, page.motor.under] : []; // keys that bound each other

  // With another sensor, whose place in the page's list is counted from 1, some keys have no place: they keep the study's value.
  const prefix = () => (state.sensor ? `${state.sensor}|` : "");
  const isFree = (key) => !state.sensor || Object.keys(key.lands).some((place) => place.startsWith(prefix()));
  const FIXED = "With this sensor it keeps the study's value";
  function choose(sensor) {
    state.sensor = Number.isInteger(sensor) && sensor > 0 && sensor <= (page.sensors ?? []).length ? sensor : 0;
    for (const name of [...state.values.keys()]) {
      if (isFree(keys.get(name))) continue;
      state.values.delete(name);
      refuse(keys.get(name), FIXED);
    }
  }

  // Why a key can't take a value, whatever the others are; "" if it can.
  function outside(key, x) {
    const [least, most] = within(key);
    return x >= least && x <= most ? "" : `${x} is outside ${bounds(key)}`;
  }
  // Why a key can't take a value beside the others' values; "" if it can.
  function clash(key, x) {
    if (!bounded.includes(key.key)) return "";
    const share = ratio(new Map(state.values).set(key.key, x)), [slow, fast] = page.motor.ends;
    return share >= slow && share <= fast ? "" : `with ${x}, L / R is ${milliseconds(share)}: this page allows ${milliseconds(fast)} to ${milliseconds(slow)}`;
  }
  const refuse = (key, why) => notes.set(key.key, `${why}. The value stays at ${value(key)}.`);
  // Gives a key the value, or the next one that it takes, which is told.
  function put(key, x) {
    let to = key.whole ? Math.round(x) : x;
    if (key.stops.length) to = key.stops.reduce((a, b) => (Math.abs(b - x) < Math.abs(a - x) ? b : a));
    if (to !== x) notes.set(key.key, `${x} became ${to}: this key has ${key.stops.length ? `${key.stops.length} values, ${bounds(key)}` : "whole numbers"}.`);
    if (to === key.start) state.values.delete(key.key); else state.values.set(key.key, to);
  }
  // A value that a key does not take leaves the key as it is, or goes to the next one that it takes; either is told.
  function set(key, x) {
    notes.delete(key.key);
    const why = (isFree(key) ? "" : FIXED) || outside(key, x) || clash(key, x);
    if (why) refuse(key, why); else put(key, x);
  }

  // The state of an address. Its values are put in together and then checked: of two that bound each other, either alone may clash.
  function fromAddress(text) {
    const given = new URLSearchParams(text.slice(1));
    state.scenario = byName(page.scenarios, given.get("scenario"))?.name ?? page.scenarios[0].name;
    const wanted = (given.get("controllers") ?? "").split("\n").filter((name) => scenario().controllers.includes(name));
    state.shown = wanted.length ? wanted : usual();
    state.trial = Number(given.get("trial")) || 0;
    state.values.clear();
    notes.clear();
    for (const [name, number] of given) {
      const key = keys.get(name), x = Number(number);
      if (!key || !number.trim() || !Number.isFinite(x)) continue;
      const why = outside(key, x);
      if (why) refuse(key, why); else put(key, x);
    }
    const together = bounded.filter((name) => state.values.has(name)).map((name) => keys.get(name));
    const clashes = together.map((key) => [key, clash(key, value(key))]).filter(([, why]) => why);
    for (const [key] of clashes) state.values.delete(key.key);
    for (const [key, why] of clashes) refuse(key, why);
    choose(Number(given.get("sensor")));
  }
  function address() {
    const all = new URLSearchParams({ scenario: state.scenario, controllers: state.shown.join("\n") });
    if (state.trial) all.set("trial", state.trial);
    if (state.sensor) all.set("sensor", state.sensor);
    for (const [name, x] of state.values) all.set(name, x);
    return `#${all}`;
  }
  return { state, notes, scenario, controllers, usual, value, within, bounds, set, prefix, isFree, choose, fromAddress, address };
};
liveState.byName = (list, name) => list.find((one) => one.name === name);
