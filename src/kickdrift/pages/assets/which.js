// Two methods side by side: the path, the energy error on a logarithmic axis, the cost.

const PERIOD = 2 * Math.PI, SAMPLES = 1000, MOST = 400000, FLOOR = 1e-17; // SAMPLES: the report averages more than 1024
const SYSTEMS = {
  "harmonic-oscillator": { start: (s) => [s, 0], label: "start x", text: "harmonic_oscillator", given: (s) => `y0=(${s}, 0.0)` },
  pendulum: { start: (s) => [3 * s, 0], label: "third of the start angle", text: "pendulum", given: (s) => `y0=(${3 * s}, 0.0)` },
  kepler: {
    start: (e) => [1 - e, 0, 0, Math.sqrt((1 + e) / (1 - e))], label: "eccentricity", text: "kepler", given: (e) => `eccentricity=${e}`,
  },
};
const SAID = {
  bounded: "The error stays bounded.", "secular drift": "The energy drifts.", "round-off": "The error is rounding alone.",
  "not resolvable": "The run is too short to tell a drift.", unreliable: "The error exceeds a tenth of the energy: the run is unreliable.",
};

/** Run a method for a time, and keep its path in two unknowns and its energy error at equal times. */
function followed(run, start, dt, time, [across, up]) {
  run.reset(start, dt);
  const steps = Math.min(MOST, Math.max(1, Math.round(time / dt)));
  const every = Math.ceil(steps / SAMPLES), first = run.energy;
  const scale = Math.abs(first) || 1, path = [], errors = [];
  const look = () => {
    path.push([run.y[across], run.y[up]]);
    errors.push([run.time, (run.energy - first) / scale]);
  };
  look();
  while (run.done < steps && run.advance(Math.min(every, steps - run.done)) === 0) look();
  const sizes = errors.map(([at, error]) => [at, Math.max(FLOOR, Math.abs(error))]);
  const found = { path, errors, sizes, largest: Math.max(...sizes.map(([, size]) => size)), steps, every, evaluations: run.evaluations,
    blown: run.status !== 0, at: run.time };
  return { ...found, said: found.blown ? `The run blew up at time ${short(run.time)}. Take a shorter step.` : judged(found) };
}

/** The report's verdict with a sentence; the last sample may be nearer than the others. */
function judged({ errors, steps, every }) {
  const even = errors.slice(0, 1 + Math.floor(steps / every)).map(([, error]) => error);
  if (Number.isNaN(even[0])) return "";
  const word = verdict(even, steps);
  return `${word}. ${SAID[word]}`;
}

function page(root, runs, python, { own }) {
  const names = [...new Set(Object.keys(runs).map((each) => each.split(" ")[1]))];
  const redraw = () => draw();
  const unit = own ? 1 : PERIOD, usual = own ? Math.log10(own.dt) : -1.3;
  const system = menu("System", Object.keys(SYSTEMS), "kepler", "", redraw);
  const methods = [["Method A", "euler", "a"], ["Method B", names.includes("velocity-verlet") ? "velocity-verlet" : "rk4", "b"]]
    .map(([label, first, kind]) => menu(label, names, first, kind, redraw));
  const step = slider("Step", own ? [usual - 2, usual + 2, 0.02, usual] : [-3, 0.3, 0.02, usual], (p) => Number((10 ** p).toPrecision(3)), short, redraw);
  const start = slider("eccentricity", [0, 0.95, 0.01, 0.5], (p) => p, short, redraw);
  const length = own ? slider("Time", [-1, 1.5, 0.1, 0], (p) => Number((own.time * 10 ** p).toPrecision(3)), short, redraw)
    : slider("Periods", [0, 3, 0.1, 1], (p) => Math.round(10 ** p), short, redraw);
  const unknowns = Array.from({ length: own?.unknowns ?? 0 }, (_, k) => `y[${k}]`);
  const axes = own ? ["Across", "Up"].map((each, k) => menu(each, unknowns, unknowns[Math.min(k, unknowns.length - 1)], "", redraw)) : [];
  const energetic = Object.values(runs)[0].looks, energy = new Figure(energetic ? "Energy error, relative" : "The unknown upwards, over time");
  const orbit = new Figure(own ? "Path in two unknowns" : "Path: x and velocity, or the orbit");
  const table = make("table", { "aria-live": "polite" });
  const back = make("button", { type: "button", hidden: "" }, "Go back to a short step");
  back.addEventListener("click", () => { step.position = own ? usual - 1 : usual; draw(); });
  const controls = make("div", { class: "controls" });
  controls.append(...(own ? [...methods, step, length, ...axes] : [system, ...methods, step, start, length]).map((each) => each.element));
  root.replaceChildren(controls, make("div", { class: "figures" }, orbit.element, energy.element), table, back);

  function draw() {
    const { start: from, label, text, given } = own ? {} : SYSTEMS[system.value], kepler = !own && system.value === "kepler";
    if (!own) start.label = label;
    const value = kepler ? start.value : Math.max(0.05, start.value), prefix = own ? "problem" : system.value;
    const shown = own ? axes.map((each) => unknowns.indexOf(each.value)) : [0, 1];
    const found = methods.map((each) => {
      const run = runs[`${prefix} ${each.value}`];
      return followed(run, own ? run.start : Float64Array.from(from(value)), step.value, length.value * unit, shown);
    });
    const good = found[1].blown ? found[0] : found[1], said = methods.map((each, k) => `${each.value}: ${found[k].said}`).join(" ");
    const around = (k) => {
      let low = Infinity, high = -Infinity;
      for (const each of good.path) if (Number.isFinite(each[k])) [low, high] = [Math.min(low, each[k]), Math.max(high, each[k])];
      const rim = own ? 0.1 * (high - low) || 1 : 0, size = 1.4 * Math.max(1e-3, high, -low);
      return own ? [low - rim, high + rim] : [-size, size];
    };
    const named = own ? axes.map((each) => each.value) : kepler ? ["x", "y"] : ["x", "velocity"];
    const [across, up] = own ? [around(0), around(1)] : (([a, b]) => [[-Math.max(a, b), Math.max(a, b)], [-Math.max(a, b), Math.max(a, b)]])([around(0)[1], around(1)[1]]);
    orbit.begin(across, up, { square: !own, xlabel: named[0], ylabel: named[1], said });
    found.forEach(({ path }, k) => orbit.line(path, k ? "--b" : "--a"));
    if (kepler) orbit.dot(0, 0, "--faint");
    const end = Math.max(...found.map((each) => each.errors.at(-1)[0])) / unit, times = { xlabel: own ? "time" : "periods", said };
    if (energetic) {
      const errors = found.flatMap((each) => each.sizes.slice(1).map(([, y]) => y)).filter(Number.isFinite);
      const low = Math.max(FLOOR, Math.min(...errors, 1)), high = Math.min(1e6, Math.max(...errors, 10 * low));
      energy.begin([0, end], [low / 2, high * 2], { ...times, log: true, ylabel: "|E - E0| / |E0|" });
      found.forEach(({ sizes }, k) => energy.line(sizes.slice(1).map(([at, y]) => [at / unit, y]), k ? "--b" : "--a"));
    } else {
      energy.begin([0, end], up, { ...times, ylabel: named[1] });
      found.forEach(({ path, errors }, k) => energy.line(path.map((each, i) => [errors[i][0], each[1]]), k ? "--b" : "--a"));
    }
    const rows = methods.map((each, k) => {
      const { given: method } = runs[`${prefix} ${each.value}`], run = found[k];
      const cells = [each.value, `order ${method.order}${method.symplectic ? ", symplectic" : ""}`,
        `${run.evaluations.toLocaleString("en")} force evaluations`, ...(energetic ? [`largest error ${short(run.largest)}`] : []), run.said];
      return make("tr", { class: k ? "b" : "a" }, ...cells.map((cell) => make("td", {}, cell)));
    });
    table.replaceChildren(...rows);
    back.hidden = !found.some((each) => each.blown);
    python({ problem: text, start: given?.(value), method: methods[1].value, dt: step.value, steps: found[1].steps, every: found[1].every });
  }
  return redraw;
}

begin(page);
