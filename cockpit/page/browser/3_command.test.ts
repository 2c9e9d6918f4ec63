// Everything that is asked of a run by a click: laws, features, parameters, grippers, the simulation, plots, episodes.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, suite, test } from "node:test";
import {
  atRest,
  hold,
  kBackends,
  kPatience,
  open,
  Run,
  stateOf,
  takeControl,
  until,
  type Cockpit,
  type Window_,
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

  const tab = (name: string) => cockpit.page.getByRole("tab", { name, exact: true }).click();
  interface SessionLike {
    scene: { bodies: { name: string }[] };
  }

  test("a switch shows what it cost, and is on the timeline", async () => {
    const { page } = cockpit;
    await tab("Laws");
    await page.getByRole("button", { name: "Activate dual" }).click();
    await page.getByText(/Started dual\..*first torque.*Largest torque step of a joint: left/).waitFor();
    await tab("Timeline");
    await page.getByRole("region", { name: "Events" }).getByText("switched").first().waitFor();
  });

  test("features are switched on and off, and the card says so", async () => {
    const { page } = cockpit;
    await tab("Laws");
    const feature = page.getByRole("checkbox", { name: "joint limits" });
    assert.ok(await feature.isChecked());
    const card = page.getByRole("region", { name: "Arm left" });
    await card.getByText("+ joint limits").waitFor();
    await feature.uncheck();
    await card
      .getByText("+ joint limits")
      .waitFor({ state: "detached" })
      .catch(() => {});
    await until(page, () => !/joint limits/.test(document.querySelector(".arm-card")!.textContent!));
    await page.getByRole("checkbox", { name: "joint limits" }).check();
    await card.getByText("+ joint limits").waitFor();
  });

  test("a parameter is set within its bounds, with its unit", async () => {
    const { page } = cockpit;
    await tab("Laws");
    await page.getByRole("button", { name: "Activate left_cartesian" }).click();
    await until(
      page,
      () => (window as never as Window_).cockpit.session.state.arms[0]!.controllet === "left_cartesian",
    );
    const number = page.getByRole("spinbutton", { name: /^translational stiffness 1 \[N\/m\]/ });
    await page.locator("summary", { hasText: "translational stiffness" }).click();
    await number.fill("250");
    await number.press("Enter");
    await until(page, () =>
      (window as never as { cockpit: { session: { list: ListLike } } }).cockpit.session.list.some(
        (one) =>
          one.name === "left_cartesian" &&
          one.parameters.some(
            (parameter) => /^translational_stiffness/.test(parameter.name) && parameter.value[0] === 250,
          ),
      ),
    );
  });
  type ListLike = { name: string; parameters: { name: string; value: number[] }[] }[];

  test("what is refused is said with its reason", async () => {
    const { page } = cockpit;
    await tab("Arms");
    await page.getByRole("button", { name: "Recover: left" }).click();
    await page.getByText(/Refused: .*error/).waitFor({ timeout: kPatience });
  });

  test("a load is declared, an arm's stop button pressed and released", async () => {
    const { page } = cockpit;
    await tab("Arms");
    await page.locator("summary", { hasText: "Load" }).first().click();
    const mass = page.getByRole("spinbutton", { name: "Mass [kg], number" }).first();
    await mass.fill("0.1");
    await mass.press("Enter");
    await page.getByRole("button", { name: "Declare load: left" }).click();
    await page.getByText("a payload of 0.1 kg is declared").waitFor();
    const mode = page.getByRole("region", { name: "Arm left" }).getByText("user stopped");
    await page.getByRole("button", { name: "Press user stop: left" }).click();
    await page.getByText("Pressed.").waitFor();
    await mode.waitFor();
    await page.getByRole("button", { name: "Release user stop: left" }).click();
    await page.getByText("Released.").waitFor();
    await mode.waitFor({ state: "detached" });
  });

  const pauses = async () => {
    const { page } = cockpit;
    await tab("World");
    await page.getByRole("button", { name: "Pause simulation" }).click();
    const go = page.getByRole("button", { name: "Continue simulation" });
    await go.waitFor();
    const before = await stateOf(page);
    await page.getByRole("button", { name: "Step 10 ms" }).click();
    await until(page, (cycle) => (window as never as Window_).cockpit.session.state.cycle >= cycle + 10, before.cycle);
    await go.click();
    // It goes on, and has not been paused once more.
    await until(page, (cycle) => (window as never as Window_).cockpit.session.state.cycle > cycle + 500, before.cycle);
    await page.getByRole("button", { name: "Pause simulation" }).waitFor();
  };
  const refusesToPause = async () => {
    const { page } = cockpit;
    await tab("World");
    await page.getByRole("button", { name: "Pause simulation" }).click();
    await page.getByText(/^pause: .*not support/).waitFor();
    const { cycle } = await stateOf(page);
    await until(page, (cycle) => (window as never as Window_).cockpit.session.state.cycle > cycle + 10, cycle);
  };
  if (backend === "virtual") test("a world of virtual arms does not pause, and the page says so", refusesToPause);
  else test("the simulation pauses, steps and continues", pauses);

  test("an object is placed and pushed, and a reset puts it back", async () => {
    const { page } = cockpit;
    await tab("World");
    const box = await page.evaluate(() =>
      (window as never as { cockpit: { session: SessionLike } }).cockpit.session.scene.bodies.findIndex(
        (body) => body.name === "box",
      ),
    );
    const start = Array.from((await stateOf(page)).bodies).slice(7 * box, 7 * box + 3);
    const lies = (at: number[]) =>
      until(
        page,
        ({ box, at }) =>
          at.every((value, axis) => {
            const { state } = (window as never as Window_).cockpit.session;
            return Math.abs(state.bodies[7 * box + axis]! - value) < 0.01;
          }),
        { box, at },
      );
    await page.getByRole("combobox", { name: "Object" }).selectOption("box");
    for (const [axis, value] of [
      ["x", "0.55"],
      ["y", "0.1"],
      ["z", "0.235"],
    ]) {
      const number = page.getByRole("spinbutton", { name: `${axis} [m], number` });
      await number.fill(value!);
      await number.press("Enter");
    }
    await page.getByRole("button", { name: "Place object" }).click();
    await lies([0.55, 0.1]);
    await hold(page, page.getByRole("button", { name: "Push against x" }), () =>
      until(page, (box) => (window as never as Window_).cockpit.session.state.bodies[7 * box]! < 0.545, box),
    );
    await page.getByRole("button", { name: "Reset simulation" }).click();
    await lies(start);
  });

  test("episodes are marked", async () => {
    const { page } = cockpit;
    await tab("World");
    await page.getByRole("button", { name: "Episode: start" }).click();
    await page.getByText("Episode 1: start.").waitFor();
    await page.getByRole("button", { name: "Episode: success" }).click();
    await page.getByText("Episode 1: success.").waitFor();
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

  test("a gripper closes and opens, and an object is grasped", async () => {
    const own = await Run.idle("grippers", "--backend", backend);
    try {
      const { page, context } = await open(own.url);
      await takeControl(page);
      await page.getByRole("tab", { name: "Arms", exact: true }).click();
      const width = page.getByRole("slider", { name: "Width" }).first();
      await width.focus();
      await page.keyboard.press("Home");
      for (let k = 0; k < 40; ++k) await page.keyboard.press("ArrowRight"); // mm, of the cube between the fingers
      await page.getByRole("button", { name: "Grasp: left" }).click();
      await until(page, () => (window as never as Window_).cockpit.session.state.arms[0]!.gripper!.grasped);
      await page.getByRole("button", { name: "Open: left" }).click();
      await until(page, () => (window as never as Window_).cockpit.session.state.arms[0]!.gripper!.width_m > 0.07);
      await context.close();
    } finally {
      await own.end();
    }
  });

  test("everything is at rest in the end", () => atRest(cockpit.page));
};

for (const backend of kBackends) suite(`command ${backend} arms`, commands(backend));
