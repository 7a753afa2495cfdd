// Writes the bundle and the licence of three.js into the package.

import {copyFile, readFile, stat} from "node:fs/promises";
import {build} from "esbuild";

const assets = new URL("../kickdrift/view/assets/", import.meta.url);
const {version} = JSON.parse(await readFile(new URL("node_modules/three/package.json", import.meta.url)));
const source = await readFile(new URL("viewer.js", import.meta.url), "utf8");
const head = source.split("\n").filter((line) => line.startsWith("//")).join("\n");
const outfile = new URL("viewer.js", assets).pathname;
await build({
  entryPoints: [new URL("viewer.js", import.meta.url).pathname],
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  charset: "ascii",
  legalComments: "none",
  banner: {js: `${head}\n//\n// Built from src/viewer of kickdrift. Contains parts of three.js ${version}: MIT, see LICENSE-three.txt beside this file.`},
  outfile,
});
await copyFile(new URL("node_modules/three/LICENSE", import.meta.url), new URL("LICENSE-three.txt", assets));
console.log(outfile, (await stat(outfile)).size);
