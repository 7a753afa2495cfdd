// Two methods side by side: the path, the energy error on a logarithmic axis, the cost.

const PERIOD = 2 * Math.PI, SAMPLES = 600, MOST = 400000, FLOOR = 1e-17;
const SYSTEMS = {
  "harmonic-oscillator": { start: (s) => [s, 0], label: "start x", text: "harmonic_oscillator", given: (s) => `y0=(${s}, 0.0)` },
  pendulum: { start: (s) => [3 * s, 0], label: "third of the start angle", text: "pendulum", given: (s) => `y0=(${3 * s}, 0.0)` },
  kepler: {
    start: (e) => [1 - e, 0, 0, Math.sqrt((1 + e) / (1 - e))], label: "eccentricity", text: "kepler", given: (e) => `eccentricity=${e}`,
  },
};

/** Run a method, and keep its path and its energy error at equal times. */
function followed(run, start, dt, periods) {
  run.reset(start, dt);
  const steps = Math.min(MOST, Math.max(1, Math.round((periods * PERIOD) / dt)));
  const every = Math.max(1, Math.floor(steps / SAMPLES)), first = run.energy;
  const scale = Math.abs(first) || 1, path = [], errors = [];
  const look = () => {
    path.push([run.y[0], run.y[1]]);
    errors.push([run.time / PERIOD, (run.energy - first) / scale]);
  };
  look();
  while (run.done < steps && run.advance(Math.min(every, steps - run.done)) === 0) look();
  const sizes = errors.map(([time, error]) => [time, Math.max(FLOOR, Math.abs(error))]);
  const largest = Math.max(...sizes.map(([, size]) => size));
  return { path, errors, sizes, largest, steps, every, evaluations: run.evaluations, blown: run.status !== 0, at: run.time };
}

/** What the error does: whether its mean over the last fifth has left the mean over the first, beyond the swing. */
function verdict({ errors, largest, blown, at }) {
  if (blown) return `The run blew up at time ${short(at)}. Take a shorter step.`;
  if (largest < 1e-12) return "The error is rounding alone.";
  if (errors.at(-1)[0] < 5) return "The run has too few periods to tell a drift.";
  const part = Math.ceil(errors.length / 5), mean = (list) => list.reduce((sum, each) => sum + each, 0) / list.length;
  const values = errors.map(([, error]) => error), last = values.slice(-part), before = mean(values.slice(0, part));
  const drift = mean(last) - before, swing = Math.max(...last) - Math.min(...last);
  return Math.abs(drift) < 0.5 * swing ? "The error stays bounded." : `The energy drifts ${drift < 0 ? "down" : "up"}.`;
}

function page(root, runs, python) {
  const names = [...new Set(Object.keys(runs).map((each) => each.split(" ")[1]))];
  const redraw = () => draw();
  const system = menu("System", Object.keys(SYSTEMS), "kepler", "", redraw);
  const methods = [["Method A", "euler", "a"], ["Method B", "velocity-verlet", "b"]].map(([label, first, kind]) =>
    menu(label, names, first, kind, redraw));
  const step = slider("Step", [-3, 0.3, 0.02, -1.3], (p) => Number((10 ** p).toPrecision(3)), short, redraw);
  const start = slider("eccentricity", [0, 0.95, 0.01, 0.5], (p) => p, short, redraw);
  const length = slider("Periods", [0, 3, 0.1, 1], (p) => Math.round(10 ** p), short, redraw);
  const orbit = new Figure("Path: x and velocity, or the orbit"), error = new Figure("Energy error, relative");
  const table = make("table", { "aria-live": "polite" });
  const back = make("button", { type: "button", hidden: "" }, "Go back to a short step");
  back.addEventListener("click", () => { step.position = -1.3; draw(); });
  const controls = make("div", { class: "controls" });
  controls.append(...[system, ...methods, step, start, length].map((each) => each.element));
  root.replaceChildren(controls, make("div", { class: "figures" }, orbit.element, error.element), table, back);

  function draw() {
    const { start: from, label, text, given } = SYSTEMS[system.value];
    start.label = label;
    const value = system.value === "kepler" ? start.value : Math.max(0.05, start.value);
    const found = methods.map((each) =>
      followed(runs[`${system.value} ${each.value}`], Float64Array.from(from(value)), step.value, length.value));
    const good = found[1].blown ? found[0] : found[1], size = 1.4 * Math.max(1e-3, ...good.path.flat().map(Math.abs).filter(Number.isFinite));
    const axes = system.value === "kepler" ? ["x", "y"] : ["x", "velocity"];
    const said = methods.map((each, k) => `${each.value}: ${verdict(found[k])}`).join(" ");
    orbit.begin([-size, size], [-size, size], { square: true, xlabel: axes[0], ylabel: axes[1], said });
    found.forEach(({ path }, k) => orbit.line(path, k ? "--b" : "--a"));
    if (system.value === "kepler") orbit.dot(0, 0, "--faint");
    const errors = found.flatMap((each) => each.sizes.slice(1).map(([, y]) => y)).filter(Number.isFinite);
    const low = Math.max(FLOOR, Math.min(...errors, 1)), high = Math.min(1e6, Math.max(...errors, 10 * low));
    error.begin([0, Math.max(...found.map((each) => each.errors.at(-1)[0]))], [low / 2, high * 2],
      { log: true, xlabel: "periods", ylabel: "|E - E0| / |E0|", said });
    found.forEach(({ sizes: line }, k) => error.line(line.slice(1), k ? "--b" : "--a"));
    const rows = methods.map((each, k) => {
      const { given: method } = runs[`${system.value} ${each.value}`], run = found[k];
      const cells = [each.value, `order ${method.order}${method.symplectic ? ", symplectic" : ""}`,
        `${run.evaluations.toLocaleString("en")} force evaluations`, `largest error ${short(run.largest)}`, verdict(run)];
      return make("tr", { class: k ? "b" : "a" }, ...cells.map((cell) => make("td", {}, cell)));
    });
    table.replaceChildren(...rows);
    back.hidden = !found.some((each) => each.blown);
    python({ problem: text, start: given(value), method: methods[1].value, dt: step.value, steps: found[1].steps, every: found[1].every });
  }
  return redraw;
}

begin(page);
