// Compiled loops of kickdrift in WebAssembly: loads a module with its memory, and takes steps.
"use strict";

const BASE = 1 << 20; // where a page's own memory begins
const PAGE = 1 << 16, SCRATCH = 256, AT_ONCE = 50; // bytes of a page of memory, pages for arrays of compiled code, and steps that share them
const RECORD = 32, AT = 16; // bytes of numba's record of an array, and where the array's address is
const EVALUATIONS = 0, STEP = 1; // slots of the cursor; see integrators/stepping/loops.py

/** Bytes of a text in base64, which are compressed. */
async function bytes(text) {
  const packed = new Blob([Uint8Array.from(atob(text), (each) => each.charCodeAt(0))]);
  const stream = packed.stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Functions that compiled code imports. Sines and powers are the browser's own, within one unit in the last place;
 * all else would be an error in Python, and does not happen in a page. `memory` gives the page's memory later. */
function imports(module, memory, scratch) {
  const own = {
    fmod: (x, y) => x % y, exp2: (x) => 2 ** x, numba_attempt_nocopy_reshape: reshape(memory), __multi3: multiply(memory),
    NRT_MemInfo_alloc_aligned: (size, alignment) => scratch.array(Number(size), Number(alignment)),
    NRT_MemInfo_new_varsize_dtor: (size) => scratch.array(Number(size), 16), // a list
    NRT_MemInfo_varsize_realloc: (record, size) => scratch.longer(record, Number(size)), NRT_MemInfo_varsize_free: () => {},
  };
  const missing = (name) => () => { throw new Error(`a page has no function ${name}`); };
  const names = WebAssembly.Module.imports(module).map(({ name }) => name);
  return { env: Object.fromEntries(names.map((name) => [name, own[name] ?? Math[name] ?? missing(name)])) };
}

/** The product of two whole numbers of 128 bits, each in halves. */
function multiply(memory) {
  return (place, a, high, b, higher) => {
    const whole = (low, up) => (up << 64n) + BigInt.asUintN(64, low), product = whole(a, high) * whole(b, higher);
    const view = new DataView(memory());
    view.setBigUint64(place, BigInt.asUintN(64, product), true);
    view.setBigUint64(place + 8, BigInt.asUintN(64, product >> 64n), true);
  };
}

/** Arrays that compiled code makes for itself. All of them end with the call that made them. */
class Scratch {
  constructor(memory) {
    this.memory = memory;
    this.begin = memory.grow(SCRATCH) * PAGE;
    this.clear();
  }

  clear() { this.end = this.begin; }

  /** Address of numba's record of a new array: the array's address is in it. */
  array(size, alignment) {
    const align = Math.max(alignment, 16), place = Math.ceil((this.end + RECORD) / align) * align;
    this.end = place + size;
    if (this.end > this.begin + SCRATCH * PAGE) throw new Error("compiled code needs more memory than a page gives it");
    new DataView(this.memory.buffer).setUint32(place - RECORD + AT, place, true);
    return place - RECORD;
  }

  /** Address of more room for an array's content, which moves there. */
  longer(record, size) {
    const view = new DataView(this.memory.buffer), before = view.getUint32(record + AT, true), place = this.array(size, 16) + RECORD;
    new Uint8Array(this.memory.buffer).copyWithin(place, before, before + size);
    view.setUint32(record + AT, place, true);
    return place;
  }
}

/** numba's strides of an array in another shape, for contiguous arrays. */
function reshape(memory) {
  return (dimensions, shape, strides, count, newShape, newStrides, size) => {
    const view = new DataView(memory());
    for (let k = Number(count) - 1, step = size; k >= 0; k--) {
      view.setBigInt64(newStrides + 8 * k, step, true);
      step *= view.getBigInt64(newShape + 8 * k, true);
    }
    return 1;
  };
}

/** A module of WebAssembly, ready to run. */
export async function load(given) {
  let compiled;
  const [code, memory] = await Promise.all([bytes(given.wasm), bytes(given.memory.data)]);
  try {
    compiled = await WebAssembly.compile(code);
  } catch {
    throw new Error("This page needs a browser with WebAssembly SIMD: Chrome 91, Firefox 89, Safari 16.4 or later.");
  }
  const needs = imports(compiled, () => exports.memory.buffer, {
    array: (...size) => exports.scratch.array(...size), longer: (...size) => exports.scratch.longer(...size),
  });
  const exports = { ...(await WebAssembly.instantiate(compiled, needs)).exports };
  if (exports.__heap_base.value > BASE) throw new Error("the constants of this page are too large");
  exports.scratch = new Scratch(exports.memory);
  const buffer = exports.memory.buffer, all = new Uint8Array(buffer), view = new DataView(buffer);
  const table = new Int32Array(buffer, exports.functions.value, given.functions.length);
  let read = 0;
  for (const [place, size] of given.memory.pieces) all.set(memory.subarray(read, (read += size)), BASE + place);
  for (const [place, number] of given.calls) view.setBigInt64(place, BigInt(table[number]), true);
  const index = Object.fromEntries(given.functions.map((name, k) => [name, table[k]]));
  const runs = {};
  for (const [name, run] of Object.entries(given.runs)) runs[name] = new Run(exports, index, run);
  return runs;
}

/** One call of compiled code with its arguments. */
class Call {
  constructor(exports, index, { name, args, kinds, at }) {
    this.function = exports[name];
    this.scratch = exports.scratch;
    this.kinds = kinds;
    this.at = at;
    this.args = args.map((value, k) => this.number(k, typeof value === "string" ? index[value] : value));
  }

  number(k, value) {
    return this.kinds[k] === "l" ? BigInt(value) : Number(value);
  }

  set(name, value) {
    this.args[this.at[name]] = this.number(this.at[name], value);
  }

  /** Address of an array among the arguments. */
  place(name) {
    return this.args[this.at[name] + 4];
  }

  run() {
    this.scratch.clear();
    return Number(this.function(...this.args));
  }
}

/** A method on a system: y, its steps and its energy. */
export class Run {
  constructor(exports, index, given) {
    const buffer = exports.memory.buffer;
    this.given = given;
    this.steps = new Call(exports, index, given.steps);
    this.shape = given.y.slice(1);
    this.y = new Float64Array(buffer, given.y[0], this.shape.reduce((a, b) => a * b, 1));
    this.cursor = new BigInt64Array(buffer, this.steps.place("cursor"), 5);
    this.first = given.first && new Call(exports, index, given.first); // the first step, of a method that begins apart
    this.looks = given.energy && new Call(exports, index, given.energy);
    if (this.looks) {
      const place = given.energy.kinds.length === 3 ? this.looks.args[2] : this.looks.place("sums");
      this.sums = new Float64Array(buffer, place, 1);
    }
    this.masses = given.masses;
    this.lists = (given.lists ?? []).map((place) => new BigInt64Array(buffer, place, 1));
    this.baths = (given.baths ?? []).map(([place, count]) => new Float64Array(buffer, place, count));
    this.spreads = this.baths.map((spread) => Float64Array.from(spread)); // at the temperature of `given`
    this.start = Float64Array.from(this.y);
    this.done = 0;
    this.dt = given.dt;
  }

  /** Begin anew at y, with another step. */
  reset(y = this.start, dt = this.dt) {
    this.y.set(y);
    this.cursor.fill(0n);
    for (const made of this.lists) made[0] = 0n;
    this.dt = dt;
    for (const call of [this.steps, this.first]) call?.set("dt", dt);
    this.done = 0;
    this.status = 0;
  }

  /** Give the heat baths another temperature. */
  set temperature(value) {
    const factor = Math.sqrt(value / this.given.options.temperature);
    this.baths.forEach((spread, k) => spread.forEach((_, i) => { spread[i] = factor * this.spreads[k][i]; }));
  }

  /** Take steps; return 0, or a status other than 0 if y is no longer finite. */
  advance(count) {
    const end = this.done + count, take = (steps) => {
      this.steps.set("first", this.done);
      this.steps.set("steps", steps);
      this.status = this.steps.run();
      this.done += Number(this.cursor[STEP]);
      this.cursor[STEP] = 0n;
    };
    if (this.first && !this.done && count > 0) {
      this.status = this.first.run();
      this.done += Number(this.cursor[STEP]);
      if (!this.status) take(Math.min(count, AT_ONCE) - 1); // also none: y is the state only after these
    }
    while (this.done < end && !this.status) take(Math.min(end - this.done, AT_ONCE));
    return this.status;
  }

  get time() {
    return this.done * this.dt;
  }

  /** Force evaluations since the start. */
  get evaluations() {
    return Number(this.cursor[EVALUATIONS]);
  }

  /** Total energy; NaN where it is not finite, or there is none. */
  get energy() {
    this.looks?.set("t", this.time);
    if (this.looks?.run() !== 0) return NaN;
    return this.masses ? this.sums[0] + this.kinetic : this.sums[0];
  }

  get kinetic() {
    const n = this.masses.length;
    let sum = 0;
    for (let axis = 0; axis < 3; axis++) {
      for (let i = 0; i < n; i++) sum += 0.5 * this.masses[i] * this.y[(3 + axis) * n + i] ** 2;
    }
    return sum;
  }
}

const APART = 1e-8; // distance of the neighbour that stands for a tangent vector

/** Growth of a tangent vector along a motion: times, and logarithms of its length over that at the start.
 *
 * A neighbour at a small distance is brought back to that distance after each sample (Benettin, Galgani & Strelcyn 1976,
 * doi:10.1103/PhysRevA.14.2338). */
export function growth(run, start, dt, steps, every) {
  let one = Float64Array.from(start), log = 0;
  let two = one.map((each, k) => each + (k ? 0 : APART));
  const found = [[0, 0]], after = (y, count) => { run.reset(y, dt); run.advance(count); return Float64Array.from(run.y); };
  for (let done = 0; done < steps; done += every) {
    const count = Math.min(every, steps - done);
    [one, two] = [after(one, count), after(two, count)];
    const way = two.map((each, k) => each - one[k]), length = Math.hypot(...way);
    if (!(length > 0 && Number.isFinite(length))) break;
    log += Math.log(length / APART);
    two = one.map((each, k) => each + (way[k] * APART) / length);
    found.push([(done + count) * dt, log]);
  }
  return found;
}
