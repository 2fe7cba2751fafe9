"use strict";
// One run on the engine's module. `failed` in web.cpp ends a call by throwing here, and then the run is over.
class Engine {
  constructor(module) {
    const host = { failed: (at, size) => { throw new Error(this.text(at, size)); } };
    const nothing = () => 0; // files, which the engine never opens
    this.e = new WebAssembly.Instance(module, {
      host, wasi_snapshot_preview1: new Proxy({}, { get: () => nothing }),
    }).exports;
    this.e._initialize();
  }

  text(at, size) {
    return new TextDecoder().decode(new Uint8Array(this.e.memory.buffer, at, size));
  }

  // description: bytes as simulator/packed_value.hpp reads them.
  open(description, decimation, rows) {
    const at = this.e.room(description.byteLength);
    new Uint8Array(this.e.memory.buffer, at, description.byteLength).set(description);
    this.e.open(description.byteLength, decimation, rows);
    const from = this.e.signals();
    const all = new Uint8Array(this.e.memory.buffer, from);
    this.names = this.text(from, all.indexOf(0)).trimEnd().split("\n").map((line) => line.split(" ")[0]);
  }

  load({ channels, cells, values }) {
    const at = this.e.room(8 * values.length);
    new Float64Array(this.e.memory.buffer, at, values.length).set(values);
    this.e.load(channels, cells);
  }

  advance(ticks) {
    this.e.advance(ticks);
  }

  // The rows since the last call, as long as nothing else is called: {name: the signal's column}.
  take() {
    const at = this.e.rows();
    const count = this.e.row_numbers() / this.names.length;
    const rows = new Float64Array(this.e.memory.buffer, at, this.e.row_numbers());
    return { rows, count, columns: this.names.length, names: this.names };
  }

  // What is learned: {channels, cells, values}, or null.
  stored() {
    const at = this.e.stored();
    if (!at) return null;
    const channels = this.e.stored_channels(), cells = this.e.stored_cells();
    return { channels, cells, values: new Float64Array(this.e.memory.buffer, at, channels * cells).slice() };
  }
}
