// A recorded log in the same page: scrub, play, compare two.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { after, before, suite, test } from "node:test";
import { open, picture, Run, temporaryFolder, until, type Window_ } from "./support.ts";

suite("log", () => {
  let run: Run;
  before(async () => {
    const folder = temporaryFolder();
    const program = process.env["COCKPIT_PROGRAM"]!;
    const made = spawnSync(program, ["run", "two_arms", "--seconds", "12", "--fast", "--record", folder], {
      encoding: "utf8",
    });
    assert.equal(made.status, 0, made.stderr);
    run = await Run.start("cockpit", folder);
  });
  after(() => run.end());

  test("a log is scrubbed and played, and commands nothing", async () => {
    const { page, context, complaints } = await open(run.url);
    const time = () => page.evaluate(() => (window as never as Window_).cockpit.session.state.t_s);
    const slider = page.getByRole("slider", { name: "Time in the log" });
    await slider.focus();
    await page.keyboard.press("End");
    await until(page, () => (window as never as Window_).cockpit.session.state.t_s > 11.9);
    await page.keyboard.press("Home");
    await until(page, () => (window as never as Window_).cockpit.session.state.t_s < 0.1);
    await page.getByRole("button", { name: "Play the log" }).click();
    await until(page, () => (window as never as Window_).cockpit.session.state.t_s > 1.5);
    await page.getByRole("button", { name: "Pause the log" }).click();
    const from = await time();
    await page.waitForTimeout(300);
    assert.ok((await time()) - from < 0.1);
    await page.getByRole("region", { name: "Events of the log" }).getByText("switched").last().click();
    await until(page, () => (window as never as Window_).cockpit.session.state.t_s > 5);
    await picture(page, "cockpit_log");
    await page.getByRole("tab", { name: "Plots" }).click();
    await page.getByLabel("Quantity to plot").fill("left/q_rad");
    await page.getByRole("button", { name: "Add plot" }).click();
    await page.getByRole("figure", { name: "Plot of left/q_rad" }).waitFor();
    assert.equal(await page.getByRole("button", { name: "Take control" }).count(), 0);
    assert.deepEqual(complaints, []);
    await context.close();
  });
});
