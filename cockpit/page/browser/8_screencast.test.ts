// The screencast of the README, made only where pictures are asked for: tools/make_screencast.py joins its frames.
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { activate, hold, open, patiently, pictures, Run, takeControl, temporaryFolder, until } from "./support.ts";

test("a screencast: jog, switch, stop", { skip: !pictures }, async () => {
  // Drawing in software, and filming, take longer than the example's streams may be silent.
  const scene = join(temporaryFolder(), "two_arms.yaml");
  const text = readFileSync("../../config/scenes/two_arms.yaml", "utf8");
  const patient = (input: string) => `inputs: {${input}: {timeout_s: 0.5}}`;
  writeFileSync(
    scene,
    text
      .replace("arms: left, features: [joint_limits]}", `arms: left, features: [joint_limits], ${patient("pose")}}`)
      .replace(
        "features: [joint_limits]\n    parameters:",
        `features: [joint_limits]\n    ${patient("common_pose")}\n    parameters:`,
      ),
  );
  const run = await Run.idle(scene);
  try {
    const { page, context } = await open(run.url, { sharp: true, width: 1120, height: 700 });
    const folder = join(pictures, "screencast");
    mkdirSync(folder, { recursive: true });
    const film = await context.newCDPSession(page);
    const times: number[] = [];
    film.on("Page.screencastFrame", ({ data, metadata, sessionId }) => {
      writeFileSync(join(folder, `${String(times.length).padStart(4, "0")}.jpg`), Buffer.from(data, "base64"));
      times.push(metadata.timestamp!);
      void film.send("Page.screencastFrameAck", { sessionId });
    });
    await takeControl(page);
    await film.send("Page.startScreencast", { format: "jpeg", quality: 90, maxWidth: 1120, maxHeight: 700 });
    await page.waitForTimeout(600);
    for (const direction of ["up", "left", "right"]) {
      const button = page.getByRole("button", { name: `Move ${direction} while held` });
      await patiently(page, "left_cartesian", () => hold(page, button, () => page.waitForTimeout(1200)));
    }
    await page.getByRole("tab", { name: "Laws" }).click();
    await page.waitForTimeout(500);
    await activate(page, "dual");
    await page.getByText(/Started dual\./).waitFor();
    await page.waitForTimeout(1200);
    await page.getByRole("tab", { name: "Move" }).click();
    await patiently(page, "dual", () =>
      hold(page, page.getByRole("button", { name: "Move up while held" }), () => page.waitForTimeout(1500)),
    );
    await page.getByRole("button", { name: "Stop", exact: true }).click();
    await until(page, () => window.cockpit.session.state!.arms.every((arm) => arm.stopped));
    await page.waitForTimeout(1200);
    await page.getByRole("button", { name: "Resume" }).click();
    await page.waitForTimeout(800);
    await film.send("Page.stopScreencast");
    writeFileSync(join(folder, "times.json"), JSON.stringify(times));
    await context.close();
  } finally {
    await run.end();
  }
});
