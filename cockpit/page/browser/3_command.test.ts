// Everything that is asked of a run by a click: laws, features, parameters, grippers, the simulation, plots, episodes.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, suite, test } from "node:test";
import type { LiveState } from "../src/model/live.ts";
import {
  ask,
  askHeld,
  atRest,
  carriedOut,
  heldUntil,
  hold,
  Late,
  kBackends,
  open,
  patiently,
  Run,
  stateOf,
  takeControl,
  unlessTooSlow,
  until,
  type Cockpit,
} from "./support.ts";

const commands = (backend: string) => () => {
  let run: Run;
  let cockpit: Cockpit;
  before(async () => {
    run = await Run.idle("two_arms", "--backend", backend);
    cockpit = await open(run.url);
    await takeControl(cockpit.page);
  });
  after(async () => {
    assert.deepEqual(cockpit.complaints, []);
    await run.end();
  });

  const heldTest = (name: string, act: () => Promise<void>) => test(name, (t) => unlessTooSlow(t, cockpit.page, act));
  const tab = (name: string) => cockpit.page.getByRole("tab", { name, exact: true }).click();
  const button = (name: string) => cockpit.page.getByRole("button", { name });
  const says = (text: string | RegExp) => () => cockpit.page.getByText(text).first().isVisible();

  heldTest("a switch shows what it cost, and is on the timeline", async () => {
    const { page } = cockpit;
    await tab("Laws");
    await askHeld(
      page,
      button("Activate dual"),
      says(/Started dual\..*first torque.*Largest torque step of a joint: left/),
    );
    await tab("Timeline");
    await page.getByRole("region", { name: "Events" }).getByText("switched").first().waitFor();
  });

  heldTest("features are switched on and off, and the card says so", async () => {
    const { page } = cockpit;
    await tab("Laws");
    const feature = (to: string) => button(`Switch joint limits ${to} while held`);
    const is = (on: boolean) => () =>
      page.evaluate((on) => window.cockpit.session.controllet("dual")!.features[0]!.on === on, on);
    const onCard = page.getByRole("region", { name: "Arm left" }).getByText("+ joint limits");
    const shows = (on: boolean) =>
      patiently(page, "dual", () => carriedOut(page, async () => (await onCard.isVisible()) === on, "dual"));
    await shows(true);
    await askHeld(page, feature("off"), is(false), "dual");
    await shows(false);
    await askHeld(page, feature("on"), is(true), "dual");
    await shows(true);
  });

  heldTest("a parameter is set within its bounds, with its unit", async () => {
    const { page } = cockpit;
    const kName = "left_cartesian";
    await tab("Laws");
    const listed = async () =>
      (await page.evaluate(() => window.cockpit.session.list)).find((one) => one.name === kName)!;
    // The list that says that it is active also rebuilds the panel.
    await askHeld(page, button(`Activate ${kName}`), async () => (await listed()).active);
    const number = page.getByRole("spinbutton", { name: /^translational stiffness 1 \[N\/m\]/ });
    const isSet = async () =>
      (await listed()).parameters.some(({ name, value }) => /^translational_stiffness/.test(name) && value[0] === 250);
    await patiently(page, kName, async () => {
      if (!(await number.isVisible())) await page.locator("summary", { hasText: "translational stiffness" }).click();
      await number.fill("250", { timeout: 3000 }).catch((error: Error) => {
        throw new Late(error.message);
      });
      await number.press("Enter");
      const set = button(`Set translational stiffness n per m of ${kName} while held`);
      await hold(page, set, () => carriedOut(page, isSet, kName, true));
    });
  });

  heldTest("a parameter that acts as a goal moves the hands only while its button is held", async () => {
    const { page } = cockpit;
    await tab("Laws");
    const hands = async () => (await stateOf(page)).arms.map((arm) => arm.hand.position[1]!);
    await patiently(page, "dual", async () => {
      const number = page.getByRole("spinbutton", { name: /^offset 2 \[m\]/ });
      const offset = page.locator("summary", { hasText: /^offset/ });
      const isOpen = (await number.isVisible()) || (await offset.isVisible()); // by an earlier try
      if (!isOpen) await button("dual dual cartesian impedance").click();
      if (!(await number.isVisible())) await offset.click();
      const before = await hands();
      const apart = (before[0]! - before[1]!) / 2;
      const by = apart > 0.25 ? -0.02 : 0.02;
      await number.fill((apart + 7 * by).toFixed(3));
      await number.press("Enter");
      await page.waitForTimeout(500); // it is chosen, and not set
      assert.ok(Math.abs((await hands())[0]! - before[0]!) < 1e-3);
      const set = button("Set offset m of dual while held");
      const isOnItsWay = async () => ((await hands())[0]! - before[0]!) / by > 1;
      await hold(page, set, () => carriedOut(page, isOnItsWay, "dual", true));
      await until(page, () => window.cockpit.session.state!.arms[0]!.controllet === "left_hold");
      await atRest(page);
      assert.ok(Math.abs((await hands())[0]! - before[0]!) < 0.1, "the hand went on to its goal");
    });
  });

  test("what is refused is said with its reason", async () => {
    await tab("Arms");
    await ask(cockpit.page, button("Recover: left"), says(/Refused: .*error/));
  });

  heldTest("a load is declared, an arm's stop button pressed and released", async () => {
    const { page } = cockpit;
    await tab("Arms");
    await page.locator("summary", { hasText: "Load" }).first().click();
    const mass = page.getByRole("spinbutton", { name: "Mass [kg], number" }).first();
    await mass.fill("0.1");
    await mass.press("Enter");
    await askHeld(page, button("Declare load while held: left"), says("a payload of 0.1 kg is declared"));
    const isStopped = () => page.getByRole("region", { name: "Arm left" }).getByText("user stopped").isVisible();
    await ask(page, button("Press user stop: left"), async () => (await says("Pressed.")()) && (await isStopped()));
    await ask(page, button("Release user stop: left"), async () => (await says("Released.")()) && !(await isStopped()));
  });

  const cycle = async () => (await stateOf(cockpit.page)).cycle;
  const pauses = async () => {
    const { page } = cockpit;
    await tab("World");
    const go = button("Continue simulation");
    await ask(page, button("Pause simulation"), () => go.isVisible());
    const before = await cycle();
    await ask(page, button("Step 10 ms"), async () => (await cycle()) >= before + 10);
    await ask(page, go, () => button("Pause simulation").isVisible());
    // It goes on, and has not been paused once more.
    await carriedOut(page, async () => (await cycle()) > before + 500);
    await button("Pause simulation").waitFor();
  };
  const refusesToPause = async () => {
    await tab("World");
    await ask(cockpit.page, button("Pause simulation"), says(/^pause: .*not support/));
    const before = await cycle();
    await carriedOut(cockpit.page, async () => (await cycle()) > before + 10);
  };
  if (backend === "virtual") test("a world of virtual arms does not pause, and the page says so", refusesToPause);
  else test("the simulation pauses, steps and continues", pauses);

  test("an object is placed and pushed, and a reset puts it back", async () => {
    const { page } = cockpit;
    await tab("World");
    const box = await page.evaluate(() =>
      window.cockpit.session.scene!.bodies.findIndex((body) => body.name === "box"),
    );
    const position = async () => Array.from((await stateOf(page)).bodies).slice(7 * box, 7 * box + 3);
    const start = await position();
    const lies = (at: number[]) => async () => {
      const now = await position();
      return at.every((value, axis) => Math.abs(now[axis]! - value) < 0.01);
    };
    await page.getByRole("combobox", { name: "Object" }).selectOption("box");
    await patiently(page, undefined, async () => {
      for (const [axis, value] of [
        ["x", "0.55"],
        ["y", "0.1"],
        ["z", "0.235"],
      ]) {
        const number = page.getByRole("spinbutton", { name: `${axis} [m], number` });
        await number.fill(value!);
        await number.press("Enter");
      }
      await button("Place object").click();
      await carriedOut(page, lies([0.55, 0.1]));
    });
    const x = Function(`return (state) => state.bodies[${7 * box}]`)() as (state: LiveState) => number;
    await patiently(page, undefined, () =>
      hold(page, button("Push against x"), () => heldUntil(page, x, -0.005, 0.55)),
    );
    await ask(page, button("Reset simulation"), lies(start));
  });

  test("episodes are marked", async () => {
    await tab("World");
    await ask(cockpit.page, button("Episode: start"), says("Episode 1: start."));
    await ask(cockpit.page, button("Episode: success"), says("Episode 1: success."));
  });

  test("a plot runs, freezes, and is saved as CSV and PNG", async () => {
    const { page } = cockpit;
    await tab("Plots");
    await page.getByLabel("Quantity to plot").fill("left/q_rad");
    await page.getByRole("button", { name: "Add plot" }).click();
    await page.waitForTimeout(1500);
    await page.getByRole("button", { name: "Freeze the plot of left/q_rad" }).click();
    const save = async (kind: string) => {
      const download = page.waitForEvent("download");
      await page.getByRole("button", { name: `Save the plot of left/q_rad as ${kind}` }).click();
      return readFileSync((await (await download).path())!);
    };
    const lines = (await save("CSV")).toString().trim().split("\n");
    assert.equal(lines[0]!.split(",").length, 8);
    assert.ok(lines.length > 500, `${lines.length} lines`);
    const times = lines.slice(1).map((line) => Number(line.split(",")[0]));
    // One row for each cycle: nothing is thinned.
    const gaps = times.slice(1).map((t, k) => t - times[k]!);
    gaps.sort((a, b) => a - b);
    // The time of virtual arms is this computer's: every other row would still be a millisecond off.
    const off = backend === "virtual" ? 2e-4 : 1e-6;
    assert.ok(Math.abs(gaps[gaps.length >> 1]! - 0.001) < off, `${gaps[gaps.length >> 1]}`);
    const png = await save("PNG");
    assert.deepEqual(
      [...png.subarray(1, 4)],
      [..."PNG"].map((letter) => letter.charCodeAt(0)),
    );
    await page.getByRole("button", { name: "Remove the plot of left/q_rad" }).click();
  });

  test("the histogram counts every cycle", async () => {
    const { page } = cockpit;
    await tab("Loop");
    await page.getByText(/median \d+ .* of \d{3,} cycles/).waitFor();
  });

  test("a gripper closes and opens, and an object is grasped", async (t) => {
    const own = await Run.idle("grippers", "--backend", backend);
    try {
      const { page, context } = await open(own.url);
      await takeControl(page);
      await page.getByRole("tab", { name: "Arms", exact: true }).click();
      const width = page.getByRole("slider", { name: "Width" }).first();
      await width.focus();
      await page.keyboard.press("Home");
      for (let k = 0; k < 40; ++k) await page.keyboard.press("ArrowRight"); // mm, of the cube between the fingers
      const gripper = async () => (await stateOf(page)).arms[0]!.gripper!;
      const held = (name: string) => page.getByRole("button", { name: `${name} while held: left` });
      await unlessTooSlow(t, page, async () => {
        await askHeld(page, held("Grasp"), async () => (await gripper()).grasped);
        await askHeld(page, held("Open"), async () => (await gripper()).width_m > 0.07);
      });
      await context.close();
    } finally {
      await own.end();
    }
  });

  test("everything is at rest in the end", () => atRest(cockpit.page));
};

for (const backend of kBackends) suite(`command ${backend} arms`, commands(backend));
