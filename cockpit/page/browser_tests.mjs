// Runs the tests in a browser: `node browser_tests.mjs BUILD [--pictures FOLDER]`. They start the program themselves, and
// use the page as a person does. Pictures of the page, drawn finely for the docs, go to FOLDER if there is one.
import { spawnSync } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const skip = (why) => {
  console.log(`skipped: ${why}`);
  process.exit(77);
};
const [folder, ...rest] = process.argv.slice(2);
const at = rest.indexOf("--pictures");
const pictures = at >= 0 ? resolve(rest[at + 1]) : "";
const only = rest.filter((_, k) => at < 0 || (k !== at && k !== at + 1));
const browsers = ["/usr/bin/chromium-headless-shell", "/usr/bin/chromium", process.env.MULTIPANDA_CHROMIUM];
const browser = browsers.find((path) => path && existsSync(path));
if (!browser) skip("no chromium: apt-get install chromium-headless-shell, or name one in MULTIPANDA_CHROMIUM");
const program = resolve(folder, "multipanda");
if (!existsSync(program)) skip(`${program} is not built`);

const help = spawnSync(program, ["run", "--help"], { encoding: "utf8" });
if (!help.stdout.includes("--cockpit")) skip(`${program} has no cockpit`);

process.chdir(dirname(fileURLToPath(import.meta.url)));
if (pictures) mkdirSync(pictures, { recursive: true });
// Inside of this folder, so that the tests find the packages.
const out = mkdtempSync(join("node_modules", ".browser-"));
try {
  const tests = readdirSync("browser").filter((name) => name.endsWith(".test.ts"));
  const chosen = tests.filter((name) => only.length === 0 || only.some((word) => name.includes(word)));
  if (chosen.length === 0) throw new Error("no test found in cockpit/page/browser");
  // All of them in one process: they share a browser, and one run at a time keeps two cores free.
  const entry = join(out, "all.ts");
  writeFileSync(entry, chosen.map((name) => `import "../../browser/${name}";\n`).join(""));
  await build({
    absWorkingDir: process.cwd(), // esbuild remembers the folder that it was loaded in
    entryPoints: [entry],
    outfile: join(out, "all.mjs"),
    bundle: true,
    platform: "node",
    format: "esm",
    packages: "external",
    sourcemap: "inline",
    logLevel: "warning",
  });
  const env = { ...process.env, COCKPIT_BROWSER: browser, COCKPIT_PROGRAM: program, COCKPIT_PICTURES: pictures };
  const run = spawnSync(
    process.execPath,
    ["--enable-source-maps", "--test-reporter=spec", "--test", join(out, "all.mjs")],
    { stdio: "inherit", env },
  );
  process.exitCode = run.status ?? 1;
} finally {
  rmSync(out, { recursive: true, force: true });
}
