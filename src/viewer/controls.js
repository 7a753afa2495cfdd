// Everything around the picture: title, buttons, legend, slider, curves and text. All text is set by textContent.

import {classColour, css, GRADIENT} from "./colours.js";
import {Curves, short} from "./curves.js";
import {ICONS} from "./style.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8];
const MOST_CLASSES = 12;
const KEYS = [["space", "play or pause"], ["← →", "one frame back or on"], ["shift ← →", "ten frames"],
  ["home, end", "first or last frame"], ["+ −", "faster or slower"], ["r", "view as at the start"], ["t", "turn slowly"],
  ["s", "save a picture"], ["b", "box, or trails and orbits"], ["n", "names"], ["d", "dark or light"], ["i", "curves and report"],
  ["drag, pinch, wheel", "turn and zoom; right button or two fingers move"], ["?", "this list"]];

export function element(kind, css = "", text = "") {
  const made = document.createElement(kind);
  if (css) made.className = css;
  if (text) made.textContent = text;
  return made;
}

function icon(name) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  made.setAttribute("viewBox", "0 0 16 16");
  made.setAttribute("aria-hidden", "true");
  for (const [d, css] of ICONS[name]) {
    const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
    path.setAttribute("d", d);
    if (css) path.setAttribute("class", css);
    made.append(path);
  }
  return made;
}

export class Controls {
  /** `act` has a function for each thing that a user can do. */
  constructor(root, scene, act) {
    this.root = root;
    this.scene = scene;
    this.act = act;
    root.append(this.head(), this.side(), this.legend(), this.tools(), this.foot(), this.help());
    this.listen();
  }

  button(name, label, does) {
    const made = element("button", "tool");
    made.type = "button";
    made.title = made.ariaLabel = label;
    made.dataset.act = name;
    made.append(icon(name));
    made.addEventListener("click", does);
    return made;
  }

  head() {
    const {scene} = this, head = element("div", "head");
    const what = scene.kind === "orbits" ? "bodies" : "particles";
    const parts = [`${scene.total.toLocaleString("en")} ${what}`, ...scene.caption ?? []];
    this.status = element("div", "status");
    head.append(element("div", "title", scene.title), element("div", "caption", parts.join(" · ")), this.status);
    return head;
  }

  side() {
    const {scene} = this, side = element("div", "side");
    const curves = element("div", "curves");
    curves.style.display = "contents";
    side.append(curves);
    this.curves = new Curves(curves, (time) => this.act.time(time));
    if (scene.events.length) side.append(this.events());
    if (scene.verdict.length) {
      const card = element("details", "card verdict"), list = element("dl");
      card.append(element("summary", "", "Report"), list);
      for (const [key, text] of scene.verdict) list.append(element("dt", "", key), element("dd", "", text));
      side.append(card);
    }
    const notes = scene.toScale ? scene.notes : [...scene.notes, "Sizes are not to scale."];
    if (notes.length) {
      const card = element("div", "card notes");
      for (const note of notes) card.append(element("div", "note", note));
      side.append(card);
    }
    this.panel = side;
    return side;
  }

  events() {
    const {scene} = this, card = element("details", "card");
    card.append(element("summary", "", `Events (${scene.events.length})`));
    for (const {time, text} of scene.events) {
      const row = element("button", "event", `${short(time)} ${scene.units.time}  ${text}`);
      row.addEventListener("click", () => this.act.time(time));
      card.append(row);
    }
    return card;
  }

  legend() {
    const {scene} = this, card = element("div", "card legend"), row = element("label");
    this.colour = element("select");
    for (const {name, label} of scene.colours) {
      const option = element("option", "", label);
      option.value = name;
      this.colour.append(option);
    }
    this.colour.addEventListener("change", () => { this.act.colour(this.colour.value); this.root.focus(); });
    row.append(element("span", "", "Colour"), this.colour);
    this.key = element("div");
    const size = element("label", "size"), slider = element("input");
    Object.assign(slider, {type: "range", min: -1, max: 1, step: 0.02, value: Math.log10(scene.size)});
    slider.ariaLabel = "Size of the particles";
    slider.addEventListener("input", () => this.act.size(10 ** slider.value));
    slider.addEventListener("keydown", (event) => event.stopPropagation());
    size.append(element("span", "", "Size"), slider);
    card.append(row, this.key, size);
    return card;
  }

  /** Shows the legend of a colour. */
  keyed(colour, range) {
    const {scene} = this;
    this.colour.value = colour.name;
    this.key.replaceChildren();
    if (colour.kind === "class") {
      const names = scene.species, list = element("div", "classes");
      if (colour.name !== "species") return; // each body has its name beside it, and molecules have no names
      names.slice(0, MOST_CLASSES).forEach((name, k) => {
        const each = element("span", "class"), dot = element("i");
        dot.style.background = css(classColour(k));
        each.append(dot, element("span", "", name));
        list.append(each);
      });
      if (names.length > MOST_CLASSES) list.append(element("span", "note", `and ${names.length - MOST_CLASSES} more`));
      this.key.append(list);
      return;
    }
    const bar = element("div", "bar"), ends = element("div", "ends");
    bar.style.background = GRADIENT;
    const unit = colour.unit ? ` ${colour.unit}` : "";
    ends.append(element("span", "", short(range?.low ?? 0)), element("span", "", `${range?.beyond ? "≥ " : ""}${short(range?.high ?? 0)}${unit}`));
    this.key.append(bar, ends);
  }

  tools() {
    const made = element("div", "tools"), {act, scene} = this;
    this.lines = this.button(scene.periodic ? "box" : "orbits", scene.periodic ? "Box (b)" : "Trails and orbits (b)", act.lines);
    if (!scene.periodic && scene.kind !== "orbits") this.lines.classList.add("hidden");
    this.turn = this.button("turn", "Turn slowly (t)", act.turn);
    made.append(this.lines, this.turn, this.button("reset", "View as at the start (r)", act.reset),
      this.button("camera", "Save a picture (s)", act.save), this.button("theme", "Dark or light (d)", act.theme),
      this.button("panel", "Curves and report (i)", () => this.toggled()), this.button("help", "Keys (?)", () => this.helped()));
    return made;
  }

  foot() {
    const foot = element("div", "card foot"), {act} = this, track = element("div", "track");
    this.playing = this.button("play", "Play (space)", act.play);
    this.slider = element("input");
    Object.assign(this.slider, {type: "range", min: 0, max: 0, step: 1, value: 0});
    this.slider.ariaLabel = "Time";
    this.slider.addEventListener("input", () => act.frame(Number(this.slider.value)));
    this.ticks = element("div", "ticks");
    track.append(this.ticks, this.slider);
    this.speed = element("select", "wide");
    this.speed.ariaLabel = this.speed.title = "Speed of playing";
    for (const speed of SPEEDS) {
      const option = element("option", "", `${speed} ×`);
      option.value = speed;
      this.speed.append(option);
    }
    this.speed.value = 1;
    this.speed.addEventListener("change", () => { act.speed(Number(this.speed.value)); this.root.focus(); });
    this.clock = element("div", "clock");
    this.time = element("b");
    this.count = element("span");
    this.clock.append(this.time, this.count);
    const back = this.button("back", "One frame back (←)", () => act.step(-1));
    const on = this.button("on", "One frame on (→)", () => act.step(1));
    back.classList.add("wide");
    on.classList.add("wide");
    foot.append(this.playing, back, on, track, this.speed, this.clock);
    this.moving = [this.playing, back, on, track, this.speed];
    return foot;
  }

  help() {
    this.sheet = element("div", "card help hidden");
    this.sheet.append(element("h2", "", "Keys and touch"));
    for (const [key, text] of KEYS) {
      const row = element("div");
      row.append(element("kbd", "", key), element("span", "", text));
      this.sheet.append(row);
    }
    this.sheet.addEventListener("click", () => this.helped());
    return this.sheet;
  }

  helped() { this.sheet.classList.toggle("hidden"); }
  toggled() { this.panel.classList.toggle("hidden"); this.act.themed(); }

  faster(by) {
    const k = Math.max(0, Math.min(SPEEDS.length - 1, SPEEDS.indexOf(Number(this.speed.value)) + by));
    this.speed.value = SPEEDS[k];
    this.act.speed(SPEEDS[k]);
  }

  listen() {
    const {act, root} = this;
    const does = {" ": act.play, ArrowLeft: (e) => act.step(e.shiftKey ? -10 : -1), ArrowRight: (e) => act.step(e.shiftKey ? 10 : 1),
      Home: () => act.frame(0), End: () => act.frame(Infinity), r: act.reset, s: act.save, t: act.turn, b: act.lines, n: act.names,
      d: act.theme, i: () => this.toggled(), "?": () => this.helped(), "+": () => this.faster(1), "=": () => this.faster(1),
      "-": () => this.faster(-1), Escape: () => this.sheet.classList.add("hidden")};
    root.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.target instanceof HTMLSelectElement) return;
      const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
      if (!does[key]) return;
      if (key === " " && event.target instanceof HTMLButtonElement) event.target.blur();
      event.preventDefault();
      event.stopPropagation();
      does[key](event);
      if (!root.contains(root.getRootNode().activeElement)) root.focus();
    });
    root.addEventListener("pointerdown", (event) => {
      if (!(event.target instanceof HTMLSelectElement || event.target instanceof HTMLInputElement)) root.focus({preventScroll: true});
    });
  }

  /** Shows the number of frames, and where on the slider the events are. */
  counted(count, moments) {
    this.slider.max = Math.max(0, count - 1);
    for (const each of this.moving) each.classList.toggle("hidden", count < 2);
    this.clock.parentElement.classList.toggle("single", count < 2);
    this.ticks.replaceChildren();
    if (count < 2) return;
    const places = new Set(this.scene.events.map(({time}) => Math.round((200 * moments.nearest(time)) / (count - 1))));
    for (const place of places) {
      const tick = element("i");
      tick.style.left = `${place / 2}%`;
      this.ticks.append(tick);
    }
  }

  /** Shows the present frame. */
  shown(k, count, time, step) {
    const {units} = this.scene;
    this.slider.value = k;
    const digits = Math.abs(time) >= 1e6 ? time.toExponential(4) : Number(time.toPrecision(6)).toString();
    this.time.textContent = `t = ${digits.replace("-", "−")}${units.time ? ` ${units.time}` : ""}`;
    this.count.textContent = `step ${step.toLocaleString("en")} · frame ${k + 1} of ${count}`;
    this.curves.mark(time);
  }

  played(plays) {
    this.playing.replaceChildren(icon(plays ? "pause" : "play"));
    this.playing.title = this.playing.ariaLabel = plays ? "Pause (space)" : "Play (space)";
  }
}
