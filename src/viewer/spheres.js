// Shaded spheres. Each is a square that faces the camera, and the shader makes a sphere of it. Squares are sorted from
// front to back, so that hidden parts cost nothing: software rendering keeps its pace.

import {Color, GLSL3, Mesh, RawShaderMaterial} from "three";
import {Squares} from "./squares.js";

const VERTEX = `
precision highp float;
in vec2 position;
in vec3 centre;
in vec2 size;
in vec4 look;
uniform mat4 modelViewMatrix;
uniform mat4 projectionMatrix;
uniform float factor;
uniform float perPixel;
uniform vec2 fog;
out vec2 at;
out vec4 colour;
out float mist;
void main() {
  vec4 eye = modelViewMatrix * vec4(centre, 1.0);
  float radius = max(size.x * factor, size.y * sqrt(factor) * perPixel * -eye.z);
  mist = clamp((-eye.z - fog.x) / (fog.y - fog.x), 0.0, 1.0);
  at = position;
  colour = look;
  eye.xy += radius * position;
  gl_Position = projectionMatrix * eye;
}`;

const FRAGMENT = `
precision mediump float;
in vec2 at;
in vec4 colour;
in float mist;
uniform vec3 background;
out vec4 pixel;
void main() {
  float far = dot(at, at);
  if (far > 1.0) discard;
  vec3 n = vec3(at, sqrt(1.0 - far));
  float key = max(dot(n, vec3(-0.42, 0.60, 0.68)), 0.0);
  float half_ = max(dot(n, vec3(-0.23, 0.33, 0.915)), 0.0);
  float half2 = half_ * half_, half8 = half2 * half2 * half2 * half2;
  float shine = half8 * half8 * half8;
  vec3 lit = colour.rgb * (0.44 + 0.10 * n.y + 0.60 * key) * (0.66 + 0.34 * smoothstep(0.0, 0.42, n.z)) + 0.18 * shine;
  vec3 own = mix(colour.rgb, vec3(1.0), 0.55 * n.z * n.z);
  pixel = vec4(mix(mix(lit, own, colour.a), background, 0.62 * mist * (1.0 - colour.a)), 1.0);
}`;

const BUCKETS = 8192;

/** Spheres of n particles: `places` (3 n) and `look` (4 n bytes) are written by the user, then `sorted` draws them. */
export class Spheres {
  constructor(radii, pixels) {
    const n = radii.length;
    this.count = n;
    this.places = new Float32Array(3 * n);
    this.look = new Uint8Array(4 * n);
    this.radii = radii;
    this.pixels = pixels;
    this.keys = new Uint16Array(n);
    this.heads = new Uint32Array(BUCKETS + 1);
    this.squares = new Squares(n, [-1, -1, 1, -1, 1, 1, -1, 1],
      {centre: [Float32Array, 3], size: [Float32Array, 2], look: [Uint8Array, 4]});
    this.geometry = this.squares.geometry;
    this.material = new RawShaderMaterial({vertexShader: VERTEX, fragmentShader: FRAGMENT, glslVersion: GLSL3, uniforms: {
      factor: {value: 1}, perPixel: {value: 0.001}, fog: {value: [0, 1]}, background: {value: new Color(0, 0, 0)}}});
    this.mesh = new Mesh(this.geometry, this.material);
    this.mesh.frustumCulled = false;
  }

  /** Sorts the spheres along the direction (x, y, z) of the view, nearest first, and hands them to the graphics. */
  sorted(x, y, z) {
    const {places: p, keys, heads, count: n} = this;
    let low = Infinity, high = -Infinity, there = 0;
    for (let i = 0; i < n; i++) {
      const depth = p[3 * i] * x + p[3 * i + 1] * y + p[3 * i + 2] * z;
      if (depth < low) low = depth;
      if (depth > high) high = depth;
    }
    const scale = high > low ? (BUCKETS - 1) / (high - low) : 0;
    heads.fill(0);
    for (let i = 0; i < n; i++) {
      const depth = p[3 * i] * x + p[3 * i + 1] * y + p[3 * i + 2] * z;
      if (Number.isNaN(depth)) { keys[i] = 65535; continue; }
      keys[i] = (depth - low) * scale;
      heads[keys[i] + 1]++;
      there++;
    }
    for (let k = 0; k < BUCKETS; k++) heads[k + 1] += heads[k];
    const {squares} = this, c = squares.array("centre"), s = squares.array("size");
    const l = new Uint32Array(squares.array("look").buffer), look = new Uint32Array(this.look.buffer);
    for (let i = 0; i < n; i++) {
      if (keys[i] === 65535) continue;
      const first = 4 * heads[keys[i]]++;
      for (let to = first; to < first + 4; to++) {
        c[3 * to] = p[3 * i];
        c[3 * to + 1] = p[3 * i + 1];
        c[3 * to + 2] = p[3 * i + 2];
        s[2 * to] = this.radii[i];
        s[2 * to + 1] = this.pixels[i];
        l[to] = look[i];
      }
    }
    squares.drawn(there);
  }

  dispose() {
    this.geometry.dispose();
    this.material.dispose();
  }
}
