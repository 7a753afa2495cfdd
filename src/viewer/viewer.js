// The kickdrift viewer: a scene that turns, in a page, in a notebook, or beside a run that goes on.
//
//   const view = await mount(element, scene, {live: false});
//
// `element` is any empty block element with a size. `scene` is the plain object of kickdrift.view.scene.scene_of.
// `mount` fills the element and returns, once the first frames are unpacked:
//
//   view.append(chunk)        adds the moments of a chunk (Stage.chunk in Python) and returns a promise. With {live: true},
//                             a view at its last frame moves on to the new last frame.
//   view.addCurves(curves)    adds points to the curves of these names (kickdrift.view.packing.curve), or new curves
//   view.show(places, speeds) shows these places (3 n) and speeds (n) in the frame's stead, for a run inside the page
//   view.say(text)            shows a line of status beside the title, such as a rate and the time left
//   view.setFrame(k)          shows frame k
//   view.frame, view.count    the number of the frame that is shown, and how many frames there are
//   view.play(), view.pause() start and stop playing
//   view.setColour(name)      colours the particles by "species", "speed", … (scene.colours)
//   view.snapshot()           returns a promise of a PNG Blob of the picture
//   view.saveSnapshot()       downloads that PNG
//   view.fps                  frames drawn per second over the last second of playing
//   view.dispose()            stops drawing, frees the graphics memory and empties the element
//
// All text is set by textContent. The viewer loads nothing and sends nothing. Two views may share a page.
// The bundle (`npm run build` writes src/kickdrift/view/assets/viewer.js) is an ES module: it exports `mount`, and it also
// sets globalThis.kickdriftView = {mount} for pages and widgets that hold the bundle as text.

import {classColour, mapped} from "./colours.js";
import {Controls, element} from "./controls.js";
import {Drawing, THEMES} from "./drawing.js";
import {Moments} from "./moments.js";
import {unpacked} from "./packed.js";
import {STYLE} from "./style.js";

const LASTS = 20; // seconds that a run lasts at speed 1, within the limits below
const FEWEST = 8, MOST = 120; // frames a second
const TURN = 0.35; // radians a second
const TOLD = 120; // milliseconds between updates of the clock while playing

class View {
  constructor(host, scene, {live}) {
    this.host = host;
    this.scene = scene;
    this.live = live;
    this.frame = 0;
    this.speed = 1;
    this.plays = false;
    this.gone = false;
    this.told = 0;
    this.fps = 0;
    this.past = [];
  }

  async begin() {
    const {host, scene} = this;
    const shade = host.attachShadow({mode: "open"});
    const style = element("style");
    style.textContent = STYLE;
    this.root = element("div", "view");
    this.root.tabIndex = 0;
    shade.append(style, this.root);
    const canvas = element("canvas"), names = element("div", "names");
    this.root.append(canvas, names);
    const [radii, pixels, species, masses] =
      await Promise.all([scene.radii, scene.pixels, scene.speciesOf, scene.masses].map(unpacked));
    const [bonds, molecules] = scene.bonds ? await Promise.all([scene.bonds, scene.moleculeOf].map(unpacked)) : [null, null];
    this.molecules = molecules;
    this.species = species;
    this.parts = new Float32Array(scene.shown);
    this.moments = new Moments(masses);
    for (const chunk of scene.chunks) await this.moments.add(chunk);
    this.drawing = new Drawing(canvas, names, scene, this.moments, radii, pixels, bonds);
    this.drawing.wake = () => this.wake();
    this.controls = new Controls(this.root, scene, this.acts());
    for (const curve of scene.curves) {
      await this.controls.curves.add(curve);
    }
    for (const box of this.controls.panel.querySelectorAll(".curve")) box.classList.add("card");
    this.compass = element("canvas", "compass");
    this.root.append(this.compass);
    this.prefers = globalThis.matchMedia?.("(prefers-color-scheme: dark)");
    this.follow = () => this.themed(this.prefers?.matches ? "dark" : "light");
    this.prefers?.addEventListener("change", this.follow);
    this.watch = new ResizeObserver(() => this.sized());
    this.watch.observe(this.root);
    this.follow();
    this.sized();
    this.controls.counted(this.count, this.moments);
    this.setColour(scene.colour);
    this.setFrame(this.live ? Infinity : 0);
    if (this.root.clientWidth < 720) this.controls.panel.classList.add("hidden");
    return this;
  }

  get count() { return this.moments.count; }

  acts() {
    const {drawing} = this;
    return {
      play: () => (this.plays ? this.pause() : this.play()),
      step: (by) => { this.pause(); this.setFrame(this.frame + by); },
      frame: (k) => { this.pause(); this.setFrame(k); },
      time: (time) => { this.pause(); this.setFrame(this.moments.nearest(time)); },
      speed: (speed) => { this.speed = speed; },
      colour: (name) => this.setColour(name),
      size: (factor) => { drawing.factor = factor; drawing.place(); },
      reset: () => drawing.reset(),
      save: () => this.saveSnapshot(),
      theme: () => this.themed(this.theme === "dark" ? "light" : "dark"),
      themed: () => this.themed(this.theme),
      turn: () => {
        drawing.spin = !drawing.spin;
        this.controls.turn.ariaPressed = String(drawing.spin);
        drawing.touch();
      },
      lines: () => {
        const {shows} = drawing;
        shows.box = !shows.box;
        shows.trails = shows.ellipses = shows.box;
        drawing.place();
      },
      names: () => { drawing.shows.names = !drawing.shows.names; drawing.touch(); },
    };
  }

  sized() {
    const {clientWidth, clientHeight} = this.root, first = !this.drawing.width;
    this.drawing.sized(clientWidth, clientHeight);
    if (first) this.drawing.reset();
    this.themed(this.theme);
  }

  themed(name) {
    this.theme = name;
    this.root.dataset.theme = name;
    this.drawing.theme = THEMES[name];
    const set = getComputedStyle(this.root);
    this.controls.curves.draw(set.getPropertyValue("--ink"), set.getPropertyValue("--mark"));
    if (this.count) this.controls.curves.mark(this.moments.time(this.frame));
    this.drawing.place();
  }

  setColour(name) {
    const colour = this.scene.colours.find((each) => each.name === name);
    if (!colour) throw new Error(`no colour ${name}`);
    this.colour = colour;
    this.controls.keyed(colour, this.moments.ranges[name]);
    this.coloured();
    this.drawing.place(this.frame);
  }

  /** Writes the colours of the present frame. */
  coloured() {
    const {look} = this.drawing.spheres, {central, names} = this.scene;
    if (this.colour.kind === "range") {
      mapped(this.moments.parts(this.colour.name, this.frame, this.parts), look);
    } else if (!this.painted || this.painted !== this.colour) {
      const {name} = this.colour, classes = name === "molecule" ? this.molecules : this.species, body = name === "body";
      for (let i = 0; i < classes.length; i++) look.set(classColour(body ? i : classes[i], body ? central : null), 4 * i);
    }
    this.painted = this.colour;
    if (central !== null && names.length > 2) look[4 * central + 3] = 255;
  }

  setFrame(k) {
    if (!this.count) return;
    this.frame = Math.max(0, Math.min(this.count - 1, k));
    if (this.colour?.kind === "range") this.coloured();
    this.drawing.place(this.frame);
    const now = performance.now();
    if (!this.plays || now - this.told > TOLD) this.tell(now);
  }

  /** Updates slider, clock and curves. These cost more than the particles where a processor draws, so not in each frame. */
  tell(now) {
    this.told = now;
    this.controls.shown(this.frame, this.count, this.moments.time(this.frame), this.moments.step(this.frame));
  }

  async append(chunk) {
    const last = this.frame >= this.count - 1;
    await this.moments.add(chunk);
    if (this.gone) return;
    this.controls.counted(this.count, this.moments);
    if (this.colour.kind === "range") this.controls.keyed(this.colour, this.moments.ranges[this.colour.name]);
    this.setFrame(this.live && last && !this.plays ? this.count - 1 : this.frame);
  }

  async addCurves(curves) {
    for (const curve of curves) await this.controls.curves.add(curve);
    if (this.gone) return;
    for (const box of this.controls.panel.querySelectorAll(".curve")) box.classList.add("card");
    this.themed(this.theme);
  }

  show(places, speeds) {
    this.moments.present = {places, speeds};
    this.runs = true;
    this.controls.clock.parentElement.classList.add("hidden");
    this.setFrame(this.frame);
  }

  say(text) { this.controls.status.textContent = text; }

  play() {
    if (this.count < 2) return;
    if (this.frame >= this.count - 1) this.setFrame(0);
    this.plays = true;
    this.owed = 0;
    this.past = [];
    this.controls.played(true);
    this.wake();
  }

  pause() {
    if (this.plays) this.tell(performance.now());
    this.plays = false;
    this.controls.played(false);
    this.drawing.touch();
  }

  wake() {
    if (this.asked || this.gone) return;
    this.asked = requestAnimationFrame((now) => this.tick(now));
  }

  tick(now) {
    this.asked = 0;
    const took = now - (this.last ?? now);
    this.last = now;
    const seconds = Math.min(took, 250) / 1000;
    if (this.plays) this.advanced(seconds);
    if (this.drawing.spin) this.turned(seconds);
    const more = this.drawing.draw(now, took, this.plays || this.runs);
    this.runs = false;
    this.oriented();
    if (this.plays) this.measured(now);
    if (more || this.plays) this.wake();
    else this.last = undefined;
  }

  advanced(seconds) {
    const rate = this.speed * Math.max(FEWEST, Math.min(MOST, this.count / LASTS));
    this.owed += seconds * rate;
    const by = Math.floor(this.owed);
    this.owed -= by;
    if (by) this.setFrame(this.frame + by);
    if (this.frame >= this.count - 1 && !this.live) {
      this.owed = 0;
      this.pause();
    }
  }

  turned(seconds) {
    const {camera, controls} = this.drawing;
    camera.position.sub(controls.target).applyAxisAngle(camera.up, TURN * seconds).add(controls.target);
    controls.update();
  }

  measured(now) {
    this.past.push(now);
    while (this.past[0] < now - 1000) this.past.shift();
    const span = now - this.past[0];
    if (span > 0) this.fps = (1000 * (this.past.length - 1)) / span;
  }

  /** Draws the directions of x, y and z. */
  oriented() {
    const turn = this.drawing.camera.quaternion.toArray().join();
    if (turn === this.drawn) return;
    this.drawn = turn;
    const size = 64, ratio = 2, on = this.compass.getContext("2d");
    if (this.compass.width !== size * ratio) this.compass.width = this.compass.height = size * ratio;
    on.setTransform(ratio, 0, 0, ratio, 0, 0);
    on.clearRect(0, 0, size, size);
    on.font = "11px system-ui, sans-serif";
    on.textAlign = "center";
    on.textBaseline = "middle";
    const ends = this.drawing.axes().map((axis, k) => ({axis, k})).sort((a, b) => a.axis[2] - b.axis[2]);
    for (const {axis: [x, y, z], k} of ends) {
      on.globalAlpha = 0.75 + 0.25 * z;
      on.strokeStyle = on.fillStyle = ["#e0605e", "#3fae6b", "#4c8fe8"][k];
      on.lineWidth = 1.8;
      on.beginPath();
      on.moveTo(32, 32);
      on.lineTo(32 + 19 * x, 32 - 19 * y);
      on.stroke();
      on.fillText("xyz"[k], 32 + 26 * x, 32 - 26 * y);
    }
    on.globalAlpha = 1;
  }

  snapshot() {
    return this.drawing.snapshot(`${this.scene.title}   ${this.controls.time.textContent}`);
  }

  async saveSnapshot() {
    const blob = await this.snapshot(), link = element("a");
    link.href = URL.createObjectURL(blob);
    link.download = `${this.scene.title.replace(/[^\w.-]+/g, "-") || "view"}-${this.frame}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  focus() { this.root.focus({preventScroll: true}); }

  dispose() {
    this.gone = true;
    cancelAnimationFrame(this.asked);
    this.watch.disconnect();
    this.prefers?.removeEventListener("change", this.follow);
    this.drawing.dispose();
    this.host.remove();
  }
}

/** Shows a scene in an element; see the top of this file. */
export async function mount(element_, scene, {live = false} = {}) {
  const host = document.createElement("div");
  host.style.cssText = "display: block; width: 100%; height: 100%";
  element_.append(host);
  try {
    return await new View(host, scene, {live}).begin();
  } catch (error) {
    host.remove();
    const said = element("p", "", `The view cannot be shown: ${error.message}. It needs WebGL 2 and a browser of 2023 or later.`);
    said.style.cssText = "font: 14px system-ui, sans-serif; padding: 1em";
    element_.append(said);
    throw error;
  }
}

globalThis.kickdriftView = {mount};
