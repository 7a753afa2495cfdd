// The verdict about an energy error, in the words of the report of `kickdrift run`; see statistics/drift.py, of which this is a part.

const ROUNDINGS = 100, WALKED = 0.1, LEAST_SAMPLES = 40, UNRELIABLE = 0.1;
const BLOCKS = 16, ONE_WAY = 0.95, LEAST_WAY = 0.6, SPREAD = 2.2, STUDENT = 2.977; // STUDENT: of 14 degrees of freedom at 1 %

/** Means of the series in blocks. */
function blocks(values) {
  const n = Math.floor(values.length / BLOCKS), first = values.length - n * BLOCKS;
  return Array.from({ length: BLOCKS }, (_, k) => {
    let sum = 0;
    for (let i = first + k * n; i < first + (k + 1) * n; i++) sum += values[i];
    return sum / n;
  });
}

/** Whether the means of the blocks only rise, or only fall, but for small steps back. */
function oneWay(means, range) {
  const steps = means.slice(1).map((each, k) => each - means[k]), sum = (list) => list.reduce((a, b) => a + b, 0);
  const total = Math.abs(sum(steps)), length = sum(steps.map(Math.abs));
  return length > 0 && total >= Math.max(ONE_WAY * length, LEAST_WAY * range) && length ** 2 / sum(steps.map((each) => each * each)) >= SPREAD;
}

/** Verdict about relative errors of the energy at equal times: "bounded", "secular drift", "round-off", "not resolvable" or "unreliable". */
export function verdict(errors, steps) {
  const n = errors.length, rounding = Number.EPSILON * Math.max(1, WALKED * Math.sqrt(steps));
  let low = Infinity, high = -Infinity;
  for (const each of errors) [low, high] = [Math.min(low, each), Math.max(high, each)];
  if (Math.max(high, -low) > UNRELIABLE) return "unreliable";
  if (high - low <= ROUNDINGS * rounding) return high === low ? "bounded" : "round-off";
  if (n < LEAST_SAMPLES) return "not resolvable";
  const means = blocks(errors), middle = (BLOCKS - 1) / 2, mean = means.reduce((a, b) => a + b, 0) / BLOCKS;
  if (oneWay(means, high - low)) return "secular drift";
  let top = 0, bottom = 0, rest = 0;
  means.forEach((each, k) => { top += (k - middle) * (each - mean); bottom += (k - middle) ** 2; });
  const slope = top / bottom;
  means.forEach((each, k) => { rest += (each - mean - slope * (k - middle)) ** 2; });
  const sure = Math.abs(slope) > STUDENT * Math.sqrt(rest / (BLOCKS - 2) / bottom);
  return sure && Math.abs(slope) * BLOCKS > ROUNDINGS * rounding ? "secular drift" : "bounded";
}
