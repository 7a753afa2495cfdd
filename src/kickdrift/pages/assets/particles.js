// Particles that move while the reader changes method, step, and, where there are any, heat bath and cutoff.

const BUDGET = 4, MOST = 40; // milliseconds and steps of a picture
const LOOK = 10, WINDOW = 400; // pictures between two looks at the energy, and looks in a figure
const BINS = 120, ASKED = 60; // bins of g(r), and particles whose neighbours a picture counts
const FEW = 30, TRAIL = 600; // most bodies that have trails in open space, and places of a trail

async function page(root, runs, python, { scene, edges, boltzmann, dt }) {
  const names = Object.keys(runs), [methods, cutoffs] = [0, 1].map((k) => [...new Set(names.map((name) => name.split(" ")[k]))]);
  const method = menu("Method", methods, methods[0], "", change), bathed = Object.values(runs).find((each) => each.baths.length);
  const cutoff = cutoffs[0] ? menu("Cutoff, σ", cutoffs, cutoffs[0], "", change) : null, controls = [method];
  const usual = bathed?.given.options.temperature;
  const heat = slider("Temperature of the heat bath", [0.3, 3, 0.05, 1], (p) => p * (usual ?? 1), short, warm);
  const step = slider("Step", [-1, 1, 0.05, 0], (p) => Number((dt * 10 ** p).toPrecision(2)), short, change);
  controls.push(...[bathed && heat, cutoff, step].filter(Boolean));
  const pause = make("button", { type: "button" }, "Pause"), anew = make("button", { type: "button" }, "Begin anew");
  const back = make("button", { type: "button", hidden: "" }, "Back to the last good state, with a short step");
  const text = make("p", { "aria-live": "polite" });
  const sight = make("div", { class: "sight" }), energy = new Figure("Change of the total energy");
  const warmth = new Figure("Temperature"), shells = new Figure("g(r), the density around a particle");
  const shown = runs[names[0]], n = shown.masses.length, paths = edges || n > FEW ? null : new Figure("Paths of the bodies, seen along z");
  const figures = edges ? [warmth, energy, shells] : [paths, energy].filter(Boolean);
  root.replaceChildren(make("div", { class: "controls" }, ...controls.map((each) => each.element)),
    make("p", {}, pause, " ", anew, " ", back), text, sight, make("div", { class: "figures" }, ...figures.map((each) => each.element)));
  const view = await globalThis.kickdriftView.mount(sight, scene, { live: false });
  const trails = Array.from({ length: paths ? n : 0 }, () => []), places = new Float32Array(3 * n), speeds = new Float32Array(n);
  const start = Float64Array.from(shown.start);
  const reach = edges ? Math.min(...edges) / 2 : 0, volume = edges ? edges[0] * edges[1] * edges[2] : 0;
  let run, good = start, first = NaN, looks = [], counts = new Float64Array(BINS), asked = 0, pictures = 0, rate = 0, runs_on = true, passed = 0;

  /** Go on from y with the chosen method, cutoff and step. */
  function begin(y) {
    run = runs[cutoff ? `${method.value} ${cutoff.value}` : method.value];
    run.reset(y, step.value);
    warm();
    looks = looks.map(([time, warm]) => [time, warm, 0]);
    first = run.energy;
    counts.fill(0);
    asked = 0;
    back.hidden = true;
    python({ cutoff: cutoff?.value, method: method.value, dt: step.value, steps: 1000, every: 10,
      options: run.baths.length ? `, temperature=${heat.value}, friction=${run.given.options.friction}` : "" });
  }

  function change() { passed += run.time; begin(run.status ? good : Float64Array.from(run.y)); }
  function warm() { if (run.baths.length) run.temperature = heat.value; }

  pause.addEventListener("click", () => {
    runs_on = !runs_on;
    pause.textContent = runs_on ? "Pause" : "Go on";
    if (runs_on) requestAnimationFrame(picture);
  });
  anew.addEventListener("click", () => { looks = []; passed = 0; trails.forEach((trail) => { trail.length = 0; }); begin(start); });
  back.addEventListener("click", () => { step.position = 0; passed += run.time; begin(good); });

  /** Temperature now: the total momentum is no heat. */
  const temperature = () => (2 * run.kinetic) / (3 * (n - 1) * boltzmann);

  function picture() {
    const begun = performance.now(), before = run.done;
    while (!run.status && performance.now() - begun < BUDGET && run.done - before < MOST) run.advance(4);
    rate += 0.05 * ((run.done - before) / Math.max(1, performance.now() - begun) - rate);
    show();
    if (pictures++ % LOOK === 0) look();
    if (runs_on) requestAnimationFrame(picture);
  }

  function show() {
    for (let i = 0; i < n; i++) {
      for (let axis = 0; axis < 3; axis++) {
        const x = run.y[axis * n + i];
        places[3 * i + axis] = edges ? x - edges[axis] * Math.floor(x / edges[axis]) : x;
      }
      speeds[i] = Math.hypot(run.y[3 * n + i], run.y[4 * n + i], run.y[5 * n + i]);
    }
    if (run.status) return;
    trails.forEach((trail, i) => { if (trail.push([run.y[i], run.y[n + i]]) > TRAIL) trail.shift(); });
    view.show(places, speeds);
    view.say(`t = ${short(passed + run.time)}`);
    if (edges) count();
  }

  /** Count the neighbours of some particles for g(r). */
  function count() {
    const scale = BINS / reach;
    for (let k = 0; k < ASKED; k++, asked++) {
      const i = (asked * 7) % n;
      for (let j = 0; j < n; j++) {
        let r2 = 0;
        for (let axis = 0; axis < 3; axis++) {
          const d = places[3 * i + axis] - places[3 * j + axis], near = d - edges[axis] * Math.round(d / edges[axis]);
          r2 += near * near;
        }
        const bin = Math.floor(Math.sqrt(r2) * scale);
        if (bin < BINS && j !== i) counts[bin]++;
      }
    }
  }

  function look() {
    const now = run.energy;
    if (run.status || !Number.isFinite(now)) {
      text.className = "alarm";
      text.textContent = `The run blew up at step ${run.done + 1} with a step of ${short(step.value)}. The system's own step is ${short(dt)}.`;
      back.hidden = false;
    } else {
      good = Float64Array.from(run.y);
      looks.push([passed + run.time, temperature(), Math.abs(now - first)]);
      looks = looks.slice(-WINDOW);
      text.className = "";
      const change = run.baths.length ? "" : `energy changed by ${short(Math.abs(now - first))} since ${run.done} steps, `;
      text.textContent = `${edges ? `T = ${short(temperature())}, ` : ""}${change}${Math.round(rate * 1000)} steps a second`;
    }
    draw();
  }

  function draw() {
    if (looks.length < 2) return;
    const times = [looks[0][0], looks.at(-1)[0]], rim = (values) => {
      const low = Math.min(...values), high = Math.max(...values), more = 0.1 * (high - low) || 0.1;
      return [low - more, high + more];
    };
    const said = { xlabel: "time", said: text.textContent }, changes = looks.map((each) => each[2]).filter((each) => each > 0);
    if (run.baths.length) energy.begin(times, [0, 1], { ...said, ylabel: "a heat bath does not keep it" });
    else if (changes.length) {
      energy.begin(times, [Math.min(...changes) / 2, Math.max(...changes) * 2], { ...said, log: true, ylabel: "|E - E(0)|" });
      energy.line(looks.filter((each) => each[2] > 0).map((each) => [each[0], each[2]]), "--a");
    }
    if (paths) {
      const spans = [0, 1].map((axis) => rim(trails.flatMap((trail) => trail.map((each) => each[axis]))));
      paths.begin(...spans, { square: true, xlabel: "x", ylabel: "y", said: text.textContent });
      trails.forEach((trail) => { paths.line(trail, "--a"); paths.dot(...trail.at(-1), "--b", 3); });
    }
    if (!edges || !asked) return;
    warmth.begin(times, rim(looks.map((each) => each[1])), { ...said, ylabel: "T" });
    warmth.line(looks.map((each) => [each[0], each[1]]), "--b");
    const width = reach / BINS, around = ((n - 1) / volume) * asked;
    const g = Array.from(counts, (each, k) => [(k + 0.5) * width, each / (around * (4 / 3) * Math.PI * width ** 3 * ((k + 1) ** 3 - k ** 3))]);
    shells.begin([0, reach], [0, Math.max(3, ...g.map((each) => each[1] * 1.1))], { xlabel: "r", ylabel: "g(r)" });
    shells.line(g, "--a");
  }

  begin(start);
  requestAnimationFrame(picture);
  globalThis.particles = { view, get run() { return run; } };
  return draw;
}

begin(page);
