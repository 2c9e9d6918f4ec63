// A recorded log in the same page: scrub, play, compare two.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { after, before, suite, test } from "node:test";
import { open, picture, Run, temporaryFolder, until } from "./support.ts";

/** The folder of a new log of the example. */
function record(seconds: string, ...args: string[]): string {
  const folder = temporaryFolder();
  const words = ["run", "two_arms", "--seconds", seconds, "--fast", "--record", folder, ...args];
  const made = spawnSync(process.env["COCKPIT_PROGRAM"]!, words, { encoding: "utf8" });
  assert.equal(made.status, 0, made.stderr);
  return folder;
}

suite("log", () => {
  let run: Run;
  before(async () => (run = await Run.start("cockpit", record("12"))));
  after(() => run.end());

  test("a log is scrubbed and played, and commands nothing", async () => {
    const { page, context, complaints } = await open(run.url);
    const time = () => page.evaluate(() => window.cockpit.session.state!.t_s);
    const slider = page.getByRole("slider", { name: "Time in the log" });
    await slider.focus();
    await page.keyboard.press("End");
    await until(page, () => window.cockpit.session.state!.t_s > 11.9);
    await page.keyboard.press("Home");
    await until(page, () => window.cockpit.session.state!.t_s < 0.1);
    await page.getByRole("button", { name: "Play the log" }).click();
    await until(page, () => window.cockpit.session.state!.t_s > 1.5);
    await page.getByRole("button", { name: "Pause the log" }).click();
    const from = await time();
    await page.waitForTimeout(300);
    assert.ok((await time()) - from < 0.1);
    await page.getByRole("region", { name: "Events of the log" }).getByText("switched").last().click();
    await until(page, () => window.cockpit.session.state!.t_s > 5);
    await picture(page, "cockpit_log");
    await page.getByRole("tab", { name: "Plots" }).click();
    await page.getByLabel("Quantity to plot").fill("left/q_rad");
    await page.getByRole("button", { name: "Add plot" }).click();
    await page.getByRole("figure", { name: "Plot of left/q_rad" }).waitFor();
    assert.equal(await page.getByRole("button", { name: "Take control" }).count(), 0);
    assert.deepEqual(complaints, []);
    await context.close();
  });

  test("a second log is drawn beside the first, and both move together", async () => {
    const [folder, other] = [record("12"), record("9")];
    const both = await Run.start("cockpit", folder, other);
    try {
      const { page, context, complaints } = await open(both.url);
      await page.getByText(/compared with .* \(pale\)/).waitFor();
      const slider = page.getByRole("slider", { name: "Time in the log" });
      await slider.focus();
      await page.keyboard.press("End");
      await until(page, () => window.cockpit.session.state!.t_s > 11.9);
      await picture(page, "cockpit_two_logs");
      assert.deepEqual(complaints, []);
      await context.close();
    } finally {
      await both.end();
    }
  });

  // Ten minutes when all is tested in full, else half of one.
  const seconds = process.env["MULTIPANDA_FULL"] ? 600 : 30;
  test(`a log of ${seconds} seconds is scrubbed without waiting`, async () => {
    const long = await Run.start("cockpit", record(String(seconds)));
    try {
      const { page, context } = await open(long.url);
      const waits = await page.evaluate(
        async ([seconds]) => {
          const { cockpit } = window;
          const scrub = document.querySelector<HTMLInputElement>("[aria-label='Time in the log']")!;
          const waits: number[] = [];
          for (let k = 1; k <= 40; ++k) {
            const t = (k * 0.618 * seconds!) % seconds!; // forth and back through all of it
            const begun = performance.now();
            scrub.value = String(t);
            scrub.dispatchEvent(new Event("input"));
            while (Math.abs(cockpit.session.state!.t_s - t) > 0.1 && performance.now() - begun < 10_000)
              await new Promise((resolve) => setTimeout(resolve, 1));
            waits.push(performance.now() - begun);
          }
          return waits.sort((a, b) => a - b);
        },
        [seconds],
      );
      console.log(
        `from the slider to the state: median ${waits[20]!.toFixed(0)} ms, worst ${waits[39]!.toFixed(0)} ms`,
      );
      assert.ok(waits[39]! < 5000, `${waits[39]} ms`);
      await context.close();
    } finally {
      await long.end();
    }
  });
});
