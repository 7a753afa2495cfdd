// Prints the mean rate at which a tangent vector of a run grows over 10,000 units of time: node growth.mjs RUNTIME MODULE RUN
import { readFileSync } from "fs";
import { pathToFileURL } from "url";

const [runtime, module, name] = process.argv.slice(2);
const { load, growth } = await import(pathToFileURL(runtime));
const run = (await load(JSON.parse(readFileSync(module))))[name];
const [end, log] = growth(run, run.start, 0.01, 1000000, 50).at(-1);
console.log(log / end);
