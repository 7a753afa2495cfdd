// The picture: camera, spheres, box, trails, ellipses and names, drawn by three.js when something has changed.

import {Color, Group, PerspectiveCamera, Quaternion, Scene, Vector3, WebGLRenderer} from "three";
import {OrbitControls} from "three/addons/controls/OrbitControls.js";
import {css, rgb} from "./colours.js";
import {Lines} from "./lines.js";
import {Spheres} from "./spheres.js";

const TURN = 96; // pieces of an ellipse
const TRAIL = 600, PIECES = 6000; // frames of a trail, and pieces of all trails
const TAIL = 0.75; // of a revolution, for the trail of a body on an ellipse
const COARSE = 0.5; // largest turn between frames, in radians, for which a trail is a path
const SLOW = 30, QUICK = 14; // milliseconds a frame between which the resolution stays
const STILL = 220; // milliseconds without motion before a picture of full sharpness

export const THEMES = {
  light: {background: "#f6f7f9", ink: "#20262e", box: "#5c6672"},
  dark: {background: "#0d1117", ink: "#e6eaf0", box: "#8b98a8"},
};

export class Drawing {
  constructor(canvas, names, scene, moments, radii, pixels, bonds) {
    this.scene = scene;
    this.moments = moments;
    this.theme = THEMES.light;
    this.shows = {box: true, trails: true, ellipses: true, names: true};
    this.factor = scene.size;
    this.follow = null;
    this.spin = false;
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({canvas, antialias: false, powerPreference: "high-performance"});
    this.world = new Scene();
    this.group = new Group();
    this.world.add(this.group);
    this.camera = new PerspectiveCamera(32, 1, 0.01, 100);
    this.camera.up.set(...scene.up);
    this.spheres = new Spheres(radii, pixels);
    this.group.add(this.spheres.mesh);
    const bodies = scene.kind === "orbits" ? scene.shown : 0;
    this.boxLines = scene.periodic ? new Lines(12, 0.7) : null;
    this.trailLines = bodies ? new Lines(bodies * TRAIL, 1.1) : null;
    this.ellipseLines = bodies ? new Lines(bodies * TURN, 0.7) : null;
    this.bonds = bonds;
    this.bondLines = bonds ? new Lines(bonds.length / 2, 1.6) : null;
    for (const lines of this.lines) this.group.add(lines.mesh);
    this.labels = scene.names.map((name, i) => this.label(names, name, i));
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.zoomSpeed = 1.2;
    this.controls.minDistance = scene.reach * 1e-4;
    this.controls.maxDistance = scene.reach * 200;
    this.controls.addEventListener("change", () => this.touch());
    this.sharp = Math.max(2, Math.min(3, globalThis.devicePixelRatio || 1));
    this.ratio = this.quick = Math.min(globalThis.devicePixelRatio || 1, 2);
    this.moved = -Infinity;
    this.reset();
  }

  get lines() { return [this.boxLines, this.bondLines, this.ellipseLines, this.trailLines].filter(Boolean); }

  label(parent, name, i) {
    const made = document.createElement("button");
    made.className = "name";
    made.textContent = name;
    made.title = "Click: keep this body in the middle";
    made.addEventListener("click", () => this.centreOn(this.follow === i ? null : i));
    parent.append(made);
    return made;
  }

  /** Puts the camera where the view begins. */
  reset() {
    const {scene, camera} = this, up = new Vector3(...scene.up);
    const turn = new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), up);
    const from = scene.flat ? [0, -0.001, 1] : scene.kind === "box" ? [0.78, -1.3, 0.62] : [0.25, -1.0, 0.85];
    const height = this.height || 1, flat = scene.kind === "orbits" ? 0.72 : 1; // orbits lie in a plane
    const free = Math.min((height - 120) / flat, (this.width || 1) - (this.width > 720 ? 320 : 20));
    const part = Math.max(0.3, free / height) * (scene.kind === "box" ? 1.06 : 0.98);
    const far = scene.reach / part / Math.sin((camera.fov * Math.PI) / 360);
    this.origin = this.follow === null ? scene.centre : this.origin;
    this.controls.target.set(0, 0, 0);
    camera.position.copy(new Vector3(...from).normalize().multiplyScalar(far).applyQuaternion(turn));
    this.controls.update();
    this.place();
  }

  /** Keeps a body in the middle; null: none. */
  centreOn(i) {
    this.follow = i;
    this.origin = this.scene.centre;
    this.labels.forEach((label, k) => label.classList.toggle("followed", k === i));
    this.controls.target.set(0, 0, 0);
    this.place();
  }

  /** Shows frame k, or the present frame anew. */
  place(k = this.frame ?? 0) {
    this.frame = k;
    if (!this.moments.count) return;
    if (this.follow !== null) this.origin = this.moments.place(k, this.follow) ?? this.origin;
    this.moments.places(k, this.origin, this.spheres.places);
    if (this.boxLines) this.drawBox(k);
    if (this.bondLines) this.drawBonds(k);
    if (this.trailLines) this.drawTrails(k);
    if (this.ellipseLines) this.drawEllipses(k);
    this.touch();
  }

  drawBox(k) {
    const {boxLines: lines, scene} = this, {origin, matrix: m} = this.moments.cell(k);
    lines.clear();
    const ends = scene.periodic.map((periodic) => (periodic ? [0, 1] : [0.5]));
    const corner = (s) => [0, 1, 2].map((x) => origin[x] - this.origin[x] + s[0] * m[x] + s[1] * m[3 + x] + s[2] * m[6 + x]);
    if (this.shows.box) for (const axis of [0, 1, 2]) {
      if (!scene.periodic[axis]) continue;
      const [p, q] = [0, 1, 2].filter((x) => x !== axis);
      for (const u of ends[p]) for (const w of ends[q]) {
        const from = [0, 0, 0], to = [0, 0, 0];
        from[p] = to[p] = u;
        from[q] = to[q] = w;
        to[axis] = 1;
        lines.piece(corner(from), corner(to), rgb(this.theme.box), 0.9, 0.9);
      }
    }
    lines.done();
  }

  /** Draws bonds between the surfaces of their spheres. A bond through a face of the box is not drawn. */
  drawBonds(k) {
    const {bondLines: lines, bonds, spheres} = this, {matrix: m} = this.moments.cell(k), p = spheres.places;
    const edges = [0, 1, 2].filter((axis) => this.scene.periodic?.[axis]).map((axis) => Math.hypot(...m.subarray(3 * axis, 3 * axis + 3)));
    const longest = Math.min(Infinity, ...edges) / 2;
    lines.clear();
    for (let b = 0; b < bonds.length; b += 2) {
      const i = bonds[b], j = bonds[b + 1];
      const way = [0, 1, 2].map((x) => p[3 * j + x] - p[3 * i + x]), far = Math.hypot(...way);
      if (!(far < longest)) continue;
      const [start, end] = [0.9 * spheres.radii[i] * this.factor / far, 1 - 0.9 * spheres.radii[j] * this.factor / far];
      if (start >= end) continue;
      const at = (part) => [0, 1, 2].map((x) => p[3 * i + x] + part * way[x]);
      lines.piece(at(start), at(end), this.colourOf(i), 1, 1);
    }
    lines.done();
  }

  colourOf(i) {
    const look = this.spheres.look;
    return [look[4 * i], look[4 * i + 1], look[4 * i + 2]];
  }

  /** Angle by which a body turns between frames on its ellipse, nearly; 0 without an ellipse. */
  turned(i, k) {
    const ellipse = this.moments.ellipse(k, i);
    if (!ellipse || !k) return 0;
    const here = this.moments.place(k, i), near = this.moments.place(k - 1, i), sun = this.scene.central;
    if (!here || !near) return 0;
    const [now, then] = [this.moments.place(k, sun), this.moments.place(k - 1, sun)];
    const way = Math.hypot(...here.map((x, c) => x - near[c] - (now && then ? now[c] - then[c] : 0)));
    return way / Math.hypot(...ellipse.subarray(3, 6));
  }

  drawTrails(k) {
    const {trailLines: lines, moments} = this, most = Math.min(TRAIL, Math.floor(PIECES / this.scene.shown));
    lines.clear();
    if (this.shows.trails) for (let i = 0; i < this.scene.shown; i++) {
      const turn = this.turned(i, k);
      if (turn > COARSE) continue;
      const first = Math.max(0, k - (turn ? Math.min(most, Math.ceil((TAIL * 2 * Math.PI) / turn)) : most));
      let before = null, opacity = 0;
      const colour = this.colourOf(i);
      for (let f = first; f <= k; f++) {
        const at = moments.place(f, i)?.map((x, c) => x - this.origin[c]) ?? null;
        const next = ((f - first) / (k - first || 1)) ** 1.4;
        if (before && at) lines.piece(before, at, colour, opacity, next);
        before = at;
        opacity = next;
      }
    }
    lines.done();
  }

  drawEllipses(k) {
    const {ellipseLines: lines, moments} = this;
    lines.clear();
    if (this.shows.ellipses) for (let i = 0; i < this.scene.shown; i++) {
      const ellipse = moments.ellipse(k, i), at = moments.place(k, i);
      if (!ellipse || !at) continue;
      const point = (angle) => [0, 1, 2].map((x) => at[x] - this.origin[x] + ellipse[x]
        + ellipse[3 + x] * Math.cos(angle) + ellipse[6 + x] * Math.sin(angle));
      const colour = this.colourOf(i), strong = this.turned(i, k) > COARSE ? 0.75 : 0.4;
      for (let s = 0, before = point(0); s < TURN; s++) {
        const next = point(((s + 1) / TURN) * 2 * Math.PI);
        lines.piece(before, next, colour, strong, strong);
        before = next;
      }
    }
    lines.done();
  }

  /** Something moves: draw soon, at the pace of the machine. */
  touch() {
    this.dirty = true;
    this.moved = performance.now();
    this.wake?.();
  }

  sized(width, height) {
    if (!width || !height) return;
    this.width = width;
    this.height = height;
    this.camera.aspect = width / height;
    const side = width > 720 ? 150 : 0, foot = height > 420 ? 26 : 0; // the free part of the page is not in its middle
    this.camera.setViewOffset(width, height, side, foot, width, height);
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.setSize(width, height, false);
    this.place();
  }

  resolution(ratio) {
    if (Math.abs(ratio - this.ratio) < 0.01) return;
    this.ratio = ratio;
    this.renderer.setPixelRatio(ratio);
  }

  /** Chooses the resolution of moving pictures, `took` milliseconds after the last one. */
  paced(took) {
    if (took > 500) return;
    this.pace = 0.85 * (this.pace ?? 16) + 0.15 * took;
    const most = Math.min(globalThis.devicePixelRatio || 1, 2);
    if (this.pace > SLOW && this.quick > 0.5) this.quick = Math.max(0.5, this.quick * 0.85);
    else if (this.pace < QUICK && this.quick < most) this.quick = Math.min(most, this.quick * 1.05);
    else return;
    this.pace = (SLOW + QUICK) / 2;
  }

  /** Draws if something has changed. Returns whether more is to come. */
  draw(now, took, moving) {
    if (!this.width) return false;
    if (this.spin && this.dirty) this.paced(took);
    else if (moving) this.paced(took);
    const still = !moving && !this.spin && now - this.moved > STILL;
    if (!this.dirty && !(still && this.ratio !== this.sharp)) return !still || this.spin;
    this.resolution(still ? this.sharp : this.quick);
    this.render();
    this.dirty = false;
    return !still || this.spin;
  }

  render() {
    const {camera, spheres, scene} = this;
    const far = camera.position.distanceTo(this.controls.target);
    camera.near = Math.max(far * 1e-3, far - scene.reach * 3);
    camera.far = far + scene.reach * 60;
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    const look = camera.getWorldDirection(new Vector3());
    spheres.sorted(look.x, look.y, look.z);
    const set = spheres.material.uniforms;
    set.factor.value = this.factor;
    set.perPixel.value = (2 * Math.tan((camera.fov * Math.PI) / 360)) / this.height;
    set.fog.value = scene.kind === "box" ? [far - scene.reach * 0.6, far + scene.reach * 1.5] : [far, far + 30 * scene.reach];
    set.background.value.setRGB(...rgb(this.theme.background).map((x) => x / 255));
    for (const lines of this.lines) {
      lines.material.uniforms.screen.value = [this.width / 2, this.height / 2];
      lines.material.uniforms.near.value = camera.near;
    }
    this.renderer.setClearColor(new Color(this.theme.background));
    this.renderer.render(this.world, camera);
    this.placeNames();
  }

  placeNames() {
    const {labels, spheres, camera, width, height} = this, taken = [], at = new Vector3();
    const perLength = height / (2 * Math.tan((camera.fov * Math.PI) / 360)), eye = new Vector3();
    const order = labels.map((_, i) => i).sort((i, j) => spheres.pixels[j] - spheres.pixels[i]);
    for (const i of order) {
      const deep = -eye.fromArray(spheres.places, 3 * i).applyMatrix4(camera.matrixWorldInverse).z;
      const wide = Math.max((spheres.radii[i] * this.factor * perLength) / deep, spheres.pixels[i] * Math.sqrt(this.factor));
      at.fromArray(spheres.places, 3 * i).project(camera);
      const x = ((at.x + 1) / 2) * width, y = ((1 - at.y) / 2) * height;
      const inside = Number.isFinite(x) && Math.abs(at.z) < 1 && x > 0 && x < width && y > 0 && y < height;
      const gap = Math.max(9, wide + 2), long = (labels[i].long ||= labels[i].offsetWidth || 7 * labels[i].textContent.length);
      const clear = (left) => !taken.some(([p, q, w]) => Math.abs(q - y) < 14 && left < w && p < left + long);
      const left = [x + gap, x - gap - long].find(clear); // a name stands at the right of its body, else at the left
      const shown = this.shows.names && inside && left !== undefined;
      labels[i].style.visibility = shown ? "visible" : "hidden";
      if (!shown) continue;
      taken.push([left, y, left + long]);
      labels[i].style.transform = `translate(${left.toFixed(1)}px, ${(y - 8).toFixed(1)}px)`;
    }
  }

  /** Directions of x, y and z on the screen: three pairs, and how near each points. */
  axes() {
    const turn = this.camera.quaternion.clone().invert();
    return [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((each) => new Vector3(...each).applyQuaternion(turn).toArray());
  }

  /** The picture with its names and a line of text, as a PNG Blob. */
  snapshot(text) {
    this.resolution(this.sharp);
    this.render();
    const made = document.createElement("canvas"), size = this.sharp;
    made.width = this.canvas.width;
    made.height = this.canvas.height;
    const on = made.getContext("2d");
    on.drawImage(this.canvas, 0, 0);
    on.scale(size, size);
    on.font = "13px system-ui, sans-serif";
    on.fillStyle = css(rgb(this.theme.ink), 0.85);
    for (const label of this.labels) {
      if (label.style.visibility !== "visible") continue;
      const [x, y] = label.style.transform.match(/-?[\d.]+/g).map(Number);
      on.fillText(label.textContent, x, y + 13);
    }
    on.fillText(text, 14, this.height - 14);
    this.touch();
    return new Promise((done) => made.toBlob(done, "image/png"));
  }

  dispose() {
    this.controls.dispose();
    this.spheres.dispose();
    for (const lines of this.lines) lines.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }
}
