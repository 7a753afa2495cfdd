// What the pages share: controls, figures on a canvas, and colours that follow dark and light.

const SIDE = 58; // pixels of a figure's left and lower edges, for numbers

/** A new element with attributes and children. */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** A menu of names. */
export function menu(label, names, chosen, kind, changed) {
  const select = make("select", { "aria-label": label });
  for (const name of names) select.append(new Option(name, name, false, name === chosen));
  select.addEventListener("change", changed);
  return { element: make("label", { class: kind }, label, select), get value() { return select.value; } };
}

/** A slider whose number is `number(position)`. */
export function slider(label, [least, most, step, first], number, text, changed) {
  const input = make("input", { type: "range", min: least, max: most, step, value: first, "aria-label": label });
  const shown = make("output"), words = document.createTextNode(label);
  const show = () => {
    shown.value = text(number(Number(input.value)));
    input.setAttribute("aria-valuetext", shown.value);
  };
  input.addEventListener("input", () => { show(); changed(); });
  show();
  return {
    element: make("label", {}, words, shown, input),
    get value() { return number(Number(input.value)); },
    set position(value) { input.value = value; show(); },
    set label(value) { words.data = value; input.setAttribute("aria-label", value); },
  };
}

/** A number in few digits. */
export function short(x) {
  if (!Number.isFinite(x)) return "not finite";
  const size = Math.abs(x);
  return size === 0 || (size >= 1e-3 && size < 1e5) ? String(Number(x.toPrecision(3))) : x.toExponential(1);
}

/** A figure with a caption. `draw` gives it axes and lines. */
export class Figure {
  constructor(caption) {
    this.canvas = make("canvas", { role: "img" });
    this.element = make("figure", {}, make("figcaption", {}, caption), this.canvas);
    this.caption = caption;
  }

  /** Begin a drawing with axes from `low` to `high`, and a text for people who do not see it. */
  begin([x0, x1], [y0, y1], { log = false, square = false, xlabel = "", ylabel = "", said = "" } = {}) {
    const ratio = globalThis.devicePixelRatio || 1;
    const width = this.canvas.clientWidth || 400, height = (width * 3) / 4;
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    this.canvas.setAttribute("aria-label", `${this.caption}. ${said}`);
    const ink = (this.context = this.canvas.getContext("2d"));
    ink.scale(ratio, ratio);
    const right = width - SIDE - 8, down = height - SIDE - 8;
    if (square) {
      const scale = Math.max((x1 - x0) / right, (y1 - y0) / down);
      [x0, x1] = [(x0 + x1 - scale * right) / 2, (x0 + x1 + scale * right) / 2];
      [y0, y1] = [(y0 + y1 - scale * down) / 2, (y0 + y1 + scale * down) / 2];
    }
    this.box = [SIDE, 8, right, down];
    this.span = [x0, x1, y0, y1];
    this.x = (x) => SIDE + ((x - x0) / (x1 - x0)) * right;
    const scaled = log ? Math.log10 : (y) => y;
    const [bottom, top] = [scaled(y0), scaled(y1)];
    this.y = (y) => 8 + down - ((scaled(y) - bottom) / (top - bottom)) * down;
    ink.fillStyle = ink.strokeStyle = this.colour("--faint");
    ink.font = "11px system-ui, sans-serif";
    ink.strokeRect(SIDE, 8, right, down);
    ink.textAlign = "center";
    for (const each of ticks(x0, x1)) ink.fillText(short(each), this.x(each), 8 + down + 14);
    ink.fillText(xlabel, SIDE + right / 2, height - 8);
    ink.textAlign = "right";
    for (const each of log ? powers(bottom, top) : ticks(y0, y1)) ink.fillText(short(each), SIDE - 4, this.y(each) + 4);
    ink.save();
    ink.translate(10, 8 + down / 2);
    ink.rotate(-Math.PI / 2);
    ink.textAlign = "center";
    ink.fillText(ylabel, 0, 0);
    ink.restore();
    ink.beginPath();
    ink.rect(...this.box);
    ink.clip();
  }

  colour(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name);
  }

  /** A line through points; points that are not finite end it. */
  line(points, colour) {
    const ink = this.context;
    ink.strokeStyle = this.colour(colour);
    ink.lineWidth = 1.3;
    ink.beginPath();
    for (const [x, y] of points) {
      if (!Number.isFinite(x) || !Number.isFinite(y)) break;
      ink.lineTo(this.x(x), this.y(y));
    }
    ink.stroke();
  }

  dot(x, y, colour, radius = 5) {
    const ink = this.context;
    ink.fillStyle = this.colour(colour);
    ink.beginPath();
    ink.arc(this.x(x), this.y(y), radius, 0, 2 * Math.PI);
    ink.fill();
  }
}

/** Round numbers between two. */
function ticks(low, high) {
  const rough = (high - low) / 4, unit = 10 ** Math.floor(Math.log10(rough));
  const step = unit * ([1, 2, 5, 10].find((each) => each * unit >= rough) ?? 10);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(Math.round(k) * step);
  return found;
}

/** Powers of ten between two exponents. */
function powers(low, high) {
  const step = Math.max(1, Math.ceil((high - low) / 6)), found = [];
  for (let k = Math.ceil(low); k <= high; k += step) found.push(10 ** k);
  return found;
}

/** Load the page's module and begin; a failure is a line of text. */
export async function begin(page) {
  const root = document.getElementById("page"), theme = document.documentElement.dataset;
  theme.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  try {
    const given = JSON.parse(document.getElementById("module").textContent);
    await new Promise((done) => requestAnimationFrame(() => setTimeout(done))); // the heading is there before the figures
    const redraw = await page(root, await load(given), (values) => {
      const text = given.python.replace(/\{(\w+)\}/g, (_, name) => values[name]);
      document.getElementById("python").textContent = text;
    }, given);
    document.getElementById("theme").addEventListener("click", () => {
      theme.theme = theme.theme === "dark" ? "light" : "dark";
      redraw();
    });
    addEventListener("resize", redraw);
    redraw();
  } catch (error) {
    root.replaceChildren(make("p", { class: "alarm", role: "alert" }, error.message));
  }
}
