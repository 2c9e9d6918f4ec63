// Bundles the page: `node build.mjs --out FOLDER`. Everything that the browser loads is in that folder afterwards.
import { copyFileSync, mkdirSync, readdirSync, rmSync, statSync, writeFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const kMostBytes = 1_000_000;
const at = process.argv.indexOf("--out");
if (at < 0 || !process.argv[at + 1]) {
  console.error("usage: node build.mjs --out FOLDER");
  process.exit(2);
}
const out = resolve(process.argv[at + 1]);
process.chdir(dirname(fileURLToPath(import.meta.url)));
rmSync(out, { recursive: true, force: true });
mkdirSync(out, { recursive: true });
// esbuild remembers the folder that it was loaded in, so it is told where it is.
const script = await build({
  absWorkingDir: process.cwd(),
  entryPoints: { cockpit: "src/main.ts" },
  outdir: out,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  legalComments: "eof",
  logLevel: "warning",
  metafile: true,
});
const style = await build({
  absWorkingDir: process.cwd(),
  entryPoints: { cockpit: "style/cockpit.css" },
  outdir: out,
  bundle: true,
  minify: true,
  logLevel: "warning",
  metafile: true,
});
// What is bundled, for the notices in packages (packaging/notices.py).
const inputs = [script, style].flatMap((made) => Object.keys(made.metafile.inputs));
const packages = inputs.flatMap((file) => file.match(/node_modules\/((?:@[^/]+\/)?[^/]+)/)?.[1] ?? []);
writeFileSync(`${out}.packages`, [...new Set(packages)].sort().join("\n") + "\n");
for (const name of ["index.html", "icon.svg"]) copyFileSync(name, join(out, name));
const bytes = readdirSync(out).reduce((sum, name) => sum + statSync(join(out, name)).size, 0);
console.log(`${out}: ${Math.round(bytes / 1000)} kB`);
if (bytes > kMostBytes) {
  console.error(`the page has ${bytes} bytes; at most ${kMostBytes} are allowed`);
  process.exit(1);
}
