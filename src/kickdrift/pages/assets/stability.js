// The stability region of a Runge-Kutta method, found by one step of its own loop on z' = lambda z.

const GRID = 160, LEFT = -7, RIGHT = 3, TOP = 5;

/** Factor by which one step of length 1 multiplies |z|, for a complex lambda. */
function factor(run, real, imaginary) {
  run.reset(Float64Array.of(1, 0, real, imaginary), 1);
  return run.advance(1) === 0 ? Math.hypot(run.y[0], run.y[1]) : Infinity;
}

function page(root, runs, python) {
  const redraw = () => draw();
  const method = menu("Method", Object.keys(runs), "rk4", "a", redraw);
  const step = slider("Step", [-2, 1, 0.01, 0], (p) => Number((10 ** p).toPrecision(3)), short, redraw);
  const omega = slider("Frequency of an oscillator", [0.1, 4, 0.1, 1], (p) => p, short, redraw);
  const damping = slider("Its damping", [0, 4, 0.1, 0], (p) => p, short, redraw);
  const figure = new Figure("Where one step makes z smaller: step times lambda in the complex plane");
  const text = make("p", { "aria-live": "polite" });
  const controls = make("div", { class: "controls" });
  controls.append(...[method, step, omega, damping].map((each) => each.element));
  root.replaceChildren(controls, make("div", { class: "figures" }, figure.element), text);

  function draw() {
    const run = runs[method.value], dt = step.value, w = omega.value, c = damping.value / 2;
    const root2 = c * c - w * w, slow = Math.sqrt(Math.abs(root2));
    const values = root2 < 0 ? [[-c, slow], [-c, -slow]] : [[-c + slow, 0], [-c - slow, 0]];
    const factors = values.map(([a, b]) => factor(run, a * dt, b * dt)), largest = Math.max(...factors);
    const stable = largest <= 1 + 1e-14;
    text.textContent = `${method.value}, order ${run.given.order}: a step of ${short(dt)} multiplies the motion by ${largest.toPrecision(6)}, ` +
      `so it is ${stable ? "stable" : "unstable"}.`;
    text.className = stable ? "" : "alarm";
    figure.begin([LEFT, RIGHT], [-TOP, TOP], { square: true, xlabel: "real part", ylabel: "imaginary part", said: text.textContent });
    const ink = figure.context, [x0, x1, y0, y1] = figure.span, across = (x1 - x0) / GRID, up = (y1 - y0) / GRID;
    ink.fillStyle = figure.colour("--fill");
    for (let i = 0; i < GRID; i++) {
      for (let j = GRID / 2; j < GRID; j++) {
        const x = x0 + (i + 0.5) * across, y = y0 + (j + 0.5) * up;
        if (factor(run, x, y) > 1) continue;
        const wide = figure.x(x + across) - figure.x(x), high = figure.y(y) - figure.y(y + up);
        for (const at of [y, -y]) ink.fillRect(figure.x(x) - wide / 2, figure.y(at) - high / 2, wide + 0.5, high + 0.5);
      }
    }
    figure.line([[x0, 0], [x1, 0]], "--edge");
    figure.line([[0, y0], [0, y1]], "--edge");
    for (const [a, b] of values) figure.dot(a * dt, b * dt, stable ? "--b" : "--alarm");
    python({ method: method.value, omega: short(w), dt });
  }
  return redraw;
}

begin(page);
