// Curves over time. A click moves the view to that time.

import {unpacked} from "./packed.js";

const HIGH = 84, LEFT = 4, TOP = 15; // the numbers stand above and below the curve

export const short = (value) => {
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 1e5 || size < 1e-3 ? value.toExponential(1) : Number(value.toPrecision(4)).toString();
  return text.replaceAll("-", "−").replace("e+", "e");
};

export class Curves {
  /** `chosen(time)` is called when the user picks a time. */
  constructor(parent, chosen) {
    this.parent = parent;
    this.chosen = chosen;
    this.all = new Map();
  }

  async add(curve) {
    const [times, values] = (await Promise.all([unpacked(curve.times), unpacked(curve.values)])).map((each) => [...each]);
    const known = this.all.get(curve.name);
    if (known) {
      known.times.push(...times);
      known.values.push(...values);
      known.draw();
      return;
    }
    const made = new Curve(this.parent, curve, times, values, this.chosen);
    this.all.set(curve.name, made);
  }

  draw(ink, line) { for (const curve of this.all.values()) curve.draw(ink, line); }
  mark(time) { for (const curve of this.all.values()) curve.mark(time); }
}

class Curve {
  constructor(parent, {name, label, unit}, times, values, chosen) {
    Object.assign(this, {name, times, values, ink: "#888", line: "#48c"});
    const make = (kind, css, text = "") => {
      const made = document.createElement(kind);
      made.className = css;
      made.textContent = text;
      return made;
    };
    this.box = make("div", "curve");
    this.box.dataset.name = name;
    const head = make("div", "curvehead");
    this.now = make("span", "now");
    head.append(make("span", "", label), make("span", "unit", unit), this.now);
    this.plot = make("div", "plot");
    this.canvas = make("canvas", "");
    this.marker = make("div", "marker");
    this.high = make("span", "most");
    this.low = make("span", "least");
    this.plot.append(this.canvas, this.marker, this.high, this.low);
    this.box.append(head, this.plot);
    parent.append(this.box);
    const pick = (event) => {
      const {left, width} = this.plot.getBoundingClientRect();
      const part = Math.max(0, Math.min(1, (event.clientX - left - LEFT) / (width - 2 * LEFT)));
      chosen(this.begin + part * (this.end - this.begin));
    };
    this.plot.addEventListener("pointerdown", (event) => { this.plot.setPointerCapture(event.pointerId); pick(event); });
    this.plot.addEventListener("pointermove", (event) => { if (event.buttons) pick(event); });
    this.draw();
  }

  draw(ink = this.ink, line = this.line) {
    Object.assign(this, {ink, line});
    const wide = this.plot.clientWidth, ratio = Math.max(2, globalThis.devicePixelRatio || 1);
    if (!wide || !this.times.length) return;
    this.canvas.width = wide * ratio;
    this.canvas.height = HIGH * ratio;
    const on = this.canvas.getContext("2d");
    on.scale(ratio, ratio);
    this.begin = this.times[0];
    this.end = this.times[this.times.length - 1];
    let low = Infinity, high = -Infinity;
    for (const value of this.values) if (Number.isFinite(value)) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
    if (!(low <= high)) return;
    this.high.textContent = short(high);
    this.low.textContent = high > low ? short(low) : "";
    const span = this.end - this.begin || 1, tall = high - low || 1;
    const x = (t) => LEFT + ((t - this.begin) / span) * (wide - 2 * LEFT);
    const y = (v) => (high > low ? HIGH - TOP - ((v - low) / tall) * (HIGH - 2 * TOP) : HIGH / 2);
    on.lineJoin = "round";
    if (low < 0 && high > 0) {
      on.strokeStyle = ink;
      on.globalAlpha = 0.35;
      on.setLineDash([2, 3]);
      on.beginPath();
      on.moveTo(LEFT, y(0));
      on.lineTo(wide - LEFT, y(0));
      on.stroke();
      on.setLineDash([]);
      on.globalAlpha = 1;
    }
    on.strokeStyle = line;
    on.lineWidth = 1.3;
    on.beginPath();
    this.times.forEach((t, i) => (i ? on.lineTo(x(t), y(this.values[i])) : on.moveTo(x(t), y(this.values[i]))));
    on.stroke();
  }

  /** Marks the present time, and says the value there. */
  mark(time) {
    const span = this.end - this.begin || 1, wide = this.plot.clientWidth - 2 * LEFT;
    const part = Math.max(0, Math.min(1, (time - this.begin) / span));
    this.marker.style.transform = `translateX(${(LEFT + part * wide).toFixed(1)}px)`;
    let low = 0, high = this.times.length - 1;
    const rises = this.end >= this.begin;
    while (low < high) {
      const middle = (low + high) >> 1;
      if ((this.times[middle] < time) === rises && this.times[middle] !== time) low = middle + 1; else high = middle;
    }
    this.now.textContent = short(this.values[low]);
  }
}
