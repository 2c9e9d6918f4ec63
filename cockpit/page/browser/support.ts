// What the tests in a browser share: a run of the program, a browser, and pages that use it.
import assert from "node:assert/strict";
import { spawn, type ChildProcess } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, type TestContext } from "node:test";
import { chromium, type Browser, type BrowserContext, type Locator, type Page } from "playwright-core";
import type { LiveState } from "../src/model/live.ts";

const program = process.env["COCKPIT_PROGRAM"]!;
/** The folder of pictures for the docs; empty: none are made. */
export const pictures = process.env["COCKPIT_PICTURES"]!;
/** Arms that every function of the page is tested on. */
export const kBackends = ["mujoco", "virtual"] as const;
/** Generous: a loaded computer may be slow, and no test is about that. */
export const kPatience = 15_000;

/** A folder that is removed afterwards. */
export function temporaryFolder(): string {
  const folder = mkdtempSync(join(tmpdir(), "cockpit-"));
  after(() => rmSync(folder, { recursive: true, force: true }));
  return folder;
}

/** A run of the program with a cockpit. It ends in hold when the test ends, however that is. */
export class Run {
  url = "";
  private output = "";

  private constructor(readonly child: ChildProcess) {}

  /** `run` is told to show the page; the command `cockpit` does anyway. */
  static async start(...args: string[]): Promise<Run> {
    const port = args[0] === "cockpit" ? ["--port", "0"] : ["--cockpit", "0"];
    const child = spawn(program, [...args, ...port], { stdio: ["pipe", "pipe", "pipe"] });
    const run = new Run(child);
    await new Promise<void>((resolve, reject) => {
      const timer = setTimeout(() => reject(new Error(`no address within 60 s: ${run.output}`)), 60_000);
      const take = (chunk: Buffer) => {
        run.output += chunk.toString();
        const found = /^(http:\/\/127\.0\.0\.1:\d+\/#\S+)$/m.exec(run.output);
        if (!found || run.url) return;
        run.url = found[1]!;
        clearTimeout(timer);
        resolve();
      };
      child.stdout!.on("data", take);
      child.stderr!.on("data", take);
      child.on("exit", (code) => reject(new Error(`the program ended with ${code}: ${run.output}`)));
    });
    return run;
  }

  /** An idle scene that waits for commands. */
  static idle(scene: string, ...args: string[]): Promise<Run> {
    return Run.start("run", scene, "--no-timeline", "--until-input-ends", ...args);
  }

  async closePages(): Promise<void> {
    for (const context of contexts.get(this.url) ?? []) await context.close();
    contexts.delete(this.url);
  }

  async end(): Promise<number | null> {
    await this.closePages();
    if (this.child.exitCode !== null) return this.child.exitCode;
    const ended = new Promise<number | null>((resolve) => this.child.once("exit", (code) => resolve(code)));
    this.child.stdin!.end();
    const timer = setTimeout(() => this.child.kill("SIGTERM"), 5000);
    const code = await ended;
    clearTimeout(timer);
    return code;
  }
}

let browser: Browser | undefined;
/** Of the pages of a run: what a test that failed has left open would slow down the next ones. */
const contexts = new Map<string, BrowserContext[]>();
after(() => browser?.close());

export interface PageOptions {
  theme?: "dark" | "light";
  width?: number;
  height?: number;
  touch?: boolean;
  /** Drawn as finely as for a person: slow without a graphics card, so only where pictures are looked at. */
  sharp?: boolean;
  /** Run in the page before its own scripts. */
  before?: string | (() => void);
}

export interface Cockpit {
  page: Page;
  context: BrowserContext;
  /** What the page complained about. */
  complaints: string[];
}

/** A new page on a run, as of another person: nothing is shared with other pages. */
export async function open(url: string, options: PageOptions = {}): Promise<Cockpit> {
  browser ??= await chromium.launch({
    executablePath: process.env["COCKPIT_BROWSER"]!,
    args: ["--enable-unsafe-swiftshader", "--no-sandbox"],
  });
  const context = await browser.newContext({
    viewport: { width: options.width ?? 1280, height: options.height ?? 800 },
    colorScheme: options.theme ?? "dark",
    deviceScaleFactor: options.sharp || pictures ? 1 : 0.5,
    hasTouch: options.touch ?? false,
  });
  contexts.set(url, [...(contexts.get(url) ?? []), context]);
  const page = await context.newPage();
  page.setDefaultTimeout(kPatience);
  const complaints: string[] = [];
  page.on("pageerror", (error) => complaints.push(error.message));
  page.on("console", (message) => {
    if (message.type() === "error") complaints.push(message.text());
  });
  page.on("request", (request) => {
    // Nothing but the run itself is asked for anything.
    const { protocol, host } = new URL(request.url());
    if (["http:", "https:", "ws:"].includes(protocol) && host !== new URL(url).host) complaints.push(request.url());
  });
  if (options.before) await page.addInitScript(options.before);
  await page.goto(url);
  await until(page, () => window.cockpit.session.state !== undefined);
  return { page, context, complaints };
}

export async function until<T>(page: Page, condition: (argument: T) => boolean, argument?: T): Promise<void> {
  try {
    await page.waitForFunction(condition as never, argument as never, { timeout: kPatience, polling: 20 });
  } catch (error) {
    throw new Error(`${(error as Error).message}\n${await saidBy(page)}`);
  }
}

/** What a page shows of the run, for a test that timed out: its messages, and the owner of each arm. */
export async function saidBy(page: Page): Promise<string> {
  const messages = await page.locator(".toast p").allTextContents();
  const arms = await page.locator(".arm-card").allTextContents();
  return [...messages, ...arms.map((card) => card.slice(0, 200))].join("\n");
}

export async function stateOf(page: Page): Promise<LiveState> {
  return page.evaluate(() => {
    const { state } = window.cockpit.session;
    // Typed arrays would arrive as objects.
    return JSON.parse(
      JSON.stringify(state, (_, value) => (ArrayBuffer.isView(value) ? [...(value as Float64Array)] : value)),
    );
  }) as Promise<LiveState>;
}

export async function takeControl(page: Page): Promise<void> {
  await page.getByRole("button", { name: "Take control" }).click();
  await until(page, () => window.cockpit.session.control.mine);
}

/** Presses a button with the mouse, waits for something, and lets go; `let_go` false leaves it pressed. */
export async function hold(page: Page, button: Locator, meanwhile: () => Promise<void>, letGo = true): Promise<void> {
  await button.hover({ force: true }); // also one that is being built again
  await page.mouse.down();
  try {
    await meanwhile();
  } finally {
    if (letGo) await page.mouse.up();
  }
}

/** Moves the pressed mouse as a hand does: in many small ways, over some pictures. */
export async function drag(page: Page, from: readonly [number, number], to: readonly [number, number]): Promise<void> {
  const kSteps = 8;
  for (let k = 1; k <= kSteps; ++k) {
    await page.mouse.move(...([0, 1].map((i) => from[i]! + (k / kSteps) * (to[i]! - from[i]!)) as [number, number]));
    await page.waitForTimeout(25);
  }
}

/**
 * Why this computer cannot hold a motion, if so: a hold ends when the page shows states later than 100 ms, so a computer
 * without a graphics card that draws a moving arm slower than that moves nothing. Measured on a page that draws all the
 * time; `6_pace` tells a slow page from a slow computer.
 */
export async function tooSlowToHold(page: Page): Promise<string | undefined> {
  const kLate = 90; // [ms]
  const late = await page.evaluate(async (late) => {
    const { stage } = window.cockpit;
    const gaps: number[] = [];
    await new Promise<void>((done) => {
      const begun = performance.now();
      let last = begun;
      const frame = (now: number) => {
        gaps.push(now - last);
        last = now;
        stage.touch();
        if (now - begun < 1000) requestAnimationFrame(frame);
        else done();
      };
      requestAnimationFrame(frame);
    });
    return gaps.filter((gap) => gap > late).length / gaps.length;
  }, kLate);
  return late > 0.1 ? `${(100 * late).toFixed(0)} % of the pictures came later than ${kLate} ms` : undefined;
}

/** A part of a test that holds motions; skipped where the computer cannot hold one, with the figure. */
export async function holding(t: TestContext, page: Page, name: string, act: () => Promise<void>): Promise<void> {
  await t.test(name, async (t) => {
    const why = page.isClosed() ? undefined : await tooSlowToHold(page);
    if (why === undefined) await unlessTooSlow(t, page, act);
    else skip(t, why);
  });
}

/** Skips a test that failed because the computer is too slow to hold a motion. */
export async function unlessTooSlow(t: TestContext, page: Page, act: () => Promise<void>): Promise<void> {
  try {
    await act();
  } catch (error) {
    const why = error instanceof Late && !page.isClosed() ? await tooSlowToHold(page) : undefined;
    if (why === undefined) throw error;
    skip(t, why);
  }
}

function skip(t: TestContext, why: string): void {
  console.log(`skipped: ${t.name}: this computer draws too slowly to hold a motion: ${why}`);
  t.skip(why);
}

/** The computer was too busy to read the button in time: the page or the run has let go, as they should. */
export class Late extends Error {}

/** Repeats what depends on real time as long as the computer comes too late; `owners` lead arms before every attempt. */
export async function patiently(
  page: Page,
  owners: string | readonly string[] | undefined,
  act: () => Promise<void>,
): Promise<void> {
  for (let tries = 1; ; ++tries) {
    for (const owner of [owners ?? []].flat()) await activateAtOnce(page, owner);
    await page.evaluate(() =>
      document.querySelectorAll<HTMLElement>(".toast button").forEach((close) => close.click()),
    );
    try {
      await act();
      return;
    } catch (error) {
      if (!(error instanceof Late) || tries === 8) throw error;
      console.log(`again: ${error.message}`);
    }
  }
}

export async function ownerOf(page: Page, arm = 0): Promise<string> {
  return page.evaluate((arm) => window.cockpit.session.state!.arms[arm]!.controllet, arm);
}

/** Waits for what a request does; the run refuses requests of a page that draws too late, and may stop an arm. */
export async function carriedOut(
  page: Page,
  done: () => Promise<boolean>,
  owner?: string,
  held = false,
): Promise<void> {
  const begun = Date.now();
  const late = page.getByText(/repeat it once the page shows new states/);
  while (!(await done())) {
    if ((await late.count()) > 0) throw new Late("the page had not seen a new state for too long");
    if (held && !(await page.evaluate(() => window.cockpit.held()))) throw new Late("the hold has ended by itself");
    if (owner && (await ownerOf(page)) !== owner) throw new Late(`${await ownerOf(page)} has taken the arm`);
    // It may have been done, and an arm that a busy computer served too late has ended it again.
    if (held && Date.now() - begun > kPatience / 3) throw new Late(`not carried out: ${done}`);
    if (Date.now() - begun > kPatience) throw new Error(`not carried out: ${done}\n${await saidBy(page)}`);
    await page.waitForTimeout(20);
  }
}

/** Clicks until the run has done what this asks for. */
export function ask(page: Page, button: Locator, done: () => Promise<boolean>, owner?: string): Promise<void> {
  return patiently(page, owner, async () => {
    await button.click();
    await carriedOut(page, done, owner);
  });
}

/** The same for what may move an arm: its button is held until the arms stand still. */
export function askHeld(page: Page, button: Locator, done: () => Promise<boolean>, owner?: string): Promise<void> {
  return patiently(page, owner, async () => {
    if (await done()) return;
    await hold(page, button, async () => {
      await carriedOut(page, done, owner, true);
      await atRest(page);
      await page.waitForTimeout(kStill);
      await carriedOut(page, done, owner, true);
    });
    if (!(await done())) throw new Late("it has ended with the hold");
  });
}

export async function activate(page: Page, name: string): Promise<void> {
  await page.getByRole("tab", { name: "Laws", exact: true }).click();
  await askHeld(page, page.getByRole("button", { name: `Activate ${name}` }), () => leads(page, name));
}

/** Longer than an arm must rest before it may change its owner without a hold [ms]. */
const kStill = 500;

const leads = (page: Page, name: string): Promise<boolean> =>
  page.evaluate((name) => window.cockpit.session.state!.arms.some((arm) => arm.controllet === name), name);

/** Without the page's buttons. What a busy computer has stopped, also in a test before, is resumed and recovered first. */
export async function activateAtOnce(page: Page, owner: string): Promise<void> {
  for (const begun = Date.now(); !(await leads(page, owner));) {
    if (Date.now() - begun > 2 * kPatience) throw new Late(`${owner} cannot be started\n${await saidBy(page)}`);
    await page.evaluate(
      async ([owner, still]) => {
        const { session, line } = window.cockpit;
        const beats = setInterval(() => line.beat(), 50);
        line.beat();
        const { ok } = await session.request("switch", { activate: [owner] });
        if (!ok) {
          await session.request("resume", { arms: "all", stops: session.state?.stops });
          for (const { name } of session.scene!.arms) await session.request("recover", { arm: name });
        }
        await new Promise((resolve) => setTimeout(resolve, still));
        clearInterval(beats);
        line.release();
      },
      [owner, kStill] as const,
    );
    await page.waitForTimeout(100);
  }
}

/** Waits until a number of the state has changed by at least so much, from now or `from`, while something is held. */
export async function heldUntil(
  page: Page,
  number: (state: LiveState) => number,
  by: number,
  from?: number,
): Promise<void> {
  const result = await page.evaluate(
    async ({ number, by, patience, begin }) => {
      const { cockpit } = window;
      const read = new Function("state", `return (${number})(state)`) as (state: LiveState) => number;
      const from = begin ?? read(cockpit.session.state!);
      const begun = performance.now();
      let held = false;
      const said = () => document.querySelector(".toast:last-child p")?.textContent ?? "nothing said";
      for (;;) {
        const moved = read(cockpit.session.state!) - from;
        if (by > 0 ? moved > by : moved < by) return "moved";
        if (held && !cockpit.held()) return `let go: ${said()}`;
        held ||= cockpit.held();
        if (!held && performance.now() - begun > 1500) return `never held: ${said()}`;
        if (performance.now() - begun > patience) return `moved by ${moved}: ${said()}`;
        await new Promise((resolve) => setTimeout(resolve, 10));
      }
    },
    { number: String(number), by, patience: kPatience, begin: from },
  );
  if (/^(let go|never held)/.test(result)) throw new Late(result);
  assert.equal(result, "moved");
}

/** Waits until the hand of an arm has moved along an axis by at least so much while something is held. */
export function handMoves(page: Page, arm: number, axis: number, by: number): Promise<void> {
  return heldUntil(page, Function(`return (state) => state.arms[${arm}].hand.position[${axis}]`)() as never, by);
}

/** Waits until no joint of any arm moves. */
export async function atRest(page: Page): Promise<void> {
  await until(page, () =>
    window.cockpit.session.state!.arms.every((arm) =>
      Array.from(arm.quantity("dq_rad_per_s") ?? [NaN]).every((speed) => Math.abs(speed) < 0.005),
    ),
  );
}

/** Where the handle of the vertical axis is on the screen: above the target, in the middle of the shaft. */
export function gizmoHandle(page: Page): Promise<number[]> {
  return page.evaluate(() => {
    const { stage, session } = window.cockpit;
    const p = session.state!.arms[0]!.hand.position;
    const { camera, renderer } = stage;
    const v = camera.position.clone().set(p[0], p[1], p[2]).project(camera);
    const { left, top, width, height } = renderer.domElement.getBoundingClientRect();
    return [left + ((v.x + 1) / 2) * width, top + ((1 - v.y) / 2) * height - 0.08 * height];
  });
}

/** A picture of the page, where pictures are asked for. */
export async function picture(page: Page, name: string): Promise<void> {
  if (!pictures) return;
  // Software renderers draw coarsely to keep pace; pictures for the docs are drawn as on a graphics card.
  await page.evaluate(() => window.cockpit.stage.drawSharply());
  await page.screenshot({ path: join(pictures, `${name}.png`) });
}

const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core"), "utf8");

/** Fails with what axe-core finds wrong, by all of its rules or these: what somebody cannot see, hear or point at. */
export async function assertAccessible(page: Page, where: string, ...rules: string[]): Promise<void> {
  await page.evaluate(axe);
  const found = (await page.evaluate(async (rules) => {
    const { violations } = await (
      window as never as { axe: { run(options: object): Promise<{ violations: Violation[] }> } }
    ).axe.run(rules.length ? { runOnly: rules } : {});
    return violations.map(({ id, help, nodes }) => `${id}: ${help}: ${nodes.map((node) => node.html).join(" | ")}`);
  }, rules)) as string[];
  assert.deepEqual(found, [], where);
}

interface Violation {
  id: string;
  help: string;
  nodes: { html: string }[];
}
