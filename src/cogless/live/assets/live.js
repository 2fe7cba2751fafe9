"use strict";
// The page: values on the left, what the drive does with them on the right. The address holds all that was changed.
(() => {
  const page = JSON.parse(document.getElementById("data").textContent);
  const $ = (id) => document.getElementById(id);
  const root = document.documentElement;
  const colours = new Map(); // by name, until the scheme changes
  const style = (name) => {
    if (!colours.has(name)) colours.set(name, getComputedStyle(root).getPropertyValue(name).trim());
    return colours.get(name);
  };
  const make = (tag, parent, text = "", className = "") => {
    const element = parent.appendChild(document.createElement(tag));
    element.textContent = text;
    if (className) element.className = className;
    return element;
  };
  const number = (x) => (x == null || Number.isNaN(x) ? "–" : x === Infinity ? "never" : Math.abs(x) >= 1e5 || (x !== 0 && Math.abs(x) < 1e-4) ? x.toExponential(2) : String(Number(x.toPrecision(3))));
  const listed = (items) => (items.length < 2 ? items.join("") : `${items.slice(0, -1).join(", ")} and ${items.at(-1)}`);
  const byName = liveState.byName;

  // ------------------------------------------------------------------ state

  const { runs, keys, described, read, ratio } = liveBytes(page);
  const { state, notes, scenario, controllers, usual, value, within, bounds, set, prefix, isFree, choose: chooseSensor, fromAddress, address } = liveState(page, keys, ratio, number);
  const ofTrials = page.kind === "trials";
  for (const part of document.querySelectorAll("[data-kind]")) part.hidden = part.dataset.kind !== page.kind;
  const shown = () => controllers().filter((c) => state.shown.includes(c.name));
  let later = 0;
  const keepAddress = () => {
    clearTimeout(later);
    later = setTimeout(() => { if (location.hash !== address()) history.replaceState(null, "", address()); }, 150);
  };

  // ------------------------------------------------------------------ runs

  function job(name, off) {
    const place = `${prefix()}${state.scenario}/${name}`, { data, view, run } = described(`${place}/run`, state.values, off);
    const at = (what) => read(view, run.about[`page.${what}`]);
    if (ofTrials) {
      const starts = [], { metrics, judged, panels, phases } = scenario();
      for (let n = 0; run.about[`page.starts.${n}`]; n++) starts.push(at(`starts.${n}`));
      const last = at("trials"), chosen = [...phases.flatMap((phase) => phase.trials), last];
      return { description: data, ticks: at("ticks"), decimation: at("decimation"), about: { pole_pairs: at("pole_pairs"), events: [], trials: last, starts }, metrics, judged, panels, chosen };
    }
    const about = { events: [], guarded: page.guarded, tracking: { ...page.tracking, torque: scenario().torque }, ...Object.fromEntries(["pole_pairs", "R_s", "power_factor", "speed_period", "pwm_period", "unit"].map((what) => [what, at(what)])) };
    for (let n = 0; run.about[`page.events.${n}`]; n++) about.events.push(at(`events.${n}`));
    let learned = null, learn = null;
    if (run.learned) {
      const [from, channels, cells] = run.learned;
      learned = { channels, cells, values: Array.from({ length: channels * cells }, (_, n) => view.getFloat64(from + 8 * n, true)) };
    }
    if (runs.has(`${place}/learn`)) {
      const before = described(`${place}/learn`, state.values);
      learn = { description: before.data, ticks: read(before.view, before.run.about["page.ticks"]), divider: at("divider"), rate: scenario().rate, busy: page.busy };
    }
    return { description: data, ticks: at("ticks"), decimation: at("decimation"), learned, learn, about, metrics: scenario().metrics };
  }

  const workers = [];
  const done = new Map(); // by place: {job, result or error}, the newest; of trials that go on what there is, with part: true
  let asked = 0, running = 0;
  const same = (a, b) => a && b && a.length === b.length && a.every((x, i) => x === b[i]);
  const slot = (name, off) => `${state.scenario}/${name}${off ? "/off" : ""}`;
  const isThere = (name, off) => {
    const found = done.get(slot(name, off)), wanted = job(name, off);
    return found && !found.part && same(found.job.description, wanted.description) && same(found.job.learn?.description ?? [], wanted.learn?.description ?? []);
  };
  const bar = (c) => c.learns && runs.get(`${state.scenario}/${c.name}/run`).off;

  // The runs that are still to be done: those that are shown first, then the same with learning off, for the bars.
  function missing() {
    const all = [...shown().map((c) => [c.name, false]), ...shown().filter(bar).map((c) => [c.name, true])];
    return all.filter(([name, off]) => !isThere(name, off));
  }
  function go() {
    for (const worker of workers) {
      if (worker.busy) {
        // trials take seconds: those that nobody wants any more make room
        const [place, name, off] = worker.of, wanted = place === state.scenario && state.shown.includes(name);
        if (ofTrials && !(wanted && same(job(name, off).description, worker.job.description))) worker.postMessage({ stop: worker.id });
        continue;
      }
      const next = missing().find(([name, off]) => !workers.some((w) => w.busy === slot(name, off)));
      if (!next) break;
      const wanted = job(...next), at = slot(...next), id = ++asked, [, off] = next;
      Object.assign(worker, { busy: at, of: [state.scenario, ...next], job: wanted, id });
      running += 1;
      worker.onmessage = ({ data }) => {
        if (data.part) {
          done.set(at, { job: wanted, id, result: data.part, part: true });
          draw(!off);
          return;
        }
        worker.busy = null;
        running -= 1;
        if (data.result !== null) done.set(at, { job: wanted, id, result: data.result, error: data.error });
        go();
        draw(!off || pair()[0]?.off); // a run with learning off is mostly a number, no curve
      };
      worker.postMessage({ id, job: wanted });
    }
    $("state").className = "";
    $("state").textContent = running ? "Running." : "";
  }

  // ------------------------------------------------------------------ values

  const inputs = new Map();
  function drawKeys() {
    const box = $("keys"), open = new Set([...box.querySelectorAll("details[open]")].map((d) => d.dataset.group));
    const first = !box.childElementCount;
    box.textContent = "";
    inputs.clear();
    const groups = new Map();
    for (const key of page.keys) {
      if (key.scenario !== null && key.scenario !== state.scenario) continue;
      if (key.controller !== null && !state.shown.includes(key.controller)) continue;
      if (spare(key)) continue;
      const group = key.controller ?? key.group;
      groups.set(group, [...(groups.get(group) ?? []), key]);
    }
    let n = 0;
    for (const [group, list] of groups) {
      const details = make("details", box);
      details.dataset.group = group;
      const about = byName(page.controllers, group);
      const of = list[0].controller !== null && about;
      details.open = first ? Boolean(of) || ["Your motor", "Load and motion", "Trials"].includes(group) : open.has(group) || (of && !open.size);
      const summary = make("summary", details);
      const title = make("span", summary, of ? about.label : group, of ? "key" : "");
      if (of) title.style.setProperty("--colour", `var(--c${about.colour})`);
      for (const key of list) slide(details, key, `k${n++}`);
    }
    drawSpares(box, open.has("spares"));
    refreshKeys();
  }
  // Cogging orders that are added: each is two keys, which are shown while it has torque.
  const spare = (key) => /^cogging\.\d+\./.exec(key.key)?.[0];
  const spares = [...new Set(page.keys.map(spare).filter(Boolean))].map((name) => ({ order: keys.get(`${name}order`), torque: keys.get(`${name}torque`) }));
  const isAdded = ({ torque }) => value(torque) !== 0;
  function drawSpares(box, open) {
    if (!spares.length) return;
    const details = make("details", box), some = spares.filter(isAdded);
    details.dataset.group = "spares";
    details.open = open || some.length > 0;
    make("summary", details, "Cogging orders that you add");
    if (page.motor) make("p", details, "The controller does not know them.", "note");
    some.forEach((one, n) => {
      const box = make("div", details, "", "order");
      slide(box, one.order, `s${n}`);
      slide(box, one.torque, `t${n}`);
      press(box, "Remove", () => { set(one.torque, 0); set(one.order, one.order.start); });
    });
    const free = spares.find((one) => !isAdded(one));
    if (free) press(details, "Add a cogging order", () => { set(free.order, 6); set(free.torque, Number((free.torque.high / 5).toPrecision(2))); });
  }
  function press(box, text, change) {
    const button = make("button", box, text);
    button.type = "button";
    button.addEventListener("click", () => {
      begin();
      change();
      dragging = false;
      drawKeys();
      refresh();
    });
  }
  function slide(parent, key, id) {
    const row = make("div", parent, "", "slide");
    const label = make("label", row);
    if (key.words) label.append(key.words);
    const code = make("code", label);
    for (const word of key.label.split(/(?<=[._])/)) code.append(word, document.createElement("wbr"));
    label.htmlFor = id;
    label.title = key.key;
    const right = make("span", row);
    const field = make("input", right);
    Object.assign(field, { type: "number", id, min: within(key)[0], max: within(key)[1], step: key.whole ? 1 : "any" });
    field.setAttribute("aria-describedby", `${id}-note`);
    make("span", right, key.unit, "unit");
    const range = make("input", row);
    const stops = key.stops.length, span = key.high - key.low;
    Object.assign(range, { type: "range", min: stops ? 0 : key.low, max: stops ? stops - 1 : key.high, step: stops || key.whole ? 1 : span / 200 });
    range.setAttribute("aria-label", `${key.words || key.label} ${key.unit}`);
    range.addEventListener("input", () => {
      begin();
      set(key, stops ? key.stops[range.value] : Number(Number(range.value).toPrecision(4)));
      refresh(range);
    });
    range.addEventListener("change", () => { dragging = false; });
    let comma = false; // typed, which some browsers leave out: 1,9 becomes 19
    field.addEventListener("beforeinput", (event) => { comma ||= Boolean(event.data?.includes(",")); });
    field.addEventListener("change", () => {
      const leftOut = comma && !field.value.includes(".");
      comma = false;
      if (leftOut) notes.set(key.key, `Expected a decimal point in place of the comma. The value stays at ${value(key)}.`);
      else if (Number.isFinite(field.valueAsNumber)) {
        begin();
        set(key, field.valueAsNumber);
        dragging = false;
      } else notes.set(key.key, `Expected a number. The value stays at ${value(key)}.`);
      refresh();
    });
    const note = make("p", row, "", "bounds");
    note.id = `${id}-note`;
    inputs.set(key, { row, field, range, note });
  }
  function refreshKeys(source) {
    for (const [key, { row, field, range, note }] of inputs) {
      const x = value(key);
      field.value = x !== 0 && Math.abs(x) < 1e-4 ? x.toExponential() : x; // written out, its last digits would not be seen
      if (range !== source) range.value = key.stops.length ? key.stops.indexOf(x) : x;
      range.setAttribute("aria-valuetext", `${x} ${key.unit}`);
      field.disabled = range.disabled = !isFree(key);
      row.classList.toggle("fixed", !isFree(key));
      row.classList.toggle("changed", state.values.has(key.key));
      row.classList.toggle("told", notes.has(key.key));
      note.textContent = notes.get(key.key) ?? bounds(key);
    }
  }

  // The run before a change stays as a ghost, until the next change begins.
  let dragging = false, ghost = new Map();
  function begin() {
    if (dragging) return;
    dragging = true;
    ghost = new Map([...done].filter(([, found]) => found.result && !found.part));
  }
  function refresh(source) {
    refreshKeys(source);
    $("sensor").value = state.sensor;
    drawChanges();
    keepAddress();
    go();
  }

  // ------------------------------------------------------------------ what changed

  const changes = () => [...state.values].map(([name, x]) => ({ key: keys.get(name), x }));
  // The same as the study has it: key and text. With an added order all orders are one list of the scenario's own.
  const SENSOR = "drive.position_sensor";
  const OWN_ORDER = /motor\.cogging\.(\d+)\.(\w+)"?$/;
  function written() {
    const all = changes(), plain = all.filter(({ key }) => !spare(key)), added = spares.filter(isAdded);
    const texts = plain.map(({ key, x }) => ({ key, name: key.key, text: key.unit ? JSON.stringify(spelled(key, x)) : String(x), set: spelled(key, x) }));
    if (state.sensor) {
      const { text } = page.sensors[state.sensor - 1];
      texts.unshift({ key: { scenario: null, key: SENSOR }, name: SENSOR, text, set: text });
    }
    if (!added.length) return texts;
    const rows = page.cogging[state.scenario].map((row) => ({ ...row }));
    for (const { key, text } of texts) {
      const at = OWN_ORDER.exec(key.key);
      if (at) rows[at[1]][at[2]] = text;
    }
    rows.push(...added.map(({ order, torque }) => ({ order: String(value(order)), torque: JSON.stringify(spelled(torque, value(torque))) })));
    const text = `[${rows.map((row) => `{ ${Object.entries(row).map(([k, v]) => `${k} = ${v}`).join(", ")} }`).join(", ")}]`;
    const rest = texts.filter(({ key }) => !(key.scenario === state.scenario && OWN_ORDER.test(key.key)));
    return [...rest, { name: `${dotted(["scenario", state.scenario])}.override."motor.cogging"`, text, set: text }];
  }
  const quoted = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", `'"'"'`)}'`);
  const spelled = (key, x) => (key.unit ? `${x} ${key.unit}` : String(x));
  function drawChanges() {
    const box = $("changes"), all = changes();
    box.textContent = "";
    $("limit").textContent = all.length || state.sensor ? "" : scenario().limit; // it was found for the study's own values
    if (!all.length && !state.sensor) make("p", box, "Nothing: these are the study's values.");
    else {
      const list = make("ul", box);
      if (state.sensor) {
        const item = make("li", list);
        make("code", item, SENSOR);
        item.append(`: ${page.sensors[state.sensor - 1].words}`);
      }
      for (const { key, x } of all) {
        const item = make("li", list);
        make("code", item, key.key);
        item.append(spare(key) ? `: ${spelled(key, x)}, added` : `: ${spelled(key, x)}, in the study ${spelled(key, key.start)}`);
      }
    }
    const only = shown().flatMap((c) => ["--only", quoted(`${state.scenario}/${c.name}`)]);
    const sets = [...pinned(all), ...written().map(({ name, set }) => `${name}=${set}`)].flatMap((set) => ["--set", quoted(set)]);
    $("command").textContent = [page.command, ...sets, ...only].join(" ");
    $("download").download = `${page.name}-changed.toml`;
    for (const button of $("scenarios").children) button.setAttribute("aria-pressed", String(button.dataset.name === state.scenario));
    for (const button of $("controllers").children) {
      const runs = state.shown.includes(button.dataset.name);
      button.setAttribute("aria-pressed", String(runs));
      button.title = runs ? "Runs. Click to leave it out." : "Does not run, which saves time. Click to run it, too.";
    }
  }

  // What the page holds at the value that the design chose, as far as a changed key would change it otherwise.
  function pinned(all) {
    const keys = all.map(({ key }) => key.key), owners = all.map(({ key }) => key.controller);
    const design = keys.some((key) => key.startsWith("design."));
    const own = (key) => owners.some((name) => name != null && split(key)[1] === name);
    return page.pins.filter(([key]) => !keys.includes(key) && (design || own(key))).map(([, set]) => set);
  }

  // Parts of a dotted key, as the study's reader splits it.
  const split = (key) => key.split('"').flatMap((piece, n) => (n % 2 ? [piece] : piece.split(".").filter(Boolean)));
  const dotted = (parts) => parts.map((p) => (/^[\w-]+$/.test(p) ? p : JSON.stringify(p))).join(".");
  function toml() {
    const all = changes(), texts = page.toml.map((s) => ({ ...s, lines: s.lines.map(([k, v]) => [k, v.map((p) => (Array.isArray(p) ? [...p] : p))]) }));
    for (const { name: path, text } of written()) {
      const parts = split(path), section = texts.filter((s) => s.path.every((p, i) => p === parts[i])).at(-1);
      const name = dotted(parts.slice(section.path.length));
      if (path === SENSOR) section.lines = section.lines.filter(([k]) => k !== name && !k.startsWith(`${name}.`));
      const line = section.lines.find(([k]) => k === name), pieces = section.lines.flatMap(([, v]) => v);
      const piece = pieces.find((p) => p[0] === name && Array.isArray(p));
      if (piece) piece[1] = text;
      else if (line) line[1] = [text];
      else section.lines.push([name, [text]]);
    }
    const about = ["# Changed in the live page:", ...(state.sensor ? [`#   ${SENSOR}: ${page.sensors[state.sensor - 1].words}`] : []), ...all.map(({ key, x }) => `#   ${key.key} = ${spelled(key, x)} (was ${spelled(key, key.start)})`), `# ${$("command").textContent}`, ""];
    return about.concat(texts.map(({ heading, lines }) => [...(heading ? [`[${heading}]`] : []), ...lines.map(([k, v]) => `${k} = ${v.map((p) => (Array.isArray(p) ? p[1] : p)).join("")}`), ""].join("\n"))).join("\n");
  }

  // ------------------------------------------------------------------ what it does

  const found = (name, off = false, from = done) => from.get(slot(name, off))?.result;
  const TOTALS = ["ripple-rms", "rms", "three-sigma", "peak-to-peak"];
  const judged = () => scenario().metrics.findIndex((m) => TOTALS.includes(m.kind) && m.better === "lower");
  const rpm = (x) => (x == null ? null : (x * 30) / Math.PI);

  // The time from which on a run's errors stay above those with learning off; null: they don't, or do from the beginning.
  function worseSince(mine, base) {
    const count = Math.min(mine.length, base.length), worse = Array.from({ length: count }, (_, i) => !(mine[i] <= 1.05 * base[i]));
    if (count < 3 || !worse.at(-1) || worse.every(Boolean)) return null;
    return 2 * (1 + worse.lastIndexOf(false));
  }

  function drawVerdict() {
    const list = $("verdicts"), which = judged();
    list.textContent = "";
    for (const c of shown()) {
      const run = done.get(slot(c.name, false));
      if (!run) continue;
      const item = make("li", list), head = make("p", item, "", "headline"), off = found(c.name, true);
      const label = make("span", head, c.label, "key");
      label.style.setProperty("--colour", `var(--c${c.colour})`);
      if (run.error) {
        item.className = "worse";
        head.append(`: ${run.error}.`);
        continue;
      }
      if (ofTrials) {
        tellTrials(c, run, item, head, off);
        continue;
      }
      const metric = scenario().metrics[which];
      if (!metric) continue;
      const gone = run.result.missed[which];
      if (gone) {
        item.className = "worse";
        head.append(` did not hold the speed: ${gone.kind} ${number(rpm(gone.got))} of ${number(rpm(gone.wanted))} r/min.`);
        continue;
      }
      const x = run.result.values[which] / metric.factor, words = metric.titles[0], unit = metric.unit.replace("rpm", "r/min");
      head.append(`: ${number(x)} ${unit} of ${words}`);
      if (off && off.missed[which]) {
        item.className = "better";
        head.append(". With learning off it did not hold the speed.");
      } else if (off) {
        const base = off.values[which] / metric.factor, ratio = base / x;
        item.className = ratio > 1.05 ? "better" : ratio < 0.95 ? "worse" : "";
        const how = ratio > 1.05 ? `${number(ratio)} times less than` : ratio < 0.95 ? `${number(1 / ratio)} times as much as` : "as much as";
        head.append(`, ${how} with learning off (${number(base)} ${unit}).`);
        const since = worseSince(run.result.errors, off.errors);
        if (since !== null) {
          item.className = "worse";
          make("p", item, `It gets worse with time: until ${since} s it is no worse than without learning, then it is worse.`, "fault");
        }
      } else head.append(c.learns ? "." : "; it does not learn.");
      const [from, to, long] = (c.learns && run.result.guarded[which]) || [0, 0, 0];
      if (long >= page.moment) make("p", item, `The guard held back its learning from ${number(from)} to ${number(to)} s (frozen, gentler or without effect): a part of its ${words} is from this time.`, "fault");
      const before = found(c.name, false, ghost);
      if (before && before !== run.result) make("p", item, `Before the change: ${number(before.values[which] / metric.factor)} ${unit}.`, "details");
    }
  }

  // The RMS over the last half of the last phase, beside that of the same law with learning off.
  function tellTrials(c, run, item, head, off) {
    const { judged } = scenario();
    if (run.part) {
      head.append(`: ${run.result.errors.length} of ${run.result.of} trials.`);
      return;
    }
    const settled = (result) => result.settled.at(-1) / judged.factor;
    const told = (x) => `${number(x)} ${judged.unit}`.trim(), x = settled(run.result);
    head.append(`: ${told(x)} of ${judged.quantity} (RMS) at the end`);
    if (off && !done.get(slot(c.name, true)).part) {
      const base = settled(off), ratio = base / x;
      item.className = ratio > 1.05 ? "better" : ratio < 0.95 ? "worse" : "";
      const how = ratio > 1.05 ? `${number(ratio)} times less than` : ratio < 0.95 ? `${number(1 / ratio)} times as much as` : "as much as";
      head.append(`, ${how} with learning off (${told(base)}).`);
    } else head.append(c.learns ? "." : "; it does not learn.");
    if (judged.floor) {
      const floor = `the floor of ${told(judged.floor)}`, counts = run.result.counts.map(number);
      const all = counts.length > 1 ? `${listed(counts)} trials, one number for each change` : `${counts[0]} trials`;
      make("p", item, counts.every((n) => n === "never") ? `It never reaches ${floor}.` : `To ${floor}: ${all}.`, "details");
    }
    const before = found(c.name, false, ghost);
    if (before && before !== run.result) make("p", item, `Before the change: ${told(settled(before))}.`, "details");
  }

  // ------------------------------------------------------------------ the answer

  // Before and after: the baseline, or else a law with learning off, and the best of the others that run.
  function pair() {
    const { metrics } = scenario(), which = judged(), metric = metrics[which];
    const one = (c, off) => ({ c, off, label: off ? `${c.label}, learning off` : c.label, run: found(c.name, off) });
    const settled = (r) => (ofTrials ? (r.settled.at(-1) ?? NaN) / scenario().judged.factor : metric && !r.missed[which] ? r.values[which] / metric.factor : null);
    const told = (x) => (x.run ? { ...x, value: settled(x.run), colour: x.off ? "--c0" : `--c${x.c.colour}` } : null);
    const all = shown().map((c) => told(one(c, false))).filter(Boolean), base = all.find((x) => x.c.baseline);
    const others = all.filter((x) => x !== base).sort((a, b) => (a.value ?? Infinity) - (b.value ?? Infinity));
    const after = others[0] ?? base, off = after && bar(after.c) && told(one(after.c, true));
    return [base && base !== after ? base : off, after].filter(Boolean);
  }
  function drawAnswer() {
    const two = pair(), box = $("figures"), metric = scenario().metrics[judged()];
    const unit = ofTrials ? scenario().judged.unit : (metric?.unit ?? "").replace("rpm", "r/min");
    box.textContent = "";
    box.parentElement.className = "answer";
    for (const { label, value, colour } of two) {
      const item = make("p", box, "", "figure"), name = make("span", item, label, "key");
      item.style.setProperty("--colour", `var(${colour})`);
      name.after(" ");
      make("strong", item, value == null ? "lost" : number(value));
      item.append(value == null ? " the speed" : ` ${unit}`);
    }
    if (!two.length) return;
    const change = make("p", box, "", "change"), [x, y] = [two[0].value, two.at(-1).value], ratio = two.length > 1 && x != null && y != null ? x / y : null;
    if (ratio != null) make("strong", change, ratio > 1.05 ? `${number(ratio)} times less` : ratio < 0.95 ? `${number(1 / ratio)} times as much` : "as much");
    make("span", change, ofTrials ? `RMS of the ${scenario().judged.quantity} at the end` : metric?.titles[0] ?? "");
    if (ratio != null) box.parentElement.classList.add(ratio > 1.05 ? "better" : ratio < 0.95 ? "worse" : "even");
  }
  // The strongest order of a revolution, or the highest that is nearly as strong: how often the curve goes up and down.
  function cycles(run) {
    const top = Math.max(...(run.orders ?? [0]));
    return 1 + (run.orders ?? []).findLastIndex((a) => a >= 0.3 * top);
  }
  function drawPicture() {
    const two = pair().filter((x) => x.run.revolution), box = $("picture");
    rotors.show(two.map((x) => ({ label: x.label, colour: x.colour, motion: x.run.motion }))); // first: they take a part of the picture's width
    const curve = (x, run, more) => ({ label: x.label, colour: style(x.colour), dash: false, values: run.revolution.map(rpm), ...more });
    if (two.length) {
      const last = two.at(-1), before = found(last.c.name, last.off, ghost), xs = last.run.revolution.map((_, n) => (360 * n) / (last.run.revolution.length - 1));
      const width = Math.max(200, box.clientWidth - 90), share = 1 / (PARTS.find((n) => n * width >= CYCLE * cycles(two[0].run)) ?? PARTS.at(-1));
      const old = before && before !== last.run && before.revolution ? [curve(last, before, { label: "", dash: true })] : [];
      const series = [...old, ...two.map((x, n) => curve(x, x.run, { width: n ? 2.2 : 1.4 }))];
      chart(box, "picture:turn", { title: "Speed over the rotor's angle, in the last revolution", x: "angle of the rotor (°)", y: "speed (r/min)", from: 0, to: 360 * share, xs, series });
    } else drop("picture:turn");
    const ripples = shown().map((c) => found(c.name)?.ripple.values ?? []).flat().filter((x) => x > 0);
    const log = Math.max(...ripples) > 10 * Math.min(...ripples);
    lines($("ripple"), "ripple:time", { title: "Speed ripple, rms of the last revolution, over time", x: "time (s)", y: "ripple, rms (r/min)", log },
      ({ ripple }) => ({ at: ripple.at, values: ripple.values.map((x) => (log && !(x > 0) ? null : rpm(x))) }));
  }

  // Two rotors that turn as the runs' rotors did in their last revolution, slower if that is fast.
  const rotors = (() => {
    const SLOWEST = 8; // s for a revolution, so that one sees it jerk
    const still = matchMedia("(prefers-reduced-motion: reduce)");
    let list = [], turns = !still.matches, begun = 0, frame = 0;
    const at = ({ time, angle }, t) => {
      let low = 0, high = time.length - 1;
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (time[middle] > t) high = middle; else low = middle;
      }
      const share = Math.min(1, Math.max(0, (t - time[low]) / (time[high] - time[low] || 1)));
      return angle[low] + share * (angle[high] - angle[low]);
    };
    function paint(now) {
      frame = 0;
      const canvas = $("rotor"), { clientWidth: width, clientHeight: height } = canvas, px = devicePixelRatio, down = height > width;
      if (!width || !list.length) return;
      if (canvas.width !== Math.round(width * px)) Object.assign(canvas, { width: Math.round(width * px), height: Math.round(height * px) });
      const ctx = canvas.getContext("2d"), size = Math.min(width, height, Math.max(width, height) / 2), radius = size / 2 - 22;
      ctx.setTransform(px, 0, 0, px, 0, 0);
      ctx.clearRect(0, 0, width, height);
      list.forEach(({ label, colour, motion }, n) => {
        const [cx, cy] = down ? [width / 2, size * (n + 0.5) + n * 10] : [size * (n + 0.5), size / 2];
        const long = motion.time.at(-1) || 1, slow = Math.max(1, SLOWEST / long);
        const angle = at(motion, turns ? (((now - begun) / 1000) / slow) % long : 0);
        ctx.lineWidth = 2;
        ctx.strokeStyle = style("--line");
        ctx.fillStyle = style("--card");
        ctx.beginPath();
        ctx.arc(cx, cy, radius, 0, 2 * Math.PI);
        ctx.fill();
        ctx.stroke();
        for (let pole = 0; pole < 14; pole++) {
          const [from, to] = [angle + (pole * Math.PI) / 7, angle + ((pole + 0.8) * Math.PI) / 7];
          ctx.beginPath();
          ctx.lineWidth = 9;
          ctx.globalAlpha = pole % 2 ? 0.35 : 0.9;
          ctx.strokeStyle = style(colour);
          ctx.arc(cx, cy, radius - 7, -to, -from);
          ctx.stroke();
        }
        ctx.globalAlpha = 1;
        ctx.lineWidth = 3;
        ctx.beginPath();
        ctx.moveTo(cx, cy);
        ctx.lineTo(cx + (radius - 16) * Math.cos(angle), cy - (radius - 16) * Math.sin(angle));
        ctx.stroke();
        ctx.fillStyle = style("--ink");
        ctx.font = FONT;
        ctx.textAlign = "center";
        ctx.fillText(label.length > 22 ? `${label.slice(0, 21)}…` : label, cx, cy + radius + 16);
      });
      if (turns) frame = requestAnimationFrame(paint);
    }
    function next() { frame ||= requestAnimationFrame(paint); }
    function say() {
      $("turn-rotor").textContent = turns ? "Stop" : "Turn";
      const long = Math.max(...list.map((x) => x.motion.time.at(-1) || 1), 0), slow = SLOWEST / (long || 1);
      $("rotor-note").textContent = slow > 1.05 ? `The rotors of both runs, ${number(slow)} times slower` : "The rotors of both runs";
      $("rotor").setAttribute("aria-label", `Rotors: ${listed(list.map((x) => x.label))}`);
    }
    function show(now) {
      list = now.filter((x) => x.motion.time.length > 1);
      $("rotors").hidden = !list.length;
      say();
      next();
    }
    $("turn-rotor").addEventListener("click", () => { turns = !turns; begun = performance.now(); say(); next(); });
    still.addEventListener("change", () => { turns = !still.matches; say(); next(); });
    return { show };
  })();

  function drawNumbers() {
    const table = $("numbers");
    table.textContent = "";
    const columns = shown().flatMap((c) => [{ c, off: false }, ...(bar(c) ? [{ c, off: true }] : [])]);
    const head = make("tr", make("thead", table));
    make("th", head, "");
    for (const { c, off } of columns) {
      const cell = make("th", head, "", off ? "off" : "");
      cell.scope = "col";
      const label = make("span", cell, off ? `${c.label}, learning off` : c.label, "key");
      label.style.setProperty("--colour", off ? "var(--line)" : `var(--c${c.colour})`);
    }
    const body = make("tbody", table);
    scenario().metrics.forEach((metric, m) => metric.titles.forEach((title, k) => {
      const row = make("tr", body);
      make("th", row, metric.unit ? `${title} [${metric.unit.replace("rpm", "r/min")}]` : title).scope = "row";
      const of = (result) => (result ? worst(metric, [].concat(result.values[m]).slice(...(metric.groups?.[k] ?? [k, k + 1]))) : undefined);
      for (const { c, off } of columns) {
        const x = of(found(c.name, off)), was = of(found(c.name, off, ghost));
        const cell = make("td", row, x === undefined ? "" : number(x == null ? x : x / metric.factor), off ? "off" : "");
        if (x != null && was != null && was !== x) make("span", cell, `was ${number(was / metric.factor)}`, "was");
      }
    }));
  }

  // The worst of a metric's values in phases that are one row; the value itself if the row has one.
  function worst(metric, values) {
    if (values.length < 2 || values.some((x) => x == null)) return values.find((x) => x == null) ?? values[0];
    return metric.better === "higher" ? Math.min(...values) : Math.max(...values);
  }

  // ------------------------------------------------------------------ plots

  const FONT = "12px system-ui, sans-serif";
  const plots = new Map();
  const axis = (label, side) => ({
    label, side, labelSize: 20, labelFont: FONT, font: FONT, size: side === 3 ? 58 : 34, labelGap: 0,
    stroke: style("--soft"), grid: { stroke: style("--grid"), width: 1 }, ticks: { stroke: style("--grid"), width: 1, size: 4 },
  });
  // A chart; `series`: [{label, colour, dash, faint, values}] over xs. It is painted while it is in sight, or nearly, and made
  // anew only if the number of series changes.
  function chart(box, name, about) {
    let panel = plots.get(name);
    if (!panel?.card.isConnected) {
      const card = make("div", box, "", "panel"), head = make("header", card), heading = make("strong", head);
      panel = { name, card, heading, readout: make("span", head, "", "readout"), space: make("div", card, "", "plot") };
      panel.space.setAttribute("role", "img");
      panel.space.style.minHeight = `${about.height ?? HEIGHT}px`;
      const { top, bottom } = card.getBoundingClientRect();
      panel.near = top < innerHeight + NEAR && bottom > -NEAR;
      plots.set(name, panel);
      inSight.observe(card);
    }
    panel.about = about;
    panel.heading.textContent = about.title;
    panel.space.setAttribute("aria-label", `${about.title}; ${about.y} over ${about.x}`);
    if (panel.near) paint(panel);
  }
  const HEIGHT = 360, NEAR = 200; // pixels
  const CYCLE = 9; // px of what goes up and down once: with less, lines become a block
  const PARTS = [1, 2, 3, 4, 6, 8, 12, 18, 24, 36]; // of a revolution
  const inSight = new IntersectionObserver((seen) => {
    for (const { target, isIntersecting } of seen) {
      const panel = [...plots.values()].find(({ card }) => card === target);
      if (!panel) continue;
      panel.near = isIntersecting;
      if (isIntersecting) paint(panel);
    }
  }, { rootMargin: `${NEAR}px` });
  addEventListener("beforeprint", () => { for (const panel of plots.values()) paint(panel); });

  function paint(panel) {
    if (panel.painted === panel.about) return;
    const { about, readout, space } = panel, { title, x, y, xs, series, height = HEIGHT, log = false, from = null, to = null } = about;
    const data = [xs, ...series.map((s) => s.values)], look = JSON.stringify([title, y, log, from, to, series.map((s) => [s.label, s.colour, s.dash])]);
    panel.painted = about;
    if (panel.look === look) {
      panel.plot.setData(data);
      return;
    }
    panel.plot?.destroy();
    panel.look = look;
    panel.plot = new uPlot({
      width: Math.max(240, space.clientWidth || 600), height, legend: { show: false }, scales: { x: { time: false, range: (u, low, high) => (low === xs[0] && from != null ? [from, to] : [low, high]) }, y: { distr: log ? 3 : 1 } },
      cursor: { drag: { x: true, y: false }, points: { show: false }, sync: { key: panel.name.split(":")[0] } },
      axes: [axis(x, 2), axis(y, 3)],
      series: [{}, ...series.map((s) => ({ stroke: s.colour, width: s.width ?? (s.dash ? 1 : 1.5), dash: s.dash ? [5, 4] : undefined, alpha: s.dash ? 0.7 : 1, points: { show: false }, spanGaps: true }))],
      hooks: { setCursor: [(u) => {
        readout.textContent = "";
        const i = u.cursor.idx, now = panel.about.series;
        if (i == null) return;
        make("span", readout, `${number(u.data[0][i])}`);
        now.forEach((s, k) => {
          if (!s.label || u.data[k + 1][i] == null) return;
          make("span", readout, `${s.label} ${number(u.data[k + 1][i])}`, "key").style.setProperty("--colour", s.colour);
        });
      }] },
    }, data, space);
  }
  function drop(name) {
    const panel = plots.get(name);
    if (!panel) return;
    inSight.unobserve(panel.card);
    panel.plot?.destroy();
    panel.card.remove();
    plots.delete(name);
  }

  // Curves of several runs on one axis. Mostly the times of one are the last of another's; if not, all are sorted together.
  function joined(curves) {
    const longest = curves.reduce((a, c) => (c.at.length > a.length ? c.at : a), []), count = longest.length;
    const ends = ({ at }) => !at.length || (at[0] === longest[count - at.length] && at.at(-1) === longest.at(-1));
    if (!curves.every(ends)) return uPlot.join(curves.map((c) => [c.at, c.values]));
    return [longest, ...curves.map(({ values }) => (values.length === count ? values : [...Array(count - values.length).fill(null), ...values]))];
  }
  // Of each controller the run before the last change and the newest one; either may be empty.
  function curves(pick) {
    const none = { at: [], values: [] };
    return shown().flatMap((c) => {
      const colour = style(`--c${c.colour}`), now = found(c.name), before = found(c.name, false, ghost);
      const of = (run) => (run ? { ...none, ...pick(run, c) } : none);
      return [{ label: "", colour, dash: true, ...of(before === now ? null : before) }, { label: c.label, colour, dash: false, ...of(now) }];
    });
  }
  function lines(box, name, about, pick, more = []) {
    const all = [...more.filter((c) => c.values?.length), ...curves(pick)].map((c) => (c.values?.length ? c : { ...c, at: [], values: [] }));
    if (!all.some((c) => c.values.length)) {
      drop(name);
      return;
    }
    const [xs, ...ys] = joined(all);
    chart(box, name, { ...about, xs, series: all.map((c, i) => ({ ...c, values: ys[i] })) });
  }

  // The error over one trial of the best controller: the first, faint, and the last one that there is.
  function drawOneTrial(best) {
    const { judged, panels } = scenario(), n = panels.findIndex((p) => p.signal === judged.signal);
    const trials = Object.keys(best?.run.curves ?? {}).map(Number).filter((t) => best.run.curves[t][n]?.values).sort((a, b) => a - b);
    if (n < 0 || !trials.length) {
      drop("picture:trial");
      return;
    }
    const ends = [...new Set([trials[0], trials.at(-1)])], colour = style(best.colour);
    const curve = (t, k) => ({ label: `trial ${t}`, colour: k < ends.length - 1 ? `${colour}80` : colour, width: k < ends.length - 1 ? 1.4 : 2.2, at: best.run.curves[t][n].at, values: best.run.curves[t][n].values.map((x) => x / panels[n].factor) });
    const both = ends.map(curve), [xs, ...ys] = joined(both), { quantity, unit } = panels[n];
    const title = `${judged.quantity[0].toUpperCase()}${judged.quantity.slice(1)} over one trial of ${best.label}: ${ends.join(" against ")}`;
    chart($("picture"), "picture:trial", { title, x: "time in the trial (s)", y: unit ? `${quantity} (${unit})` : quantity, xs, series: both.map((c, k) => ({ ...c, values: ys[k] })) });
  }

  function drawTrials() {
    const { judged, phases, panels } = scenario(), unit = (u) => (u ? ` (${u})` : "");
    const all = shown().map((c) => found(c.name)).filter(Boolean);
    if (!all.length) return;
    const count = Math.max(...all.map((run) => run.errors.length));
    const floor = judged.floor ? [{ label: "floor", colour: style("--ink"), dash: true, at: [1, Math.max(2, count)], values: [judged.floor, judged.floor] }] : [];
    const numbers = (x) => Array.from(x, (_, n) => n + 1);
    drawOneTrial(pair().at(-1));
    lines($("trials"), "trials:error", { title: `RMS of the ${judged.quantity} in each trial`, x: "trial", y: `RMS${unit(judged.unit)}`, log: true, height: 440 },
      (run) => ({ at: numbers(run.errors), values: run.errors.map((x) => (x > 0 && Number.isFinite(x) ? x / judged.factor : null)) }), floor);
    scenario().metrics.forEach((m, n) => {
      if (m.titles.length || (m.kind === "rms" && m.signal === judged.signal)) return;
      lines($("trials"), `trials:${m.name}`, { title: m.name, x: "trial", y: m.unit || m.kind }, (run) => ({ at: numbers(run.values[n]), values: run.values[n].map((x) => x / m.factor) }));
    });
    const choices = [...new Set([...phases.flatMap((p) => p.trials), ...all.map((run) => run.of)])].filter((n) => all.some((run) => n <= run.of));
    const trial = choices.includes(state.trial) ? state.trial : choices.at(-1);
    if (choices.join() !== $("trial").dataset.choices) {
      $("trial").dataset.choices = choices.join();
      $("trial").textContent = "";
      choose(choices.map((n) => ({ name: n, label: String(n) })), $("trial"), (n) => { state.trial = n; keepAddress(); draw(); });
    }
    for (const button of $("trial").children) button.setAttribute("aria-pressed", String(Number(button.dataset.name) === trial));
    panels.forEach((panel, n) => {
      const of = (run) => run.curves[trial]?.[n], scaled = (curve) => ({ at: curve?.at, values: curve?.values?.map((x) => x / panel.factor) });
      const reference = all.map(of).find((curve) => curve?.reference)?.reference;
      const more = reference ? [{ label: "reference", colour: style("--ink"), dash: true, ...scaled(reference) }] : [];
      lines($("within"), `within:${panel.signal}`, { title: panel.title.split(",")[0], x: "time in the trial (s)", y: `${panel.quantity}${unit(panel.unit)}` }, (run) => scaled(of(run)), more);
    });
  }

  function drawPlots() {
    if (ofTrials) {
      drawTrials();
      return;
    }
    const first = shown().map((c) => found(c.name)).find(Boolean);
    if (!first) return;
    drawPicture();
    const degrees = (run) => run.turn.time.map((t) => t - run.turn.time.at(-1));
    const reference = { label: "reference", colour: style("--ink"), dash: false, at: degrees(first), values: first.turn.wanted?.map(rpm) };
    const ago = "time before the end (s)";
    lines($("turn"), "turn:speed", { title: "Speed", x: ago, y: "r/min" }, (run) => ({ at: degrees(run), values: run.turn.speed.map(rpm) }), [reference]);
    lines($("turn"), "turn:current", { title: "Current", x: ago, y: "i_q (A)" }, (run) => ({ at: degrees(run), values: run.turn.current }));
    lines($("turn"), "turn:torque", { title: "Motor torque", x: ago, y: "mN m" }, (run) => ({ at: degrees(run), values: run.turn.torque?.map((t) => 1e3 * t) }));
    lines($("orders"), "orders:speed", { title: "Speed", x: "order of the mechanical revolution", y: "amplitude (r/min)" }, (run) => {
      const spikes = (run.orders ?? []).flatMap((a, n) => [[n + 0.75, 0], [n + 1, rpm(a)], [n + 1.25, 0]]);
      return { at: spikes.map((s) => s[0]), values: spikes.map((s) => s[1]) };
    });
    const error = first.error === "theta_error" ? { title: "Angle error", y: "mrad", of: (x) => 1e3 * x } : { title: "Speed error", y: "r/min", of: rpm };
    lines($("whole"), "whole:error", { ...error, x: "time (s)" }, (run) => ({ at: run.whole.at, values: run.whole.values.map(error.of) }));
    lines($("whole"), "whole:current", { title: "Current", x: "time (s)", y: "i_q (A)" }, (run) => ({ at: run.current.at, values: run.current.values }));
    $("map").parentElement.hidden = false; // a hidden plot has no width
    lines($("map"), "map:current", { title: "Learned current", x: "angle of the rotor (deg)", y: "A" }, learnedOf);
    $("map").parentElement.hidden = !plots.has("map:current");
  }
  // The first channel of what is learned, as a current over the angle.
  function learnedOf(run, c) {
    if (!run.map) return {};
    const { cells, channels, values } = run.map;
    if (c.by_order) {
      const waves = Array.from({ length: cells }, (_, n) => [values[n], values[cells + n], values[2 * cells + n]]);
      const points = 8 * Math.round(Math.max(...waves.map((w) => w[2])));
      const at = Array.from({ length: points }, (_, k) => (2 * Math.PI * k) / points);
      return { at: at.map((a) => (a * 180) / Math.PI), values: at.map((a) => waves.reduce((s, [x, y, n]) => s + x * Math.cos(n * a) + y * Math.sin(n * a), 0)) };
    }
    const own = values.slice(0, cells), every = Math.max(1, Math.floor(cells / 1024));
    const kept = own.map((v, k) => [(360 * c.turn * k) / cells, v]).filter((_, k) => k % every === 0);
    return channels ? { at: kept.map((p) => p[0]), values: kept.map((p) => p[1]) } : {};
  }

  let drawn = 0, withPlots = false;
  function draw(plots = true) {
    withPlots ||= plots;
    if (drawn) return;
    drawn = requestAnimationFrame(() => {
      drawn = 0;
      drawAnswer();
      drawVerdict();
      drawNumbers();
      if (withPlots) drawPlots();
      withPlots = false;
    });
  }

  // ------------------------------------------------------------------ buttons

  function choose(list, box, pressed) {
    for (const one of list) {
      const button = make("button", box, one.label ?? one.name);
      button.type = "button";
      button.dataset.name = one.name;
      if (one.colour !== undefined) button.style.setProperty("--colour", `var(--c${one.colour})`);
      button.addEventListener("click", () => pressed(one.name));
    }
  }
  function another() {
    ghost = new Map();
    dragging = false;
    buttons();
    drawKeys();
    refresh();
    draw();
  }
  function buttons() {
    $("controllers").textContent = "";
    choose(controllers(), $("controllers"), (name) => {
      const next = state.shown.includes(name) ? state.shown.filter((n) => n !== name) : [...state.shown, name];
      if (next.length) state.shown = next;
      another();
    });
  }
  choose(page.scenarios, $("scenarios"), (name) => {
    state.scenario = name;
    state.shown = state.shown.filter((n) => scenario().controllers.includes(n));
    if (!state.shown.length) state.shown = usual();
    another();
  });
  $("reset").addEventListener("click", () => {
    begin();
    $("motor-class").value = "";
    state.sensor = 0;
    state.values.clear();
    notes.clear();
    dragging = false;
    refresh();
  });
  $("link").addEventListener("click", async () => {
    const link = location.href.split("#")[0] + address();
    history.replaceState(null, "", address());
    const copied = await navigator.clipboard?.writeText(link).then(() => true, () => false);
    $("link-note").textContent = copied ? "Copied." : "This browser does not let a page copy. The address bar has the link.";
  });
  $("copy").addEventListener("click", () => navigator.clipboard?.writeText($("command").textContent));
  $("download").addEventListener("click", () => {
    $("download").href = `data:application/toml;charset=utf-8,${encodeURIComponent(toml())}`;
  });
  $("download").href = "#";
  addEventListener("hashchange", () => { if (location.hash !== address()) { fromAddress(location.hash); another(); } });
  // A motor of the catalogue: its values are put in together, since some bound each other.
  function pickMotor(name) {
    const { values } = byName(page.classes, name) ?? {}, all = new URLSearchParams(address().slice(1));
    for (const key of new Set(page.classes.flatMap((c) => Object.keys(c.values)))) {
      if (values && key in values) all.set(key, values[key]); else all.delete(key);
    }
    begin();
    fromAddress(`#${all}`);
    another();
  }
  if (page.classes.length) {
    const select = $("motor-class");
    $("motors").hidden = false;
    make("option", select, "the study's motor").value = "";
    for (const { name, words } of page.classes) make("option", select, `${name}: ${words}`).value = name;
    select.addEventListener("change", () => pickMotor(select.value));
  }
  if (page.sensors.length) {
    const select = $("sensor");
    $("sensors").hidden = false;
    ["the study's", ...page.sensors.map((sensor) => sensor.words)].forEach((words, n) => { make("option", select, words).value = n; });
    select.addEventListener("change", () => {
      begin();
      notes.clear();
      chooseSensor(Number(select.value));
      dragging = false;
      drawKeys();
      refresh();
    });
  }
  let resized = 0;
  addEventListener("resize", () => {
    clearTimeout(resized);
    resized = setTimeout(() => { for (const { plot, space } of plots.values()) plot?.setSize({ width: Math.max(240, space.clientWidth), height: plot.height }); }, 100);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { colours.clear(); for (const name of [...plots.keys()]) drop(name); draw(); });

  async function start() {
    fromAddress(location.hash);
    buttons();
    drawKeys();
    drawChanges();
    const packed = new Blob([liveBytes.of($("engine").textContent)]).stream().pipeThrough(new DecompressionStream("gzip"));
    const module = await new Response(packed).arrayBuffer();
    const code = URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" }));
    for (let n = 0; n < Math.max(2, Math.min(4, navigator.hardwareConcurrency || 2)); n++) {
      const worker = new Worker(code);
      worker.onerror = (event) => {
        $("state").className = "failed";
        $("state").textContent = `The engine doesn't start: ${event.message}.`;
      };
      worker.postMessage({ module });
      workers.push(worker);
    }
    go();
  }
  start();
  // for scripts, and the page's own tests
  window.cogless = { page, state, toml, address, set: (name, x) => { begin(); set(keys.get(name), x); dragging = false; refresh(); }, job, isIdle: () => !running && !missing().length && !drawn, isShown: () => shown().every((c) => isThere(c.name, false)) && !drawn, result: (name, off) => done.get(slot(name, off)), learned: (name) => learnedOf(found(name), byName(page.controllers, name)) };
})();
