// Runs the tests of the pure parts with Node's own runner: bundles them first, since Node reads no TypeScript.
import { spawnSync } from "node:child_process";
import { mkdtempSync, readdirSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { build } from "esbuild";

process.chdir(import.meta.dirname ?? new URL(".", import.meta.url).pathname);
const out = mkdtempSync(join(tmpdir(), "cockpit-unit-"));
try {
  const tests = readdirSync("test").filter((name) => name.endsWith(".test.ts"));
  if (tests.length === 0) throw new Error("no test found in cockpit/page/test");
  await build({
    absWorkingDir: process.cwd(), // esbuild remembers the folder that it was loaded in
    entryPoints: tests.map((name) => join("test", name)),
    outdir: out,
    outExtension: { ".js": ".mjs" },
    bundle: true,
    platform: "node",
    format: "esm",
    sourcemap: "inline",
    logLevel: "warning",
  });
  const files = tests.map((name) => join(out, name.replace(/\.ts$/, ".mjs")));
  const run = spawnSync(process.execPath, ["--enable-source-maps", "--test", ...files], { stdio: "inherit" });
  process.exitCode = run.status ?? 1;
} finally {
  rmSync(out, { recursive: true, force: true });
}
