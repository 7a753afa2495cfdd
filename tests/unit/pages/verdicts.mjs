// Prints energy errors of all runs of a module at equal times, and the page's verdicts: node verdicts.mjs RUNTIME VERDICT MODULE
import { readFileSync } from "fs";
import { pathToFileURL } from "url";

const [runtime, judge, module] = process.argv.slice(2);
const [{ load }, { verdict }] = await Promise.all([runtime, judge].map((each) => import(pathToFileURL(each))));
const runs = await load(JSON.parse(readFileSync(module)));
const found = [];
for (const [name, run] of Object.entries(runs)) {
  for (const [dt, every, samples] of [[0.05, 2, 600], [0.02, 31, 1000], [0.2, 3, 500]]) {
    run.reset(run.start, dt);
    const first = run.energy, errors = [0];
    while (errors.length <= samples && run.advance(every) === 0) errors.push((run.energy - first) / Math.abs(first));
    if (!run.status) found.push({ name, dt, steps: run.done, errors, verdict: verdict(errors, run.done) });
  }
}
console.log(JSON.stringify(found));
