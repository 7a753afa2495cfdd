// Squares, four corners each, in one geometry. No instances: software rendering draws each instance on its own, slowly.

import {BufferAttribute, BufferGeometry, DynamicDrawUsage, Sphere, Vector3} from "three";

/** Geometry of at most `most` squares with these four corners, and numbers of each square: {name: [type, width]}. */
export class Squares {
  constructor(most, corners, fields) {
    this.geometry = new BufferGeometry();
    const position = new Float32Array(8 * most), index = new Uint32Array(6 * most);
    for (let k = 0; k < most; k++) {
      position.set(corners, 8 * k);
      for (let c = 0; c < 6; c++) index[6 * k + c] = 4 * k + [0, 1, 2, 0, 2, 3][c];
    }
    this.geometry.setAttribute("position", new BufferAttribute(position, 2));
    this.geometry.setIndex(new BufferAttribute(index, 1));
    this.geometry.boundingSphere = new Sphere(new Vector3(), 1); // never used: frustumCulled is off
    this.fields = {};
    for (const [name, [Type, width]] of Object.entries(fields)) {
      const made = new BufferAttribute(new Type(4 * width * most), width, Type === Uint8Array);
      made.setUsage(DynamicDrawUsage);
      this.geometry.setAttribute(name, made);
      this.fields[name] = made;
    }
  }

  /** The array of a field: the numbers of square k begin at 4 k times the width, once for each corner. */
  array(name) { return this.fields[name].array; }

  /** Draws the first `count` squares. */
  drawn(count) {
    this.geometry.setDrawRange(0, 6 * count);
    for (const field of Object.values(this.fields)) {
      field.clearUpdateRanges();
      field.addUpdateRange(0, 4 * field.itemSize * count);
      if (count) field.needsUpdate = true;
    }
  }
}
