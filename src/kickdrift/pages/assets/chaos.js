// Two copies that begin almost alike, and the distance between them on a logarithmic axis.

const SAMPLES = 3000, MOST = 200000, FAR = 0.1; // FAR: the part of the motion's size at which copies are strangers
const SYSTEMS = {
  "double-pendulum": { show: (y) => [Math.sin(y[0]) + Math.sin(y[1]), -Math.cos(y[0]) - Math.cos(y[1])], axes: ["x of the lower bob", "y"],
    module: "kickdrift.pages.shipped", name: "double_pendulum" },
  "three-bodies": { show: (y) => [y[0], y[1]], axes: ["x of the first body", "y"], module: "kickdrift.pages.shipped", name: "three_bodies" },
  "henon-heiles": { show: (y) => [y[0], y[1]], axes: ["x", "y"], module: "kickdrift.odes", name: "henon_heiles" },
  lorenz: { show: (y) => [y[0], y[2]], axes: ["x", "z"], module: "kickdrift.odes", name: "lorenz" },
};

/** States at equal times from a start. */
function states(run, start, dt, time) {
  run.reset(start, dt);
  const steps = Math.min(MOST, Math.round(time / dt)), every = Math.max(1, Math.floor(steps / SAMPLES)), found = [[0, start]];
  while (run.done < steps && run.advance(Math.min(every, steps - run.done)) === 0) found.push([run.time, Float64Array.from(run.y)]);
  return { found, blown: run.status !== 0, steps, every };
}

/** Rate of exponential growth: least squares of log distance over time, while the copies are near. */
function rate(distances, size) {
  const end = distances.findIndex(([, d]) => d > FAR * size);
  const near = distances.slice(0, end < 0 ? undefined : end).filter(([, d]) => d > 0);
  const mean = (values) => values.reduce((sum, each) => sum + each, 0) / values.length;
  const t = mean(near.map(([time]) => time)), l = mean(near.map(([, d]) => Math.log(d)));
  const top = near.reduce((sum, [time, d]) => sum + (time - t) * (Math.log(d) - l), 0);
  return { rate: top / near.reduce((sum, [time]) => sum + (time - t) ** 2, 0), apart: end < 0 ? null : distances[end][0] };
}

function page(root, runs, python) {
  const redraw = () => draw();
  const system = menu("System", Object.keys(SYSTEMS), "double-pendulum", "", redraw);
  const method = menu("Method", ["rk4", "dop853"], "dop853", "", redraw);
  const apart = slider("Difference at the start", [-13, -2, 0.5, -9], (p) => 10 ** p, short, redraw);
  const scale = slider("Size of the start", [0.2, 1.2, 0.02, 1], (p) => p, short, redraw);
  const step = slider("Step", [-3, -0.5, 0.05, -2], (p) => Number((10 ** p).toPrecision(3)), short, redraw);
  const length = slider("Time", [10, 300, 10, 60], (p) => p, short, redraw);
  const path = new Figure("Paths of the two copies"), distance = new Figure("Distance of the two copies");
  const tangent = new Figure("Growth of a tangent vector");
  const text = make("p", { "aria-live": "polite" }), controls = make("div", { class: "controls" });
  controls.append(...[system, method, apart, scale, step, length].map((each) => each.element));
  root.replaceChildren(controls, make("div", { class: "figures" }, path.element, distance.element, tangent.element), text);

  function draw() {
    const { show, axes, module, name } = SYSTEMS[system.value], run = runs[`${system.value} ${method.value}`];
    const start = Float64Array.from(run.start, (each) => each * scale.value), other = Float64Array.from(start);
    other[0] += apart.value;
    const [one, two] = [start, other].map((each) => states(run, each, step.value, length.value));
    const count = Math.min(one.found.length, two.found.length);
    const paths = [one, two].map(({ found }) => found.map(([, y]) => show(y)));
    const distances = one.found.slice(0, count).map(([time], k) =>
      [time, Math.hypot(paths[0][k][0] - paths[1][k][0], paths[0][k][1] - paths[1][k][1])]);
    const around = (values) => { const low = Math.min(...values), high = Math.max(...values), rim = 0.05 * (high - low || 1); return [low - rim, high + rim]; };
    const [across, up] = [0, 1].map((k) => around(paths[0].map((each) => each[k])));
    const parting = rate(distances, across[1] - across[0]);
    text.className = one.blown || two.blown ? "alarm" : "";
    text.textContent = one.blown || two.blown ? `The run blew up at time ${short(run.time)}. Take a shorter step.`
      : parting.apart === null ? "The copies stay together to the end."
      : `The distance grows by a factor of e in a time of ${short(1 / parting.rate)}. The copies part at time ${short(parting.apart)}.`;
    const grown = growth(run, start, step.value, one.steps, one.every), [end, log] = grown.at(-1);
    if (!text.className && end > 0) {
      text.textContent += ` A tangent vector has grown by a factor of 10 to the power ${short(log / Math.LN10)} at time ${short(end)}: ` +
        `its mean rate is ${short(log / end)}, an estimate of the largest Lyapunov exponent.`;
    }
    path.begin(across, up, { square: true, xlabel: axes[0], ylabel: axes[1], said: text.textContent });
    paths.forEach((each, k) => path.line(each, k ? "--b" : "--a"));
    const positive = distances.map(([, d]) => d).filter((d) => d > 0 && Number.isFinite(d));
    distance.begin([0, length.value], [Math.min(...positive) / 2, Math.max(...positive) * 2],
      { log: true, xlabel: "time", ylabel: "distance", said: text.textContent });
    distance.line(distances.filter(([, d]) => d > 0), "--a");
    const factors = grown.map(([time, size]) => [time, size / Math.LN10]), tops = around(factors.map((each) => each[1]));
    tangent.begin([0, length.value], tops, { xlabel: "time", ylabel: "logarithm (base 10)", said: text.textContent });
    tangent.line(factors, "--a");
    python({ start: `[${[...start].map((each) => Number(each.toPrecision(6))).join(", ")}]`, time: length.value, place: module, problem: name,
      method: method.value === "rk4" ? `"rk4", dt=${step.value}` : `"${method.value}"` });
  }
  return redraw;
}

begin(page);
