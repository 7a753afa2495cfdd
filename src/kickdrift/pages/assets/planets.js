// The solar system by two methods side by side, and planets that the reader adds with the mouse or by sliders.

const BUDGET = 10, AT_A_TIME = 4, LOOK = 6, WINDOW = 500; // milliseconds of a picture, steps between points, pictures between looks, looks
const POINTS = 300, TURN = 0.03, CLICK = 6; // points of a trail, its angle between two points, and pixels of a drag that is a click
const FLOOR = 1e-17;

async function page(root, runs, python, { names, added, most, G, methods, tilt, dt }) {
  const kinds = Object.keys(added), [cosine, sine] = [Math.cos, Math.sin].map((of) => of((tilt * Math.PI) / 180));
  const view = slider("View, AU", [0, 1.75, 0.05, 0.9], (p) => 10 ** p, short, draw);
  const rate = slider("Years a second", [-1, 1.7, 0.1, 0], (p) => 10 ** p, short, () => {});
  const step = slider("Step, days", [-1, 2, 0.05, Math.log10(365.25 * dt)], (p) => Number((10 ** p).toPrecision(3)), short, () => restart(null));
  const mass = menu("A new planet is", kinds, kinds[2], "", () => {});
  const distance = slider("Its distance, AU", [-0.5, 1.6, 0.01, 0.6], (p) => Number((10 ** p).toPrecision(3)), short, draw);
  const angle = slider("Its direction, degrees", [0, 360, 1, 90], (p) => p, short, draw);
  const speed = slider("Its speed, where 1 makes a circle", [0, 1.5, 0.01, 1], (p) => p, short, draw);
  const buttons = ["Add the planet", "A close encounter with Jupiter", "Pause", "Begin anew", "Go back to the last good state, with a short step"]
    .map((label) => make("button", { type: "button" }, label)), [add, meet, pause, anew, back] = buttons;
  const text = make("p", { "aria-live": "polite" }), warning = make("p", { class: "alarm", "aria-live": "polite" });
  const note = make("p", { class: "note" }, "Press in a picture to place a planet. Drag to give it a velocity; without a drag it moves on a circle. ",
    "The sliders and the button do the same by keyboard.");
  const figures = methods.map((each) => new Figure(each)), error = new Figure("Energy error, relative");
  root.replaceChildren(make("div", { class: "controls" }, ...[view, rate, step, mass, distance, angle, speed].map((each) => each.element)),
    make("p", {}, ...buttons.flatMap((each) => [each, " "])), note, text, warning,
    make("div", { class: "figures" }, ...figures.map((each) => each.element), error.element));
  let sides, bodies, log, passed, firsts, looks, good, nearest, going = true, pictures = 0, last = 0, drag = null, behind = 0;

  const run = (k) => runs[`${methods[k]}|${bodies.length}|${bodies.length ? mass.value : ""}`];
  const count = () => names.length + bodies.length;
  const body = (y, i) => { const n = count(); return [0, 1, 2, 3, 4, 5].map((row) => y[row * n + i]); };
  /** Place in the plane of the Earth's orbit, from the Sun. */
  const flat = (y, i) => { const n = count(); return [y[i] - y[0], cosine * (y[n + i] - y[n]) + sine * (y[2 * n + i] - y[2 * n])]; };
  const upright = ([x, y]) => [x, cosine * y, sine * y];

  /** Begin at y, with one planet more or none. */
  function enter(y, more) {
    const n = count(), all = Array.from({ length: n }, (_, i) => [0, 1, 2, 3, 4, 5].map((row) => y[row * n + i]));
    if (more) all.push(more), bodies.push(more);
    const start = Float64Array.from([0, 1, 2, 3, 4, 5].flatMap((row) => all.map((each) => each[row])));
    methods.forEach((_, k) => run(k).reset(start, step.value / 365.25));
    firsts = methods.map((_, k) => run(k).energy);
    sides = methods.map((_, k) => Array.from({ length: count() }, (_, i) => sides?.[k][i] ?? []));
    looks = [];
    good = null;
    behind = 0;
    back.hidden = true;
    mass.element.querySelector("select").disabled = bodies.length > 0;
    add.disabled = bodies.length === most;
    warning.textContent = "";
    nearest = { ratio: Infinity };
    say();
    draw();
  }

  /** Go on from the state of the first method, so that both have the same start. */
  function restart(more) {
    if (more && bodies.length === most) return;
    const one = run(0), y = one.status ? good[0] : Float64Array.from(one.y);
    log.push({ steps: one.done, dt: one.dt, more });
    passed += one.time;
    enter(y, more);
  }

  function begin() {
    bodies = [];
    log = [];
    passed = 0;
    sides = null;
    enter(runs[`${methods[0]}|0|`].start, null);
  }

  /** Position and velocity of a planet at a place in the picture, as a fraction of a circle's speed along a direction. */
  function planet([x, y], [u, v] = []) {
    const r = Math.hypot(x, y), circle = Math.sqrt((G * run(0).masses[0]) / r), sun = body(run(0).y, 0);
    const velocity = u === undefined ? [(-y / r) * circle, (x / r) * circle] : [u * circle, v * circle];
    return [...upright([x, y]), ...upright(velocity)].map((each, k) => each + sun[k]);
  }

  function chosen() {
    const a = (angle.value * Math.PI) / 180, [c, s] = [Math.cos(a), Math.sin(a)];
    return [[distance.value * c, distance.value * s], [-speed.value * s, speed.value * c]];
  }

  add.addEventListener("click", () => restart(planet(...chosen())));
  meet.addEventListener("click", () => {
    begin();
    mass.element.querySelector("select").value = "a Jupiter";
    const [x, y] = flat(run(0).y, names.indexOf("Jupiter")), ahead = 0.3, out = 1.15;
    restart(planet([out * (Math.cos(ahead) * x - Math.sin(ahead) * y), out * (Math.sin(ahead) * x + Math.cos(ahead) * y)]));
  });
  pause.addEventListener("click", () => {
    going = !going;
    pause.textContent = going ? "Pause" : "Go on";
    if (going) requestAnimationFrame(begun);
  });
  anew.addEventListener("click", begin);
  back.addEventListener("click", () => { step.position = Math.log10(365.25 * dt); restart(null); });
  for (const figure of figures) {
    const at = (event) => {
      const [left, top, width, height] = figure.box, [x0, x1, y0, y1] = figure.span;
      return [x0 + ((event.offsetX - left) / width) * (x1 - x0), y1 - ((event.offsetY - top) / height) * (y1 - y0)];
    };
    figure.canvas.style.touchAction = "none";
    figure.canvas.style.cursor = "crosshair";
    figure.canvas.addEventListener("pointerdown", (event) => {
      figure.canvas.setPointerCapture(event.pointerId);
      drag = { from: at(event), to: at(event), moved: 0, x: event.offsetX, y: event.offsetY };
    });
    figure.canvas.addEventListener("pointermove", (event) => {
      if (!drag) return;
      drag.to = at(event);
      drag.moved = Math.max(drag.moved, Math.hypot(event.offsetX - drag.x, event.offsetY - drag.y));
      draw();
    });
    figure.canvas.addEventListener("pointercancel", () => { drag = null; });
    figure.canvas.addEventListener("pointerup", () => {
      const { from, to, moved } = drag ?? {};
      drag = null;
      if (!from || Math.hypot(...from) < 0.05) return;
      const half = Math.hypot(...from) / 2; // a drag over half the distance from the Sun is the speed of a circle
      restart(planet(from, moved < CLICK ? undefined : [(to[0] - from[0]) / half, (to[1] - from[1]) / half]));
    });
  }

  /** Add the present places to the trails, and see how near the new planets are to others. */
  function record() {
    methods.forEach((_, k) => sides[k].forEach((trail, i) => {
      const [x, y] = flat(run(k).y, i), [a, b] = trail.at(-1) ?? [Infinity, Infinity];
      if (Math.hypot(x - a, y - b) < TURN * Math.hypot(x, y)) return;
      trail.push([x, y]);
      if (trail.length > POINTS) trail.shift();
    }));
    const { y, masses } = run(0), n = count(), between = (i, j) => Math.hypot(y[i] - y[j], y[n + i] - y[n + j], y[2 * n + i] - y[2 * n + j]);
    for (let i = names.length; i < n; i++) {
      for (let j = 1; j < i; j++) {
        const hill = Math.max(between(i, 0), between(j, 0)) * ((masses[i] + masses[j]) / (3 * masses[0])) ** (1 / 3), ratio = between(i, j) / hill;
        if (ratio < nearest.ratio) nearest = { ratio, i, j, time: passed + run(0).time };
      }
    }
  }

  function begun(now) { last = now; picture(now); }

  function picture(now) {
    behind += (Math.min(0.1, (now - last) / 1000) * rate.value) / run(0).dt;
    last = now;
    const until = performance.now() + BUDGET;
    while (behind >= 1 && performance.now() < until && !blown()) {
      const steps = Math.min(AT_A_TIME, Math.floor(behind));
      methods.forEach((_, k) => run(k).advance(steps));
      behind -= steps;
      record();
    }
    behind = Math.min(behind, AT_A_TIME);
    if (pictures++ % LOOK === 0) look();
    draw();
    if (going) requestAnimationFrame(picture);
  }

  const blown = () => methods.some((_, k) => run(k).status);
  const called = (i) => names[i] ?? `planet ${i - names.length + 1}`;

  function look() {
    const energies = methods.map((_, k) => run(k).energy), bad = blown() || !energies.every(Number.isFinite);
    back.hidden = !bad;
    if (bad) warning.textContent = `The run blew up at year ${short(2000 + passed + run(0).time)}. Take a shorter step.`;
    else {
      good = methods.map((_, k) => Float64Array.from(run(k).y));
      looks.push([passed + run(0).time, ...energies.map((each, k) => Math.max(FLOOR, Math.abs((each - firsts[k]) / firsts[k])))]);
      looks = looks.slice(-WINDOW);
      if (nearest.ratio < 1) {
        warning.textContent = `${called(nearest.i)} comes within ${short(nearest.ratio)} Hill radii of ${called(nearest.j)} in ${Math.floor(2000 + nearest.time)}. ` +
          "The Wisdom-Holman map does not follow close encounters; gauss-radau15 and trace do.";
      }
    }
    say();
    const [from, to] = [looks[0]?.[0] ?? 0, looks.at(-1)?.[0] ?? 0];
    error.begin([from, Math.max(to, from + 0.01)], [1e-16, 10], { log: true, xlabel: "years since 2000", ylabel: "|E - E0| / |E0|", said: text.textContent });
    methods.forEach((_, k) => error.line(looks.map((each) => [each[0], each[k + 1]]), k ? "--b" : "--a"));
  }

  function say() {
    const errors = looks.at(-1)?.slice(1) ?? [0, 0];
    text.replaceChildren(`Year ${(2000 + passed + run(0).time).toFixed(1)}. `, ...methods.flatMap((each, k) =>
      [make("span", { class: k ? "b" : "a" }, `${each}: energy error ${short(errors[k])}, ${run(k).evaluations.toLocaleString("en")} force evaluations. `)]));
    const numbers = (list) => `[${list.join(", ")}]`, lines = log.flatMap(({ steps, more }, k) => [
      ...(steps ? [`sim.run(${steps})`] : []),
      `system = sim.now()${!more ? "" : `.with_body("new ${log.slice(0, k + 1).filter((each) => each.more).length}", mass=${added[mass.value]},\n` +
        `    position=${numbers(more.slice(0, 3))},\n    velocity=${numbers(more.slice(3))})`}`,
      `sim = kd.Simulation(system, "${methods[0]}", dt=${log[k + 1]?.dt ?? run(0).dt})`,
    ]);
    python({ method: methods[0], dt: log[0]?.dt ?? run(0).dt, lines: lines.map((each) => `${each}\n`).join("") });
  }

  function draw() {
    const wide = view.value;
    figures.forEach((figure, k) => {
      const { y } = run(k), n = count(), ink = () => figure.context;
      figure.begin([-wide, wide], [-wide, wide], { square: true, xlabel: "AU", ylabel: "AU", said: `The Sun and ${n - 1} bodies around it. ${text.textContent}` });
      for (let i = 1; i < n; i++) figure.line(sides[k][i].concat([flat(y, i)]), i < names.length ? "--edge" : k ? "--b" : "--a");
      for (let i = 0; i < n; i++) {
        const [x, up] = flat(y, i);
        if (!Number.isFinite(x + up)) continue;
        figure.dot(x, up, i ? (i < names.length ? "--faint" : k ? "--b" : "--a") : "--ink", i ? 3.5 : 5);
        ink().textAlign = "left";
        if (!i || Math.hypot(x, up) > wide / 8) ink().fillText(called(i), figure.x(x) + 6, figure.y(up) - 4);
      }
      if (bodies.length < most) ghost(figure);
      if (drag) figure.line([drag.from, drag.to], "--alarm");
    });
  }

  /** A ring where the sliders place the next planet. */
  function ghost(figure) {
    const [[x, y]] = chosen(), ink = figure.context;
    ink.strokeStyle = figure.colour("--faint");
    ink.beginPath();
    ink.arc(figure.x(x), figure.y(y), 5, 0, 2 * Math.PI);
    ink.stroke();
  }

  begin();
  requestAnimationFrame(begun);
  globalThis.planets = { run, restart, planet };
  return () => { look(); draw(); };
}

begin(page);
