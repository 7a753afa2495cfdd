// The frames of a view, chunk by chunk.

import {unpacked} from "./packed.js";

const ENERGY = "kinetic energy";

/** Moments of the scene, numbered from 0. */
export class Moments {
  /** `masses` are those of the particles, in units in which m v² / 2 is an energy. */
  constructor(masses) {
    this.particles = masses.length;
    this.masses = masses;
    this.chunks = [];
    this.count = 0;
    this.ranges = {};
    this.turn = Promise.resolve();
    this.present = null; // {places (3 n), speeds (n)} that stand for the frame that is shown
  }

  /** Adds the moments of a chunk, after the chunks that were added before. */
  add(chunk) {
    this.turn = this.turn.then(() => this.taken(chunk));
    return this.turn;
  }

  async taken(chunk) {
    const names = Object.keys(chunk.values);
    const packs = [chunk.steps, chunk.times, chunk.matrix, chunk.positions, ...names.map((name) => chunk.values[name].data)];
    const [steps, times, matrix, positions, ...levels] = await Promise.all(packs.map(unpacked));
    const ellipses = chunk.ellipses ? await unpacked(chunk.ellipses) : null;
    const values = {};
    names.forEach((name, i) => {
      const {low, high, beyond} = chunk.values[name];
      values[name] = {low, high, levels: levels[i]};
      this.widen(name, low, high, beyond);
    });
    this.widen(ENERGY, 0, chunk.energy, chunk.values.speed.beyond);
    this.chunks.push({first: this.count, count: chunk.count, steps, times, matrix, positions, values, ellipses,
      origin: chunk.origin});
    this.count += chunk.count;
  }

  /** Widens the range of a colour; `beyond` tells whether single values lie above it. */
  widen(name, low, high, beyond) {
    const known = this.ranges[name] ?? {low, high, beyond: false};
    this.ranges[name] = {low: Math.min(known.low, low), high: Math.max(known.high, high), beyond: known.beyond || beyond};
  }

  /** The chunk of frame k, and the frame's number in it. */
  at(k) {
    let low = 0, high = this.chunks.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.chunks[middle].first <= k) low = middle; else high = middle - 1;
    }
    const chunk = this.chunks[low];
    return [chunk, k - chunk.first];
  }

  time(k) { const [chunk, j] = this.at(k); return chunk.times[j]; }
  step(k) { const [chunk, j] = this.at(k); return chunk.steps[j]; }

  /** Number of the frame nearest to a time. */
  nearest(time) {
    let low = 0, high = this.count - 1;
    const rises = this.time(high) >= this.time(0);
    while (low < high) {
      const middle = (low + high) >> 1;
      if ((this.time(middle) < time) === rises) low = middle + 1; else high = middle;
    }
    return low > 0 && Math.abs(this.time(low - 1) - time) < Math.abs(this.time(low) - time) ? low - 1 : low;
  }

  /** The cell of frame k: its origin, and nine numbers, one edge vector after another. */
  cell(k) {
    const [chunk, j] = this.at(k);
    const row = chunk.matrix.shape[0] === 1 ? 0 : j;
    return {origin: chunk.origin, matrix: chunk.matrix.subarray(9 * row, 9 * row + 9)};
  }

  /** Writes the places of frame k, less a shift, into `out` (3 n); nan for a body that is not there. */
  places(k, shift, out) {
    if (this.present) {
      for (let i = 0; i < out.length; i++) out[i] = this.present.places[i] - shift[i % 3];
      return;
    }
    const [chunk, j] = this.at(k), {origin, matrix: m} = this.cell(k);
    const n = this.particles, level = chunk.positions, begin = 3 * n * j;
    const most = level.BYTES_PER_ELEMENT === 4 ? 4294967295 : 65535;
    const [ox, oy, oz] = [0, 1, 2].map((axis) => origin[axis] - shift[axis]);
    for (let i = 0; i < n; i++) {
      const p = level[begin + i], q = level[begin + n + i], r = level[begin + 2 * n + i];
      if (p === most || q === most || r === most) {
        out[3 * i] = out[3 * i + 1] = out[3 * i + 2] = NaN;
        continue;
      }
      const a = (p + 0.5) / most, b = (q + 0.5) / most, c = (r + 0.5) / most;
      out[3 * i] = ox + a * m[0] + b * m[3] + c * m[6];
      out[3 * i + 1] = oy + a * m[1] + b * m[4] + c * m[7];
      out[3 * i + 2] = oz + a * m[2] + b * m[5] + c * m[8];
    }
  }

  /** The place of one body at frame k. */
  place(k, i) {
    if (this.present) return Array.from(this.present.places.subarray(3 * i, 3 * i + 3));
    const [chunk, j] = this.at(k), {origin, matrix: m} = this.cell(k);
    const n = this.particles, begin = 3 * n * j + i;
    const most = chunk.positions.BYTES_PER_ELEMENT === 4 ? 4294967295 : 65535;
    const level = [0, 1, 2].map((axis) => chunk.positions[begin + axis * n]);
    if (level.includes(most)) return null;
    const [a, b, c] = level.map((each) => (each + 0.5) / most);
    return [0, 1, 2].map((axis) => origin[axis] + a * m[axis] + b * m[3 + axis] + c * m[6 + axis]);
  }

  /** Writes values for a colour at frame k into `out` (n), as parts of the range over all frames. */
  parts(name, k, out) {
    const [chunk, j] = this.at(k), n = this.particles;
    if (this.present && name === "speed") {
      const {low, high} = this.ranges.speed;
      for (let i = 0; i < n; i++) out[i] = (this.present.speeds[i] - low) / (high - low || 1);
      return out;
    }
    if (name === ENERGY) return this.energies(k, out);
    const here = chunk.values[name], whole = this.ranges[name];
    if (!here) return out.fill(0);
    const wide = whole.high - whole.low || 1, scale = (here.high - here.low) / 254 / wide;
    const base = (here.low - whole.low) / wide;
    for (let i = 0; i < n; i++) out[i] = base + scale * Math.min(254, here.levels[n * j + i]);
    return out;
  }

  /** Kinetic energies as parts of the largest one: the square of the speed, times half the mass. */
  energies(k, out) {
    const [chunk, j] = this.at(k), n = this.particles, {low, high, levels} = chunk.values.speed;
    for (let i = 0; i < n; i++) {
      const speed = low + (high - low) * Math.min(254, levels[n * j + i]) / 254;
      out[i] = (0.5 * this.masses[i] * speed * speed) / (this.ranges[ENERGY].high || 1);
    }
    return out;
  }

  /** Nine numbers for the ellipse of body i at frame k: centre from the body, and two semi-axes; null without one. */
  ellipse(k, i) {
    const [chunk, j] = this.at(k);
    if (!chunk.ellipses) return null;
    const begin = 9 * (this.particles * j + i);
    return Number.isNaN(chunk.ellipses[begin]) ? null : chunk.ellipses.subarray(begin, begin + 9);
  }
}
