// Prints the last state of a run of a module, and its energies: node runs.mjs RUNTIME MODULE NAME DT STEPS EVERY START
import { readFileSync } from "fs";
import { pathToFileURL } from "url";

const [runtime, module, name, dt, steps, every, start] = process.argv.slice(2);
const { load } = await import(pathToFileURL(runtime));
const run = (await load(JSON.parse(readFileSync(module))))[name];
run.reset(JSON.parse(start), Number(dt));
const energies = [run.energy];
while (run.done < steps && !run.advance(Math.min(every, steps - run.done))) energies.push(run.energy);
console.log(JSON.stringify({ y: Array.from(run.y), energies }));
