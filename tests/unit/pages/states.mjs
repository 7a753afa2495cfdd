// Prints the states of all runs of a module after some steps, as JSON: node states.mjs RUNTIME MODULE STEPS
import { readFileSync } from "fs";
import { pathToFileURL } from "url";

const [runtime, module, steps] = process.argv.slice(2);
const { load } = await import(pathToFileURL(runtime));
const runs = await load(JSON.parse(readFileSync(module)));
const found = {};
for (const [name, run] of Object.entries(runs)) {
  run.reset();
  found[name] = { status: run.advance(Number(steps)), y: Array.from(run.y), energy: run.energy, evaluations: run.evaluations };
}
console.log(JSON.stringify(found));
