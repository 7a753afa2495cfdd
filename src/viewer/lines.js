// Lines of a width in pixels: each piece is a rectangle that the shader turns towards the screen.

import {GLSL3, Mesh, RawShaderMaterial} from "three";
import {Squares} from "./squares.js";

const VERTEX = `
precision highp float;
in vec2 position;
in vec3 from;
in vec3 to;
in vec4 first;
in vec4 last;
uniform mat4 modelViewMatrix;
uniform mat4 projectionMatrix;
uniform vec2 screen;
uniform float width;
uniform float near;
out vec4 colour;
void main() {
  vec4 a = modelViewMatrix * vec4(from, 1.0);
  vec4 b = modelViewMatrix * vec4(to, 1.0);
  if (a.z > -near && b.z < -near) a = mix(a, b, (a.z + near) / (a.z - b.z));
  if (b.z > -near && a.z < -near) b = mix(b, a, (b.z + near) / (b.z - a.z));
  a = projectionMatrix * a;
  b = projectionMatrix * b;
  vec2 along = (b.xy / b.w - a.xy / a.w) * screen;
  along = length(along) > 0.0 ? normalize(along) : vec2(1.0, 0.0);
  vec4 end = position.x < 0.5 ? a : b;
  end.xy += vec2(-along.y, along.x) * position.y * width / screen * end.w;
  colour = position.x < 0.5 ? first : last;
  gl_Position = end;
}`;

const FRAGMENT = `
precision mediump float;
in vec4 colour;
out vec4 pixel;
void main() { pixel = colour; }`;

/** Pieces of lines, at most `most`; `clear`, then `piece` for each, then `done`. */
export class Lines {
  constructor(most, width) {
    this.most = most;
    this.squares = new Squares(most, [0, -1, 1, -1, 1, 1, 0, 1],
      {from: [Float32Array, 3], to: [Float32Array, 3], first: [Uint8Array, 4], last: [Uint8Array, 4]});
    this.geometry = this.squares.geometry;
    this.material = new RawShaderMaterial({vertexShader: VERTEX, fragmentShader: FRAGMENT, glslVersion: GLSL3,
      transparent: true, depthWrite: false,
      uniforms: {screen: {value: [1, 1]}, width: {value: width}, near: {value: 0.01}}});
    this.mesh = new Mesh(this.geometry, this.material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 1;
    this.clear();
  }

  clear() { this.used = 0; }

  /** A piece from a to b (three numbers each) in a colour [r, g, b], with opacities from 0 to 1 at its ends. */
  piece(a, b, [red, green, blue], begin, end) {
    if (this.used === this.most) return;
    const first = 4 * this.used++, {squares} = this;
    for (let k = first; k < first + 4; k++) {
      squares.array("from").set(a, 3 * k);
      squares.array("to").set(b, 3 * k);
      squares.array("first").set([red, green, blue, 255 * begin], 4 * k);
      squares.array("last").set([red, green, blue, 255 * end], 4 * k);
    }
  }

  done() { this.squares.drawn(this.used); }

  dispose() {
    this.geometry.dispose();
    this.material.dispose();
  }
}
