// Writes codemirror.iife.min.js and the licences of all that it holds into a folder; the same bytes each time.
//
//     npm ci && node build_editor.mjs ../../../slipctl/workbench/web/page

import { readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { join } from "node:path";
import { build } from "esbuild";

const here = fileURLToPath(new URL(".", import.meta.url));
const folder = process.argv[2] ?? here;

const made = await build({
  absWorkingDir: here, entryPoints: ["editor_parts.js"], bundle: true, minify: true, format: "iife",
  globalName: "CodeMirror", target: "es2022", legalComments: "none", metafile: true, write: false,
});
const packages = new Set(Object.keys(made.metafile.inputs)
  .map((file) => file.match(/node_modules\/((?:@[^/]+\/)?[^/]+)\//)?.[1])
  .filter((name) => name !== undefined));
const licences = [...packages].sort().map((name) => {
  const { version, license } = JSON.parse(readFileSync(join(here, "node_modules", name, "package.json"), "utf-8"));
  const text = readFileSync(join(here, "node_modules", name, "LICENSE"), "utf-8");
  return `${name} ${version}, ${license}\n\n${text.trim()}\n`;
});
writeFileSync(join(folder, "codemirror.iife.min.js"), made.outputFiles[0].text);
writeFileSync(join(folder, "codemirror.LICENSE.txt"), licences.join("\n\n"));
