// Arrays from text: the inverse of kickdrift/view/packing.py.

const TYPES = {u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, f4: Float32Array, f8: Float64Array};

function bytesOf(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const raw = atob(text);
  const found = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) found[i] = raw.charCodeAt(i);
  return found;
}

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The typed array of a packed description; its property `shape` is the array's shape. */
export async function unpacked({type, shape, delta, data}) {
  const planes = await inflated(bytesOf(data));
  const wide = TYPES[type].BYTES_PER_ELEMENT;
  const count = planes.length / wide;
  const bytes = new Uint8Array(planes.length);
  for (let b = 0; b < wide; b++) {
    const plane = planes.subarray(b * count, (b + 1) * count);
    for (let i = 0; i < count; i++) bytes[i * wide + b] = plane[i];
  }
  const found = new TYPES[type](bytes.buffer);
  if (delta) {
    const row = count / (shape[0] || 1);
    for (let i = 0; i < count; i++) {
      const change = (found[i] >>> 1) ^ -(found[i] & 1); // zigzag: small changes of either sign are small numbers
      found[i] = change + (i >= row ? found[i - row] : 0); // the array's type wraps the sum around
    }
  }
  found.shape = shape;
  return found;
}
