// Palettes and colour maps. Colours are [red, green, blue] from 0 to 255.

// Colours that differ for colour-blind readers too, after Okabe & Ito and Paul Tol, lightened for shading.
const CLASSES = ["#4c9be8", "#f0803c", "#2fb888", "#d67ab8", "#e9bd45", "#8b83e6", "#5cc6dd", "#cf5a5a", "#9bbf4a", "#b08968",
  "#8896a8", "#e59bd0"];
const CENTRAL = "#ffc845";
// matplotlib's viridis at even steps, without its darkest part, which is hard to see on a dark ground.
const VIRIDIS = ["#472f7d", "#414487", "#39568c", "#31688e", "#2a788e", "#23888e", "#1f988b", "#22a884",
  "#35b779", "#54c568", "#7ad151", "#a5db36", "#d2e21b", "#fde725"];

export const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));
export const css = ([r, g, b], a = 1) => `rgba(${r | 0}, ${g | 0}, ${b | 0}, ${a})`;

const TABLE = new Uint8Array(256 * 3);
for (let i = 0; i < 256; i++) {
  const at = (i / 255) * (VIRIDIS.length - 1), k = Math.min(VIRIDIS.length - 2, at | 0);
  const [from, to] = [rgb(VIRIDIS[k]), rgb(VIRIDIS[k + 1])];
  for (let c = 0; c < 3; c++) TABLE[3 * i + c] = from[c] + (to[c] - from[c]) * (at - k);
}

/** The gradient of the colour map, for a legend. */
export const GRADIENT = `linear-gradient(to right, ${VIRIDIS.join(", ")})`;

/** Colour of class k; the central body has its own. */
export function classColour(k, central = null) {
  if (k === central) return rgb(CENTRAL);
  return rgb(CLASSES[(central !== null && k > central ? k - 1 : k) % CLASSES.length]);
}

/** Writes the colours of parts from 0 to 1 into `out`, four bytes each, of which the last stays. */
export function mapped(parts, out) {
  for (let i = 0; i < parts.length; i++) {
    const k = 3 * Math.max(0, Math.min(255, Math.round(parts[i] * 255)));
    out[4 * i] = TABLE[k];
    out[4 * i + 1] = TABLE[k + 1];
    out[4 * i + 2] = TABLE[k + 2];
  }
}
