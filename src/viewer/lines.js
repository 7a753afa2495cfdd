// Lines of a width in pixels: each piece is a rectangle that the shader turns towards the screen.

import {BufferAttribute, DynamicDrawUsage, GLSL3, InstancedBufferAttribute, InstancedBufferGeometry, Mesh,
  RawShaderMaterial} from "three";

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
  end.xy += (vec2(-along.y, along.x) * position.y + along * (position.x - 0.5)) * width / screen * end.w;
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
    this.geometry = new InstancedBufferGeometry();
    this.geometry.setAttribute("position", new BufferAttribute(new Float32Array([0, -1, 1, -1, 1, 1, 0, 1]), 2));
    this.geometry.setIndex([0, 1, 2, 0, 2, 3]);
    const buffer = (name, array, wide, whole) => {
      const made = new InstancedBufferAttribute(array, wide, whole);
      made.setUsage(DynamicDrawUsage);
      this.geometry.setAttribute(name, made);
      return made;
    };
    this.from = buffer("from", new Float32Array(3 * most), 3, false);
    this.to = buffer("to", new Float32Array(3 * most), 3, false);
    this.first = buffer("first", new Uint8Array(4 * most), 4, true);
    this.last = buffer("last", new Uint8Array(4 * most), 4, true);
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
    const k = this.used++;
    this.from.array.set(a, 3 * k);
    this.to.array.set(b, 3 * k);
    this.first.array.set([red, green, blue, 255 * begin], 4 * k);
    this.last.array.set([red, green, blue, 255 * end], 4 * k);
  }

  done() {
    this.geometry.instanceCount = this.used;
    for (const each of [this.from, this.to, this.first, this.last]) each.needsUpdate = true;
  }

  dispose() {
    this.geometry.dispose();
    this.material.dispose();
  }
}
