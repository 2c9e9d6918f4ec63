// Moving an arm: every device moves it only while it is held, and everything that ends a hold stops it.
import assert from "node:assert/strict";
import { test } from "node:test";
import {
  activate,
  atRest,
  drag,
  gizmoHandle,
  hold,
  holding,
  handMoves,
  heldUntil,
  kBackends,
  kPatience,
  Late,
  open,
  patiently,
  Run,
  stateOf,
  takeControl,
  until,
  type Cockpit,
} from "./support.ts";
import { Network } from "./network.ts";

for (const backend of kBackends) {
  test(`${backend} arms`, async (t) => {
    const run = await Run.idle("two_arms", "--backend", backend);
    try {
      const cockpit = await open(run.url);
      await takeControl(cockpit.page);
      await holding(t, cockpit.page, "jog by a button, held by the mouse", () => byMouse(cockpit));
      await holding(t, cockpit.page, "jog by a button, held by a key", () => byKey(cockpit));
      await holding(t, cockpit.page, "jog by the keyboard", () => byKeyboard(cockpit));
      await holding(t, cockpit.page, "a joint by its slider", () => byJoint(cockpit));
      await holding(t, cockpit.page, "the target is dragged in the picture", () => byGizmo(cockpit));
      await holding(t, cockpit.page, "a hidden tab lets go", () => hidden(cockpit));
      await holding(t, cockpit.page, "a pointer that the browser takes lets go", () => taken(cockpit));
      await holding(t, cockpit.page, "a page that stands still is let go by the run", () => frozen(cockpit));
      await holding(t, cockpit.page, "a page that is closed in mid motion leaves the arm held", () =>
        closed(cockpit, run),
      );
      await cockpit.context.close(); // otherwise a test that was skipped would still have control
      const fresh = await open(run.url);
      await holding(t, fresh.page, "a network that is cut in mid motion leaves the arm held", async () => {
        await fresh.context.close();
        await cut(run);
      });
    } finally {
      await run.end();
    }
  });
}

const up = (page: Cockpit["page"]) => page.getByRole("button", { name: "Move up while held" });

// After letting go, an arm may brake for as long as the limits take; then it stays.
async function assertStays(page: Cockpit["page"]): Promise<void> {
  await atRest(page);
  const from = (await stateOf(page)).arms[0]!.hand.position;
  await page.waitForTimeout(400);
  const to = (await stateOf(page)).arms[0]!.hand.position;
  const moved = Math.hypot(...to.map((x, k) => x - from[k]!));
  assert.ok(moved < 2e-3, `it moved by ${(1000 * moved).toFixed(1)} mm after it was let go`);
}

const kCartesian = "left_cartesian";

async function byMouse({ page }: Cockpit): Promise<void> {
  await page.getByRole("tab", { name: "Move" }).click();
  // The controllet is still active: the next hold needs no switch. A picture that came late as the button was let go
  // ends in the hold of a silent input instead, so it is tried again.
  for (let tries = 1; ; ++tries) {
    await patiently(page, kCartesian, () => hold(page, up(page), () => handMoves(page, 0, 2, 0.02)));
    await assertStays(page);
    const owner = (await stateOf(page)).arms[0]!.controllet;
    if (owner === kCartesian) return;
    if (tries === 3) throw new Late(`the arm was led by ${owner} after the button was let go, expected ${kCartesian}`);
  }
}

/** Keeps a key down until the hand has moved. */
async function pressUntil(page: Cockpit["page"], key: string, by: number): Promise<void> {
  await patiently(page, kCartesian, async () => {
    await page.keyboard.down(key);
    try {
      await handMoves(page, 0, 2, by);
    } finally {
      await page.keyboard.up(key);
    }
  });
}

async function byKey({ page }: Cockpit): Promise<void> {
  await page.getByRole("button", { name: "Move down while held" }).focus();
  await pressUntil(page, "Space", -0.01);
  await assertStays(page);
}

async function byKeyboard({ page }: Cockpit): Promise<void> {
  const box = page.getByRole("checkbox", { name: "Keyboard" });
  await box.check();
  await pressUntil(page, "KeyR", 0.01);
  await assertStays(page);
  await box.uncheck();
}

async function lead(page: Cockpit["page"], name: string): Promise<void> {
  await activate(page, name);
  await page.getByRole("tab", { name: "Move" }).click();
}

async function byJoint({ page }: Cockpit): Promise<void> {
  await lead(page, "left_joint");
  await page.locator("summary", { hasText: "Joints" }).click();
  const slider = page.getByRole("slider", { name: "Joint 1" });
  await slider.scrollIntoViewIfNeeded();
  await patiently(page, "left_joint", async () => {
    await page.waitForTimeout(300); // the slider follows the joint
    const box = (await slider.boundingBox())!;
    const share = Number(
      await slider.evaluate(({ value, min, max }: HTMLInputElement) => (+value - +min) / (+max - +min)),
    );
    const x = (share: number) => box.x + box.width * share;
    await page.mouse.move(x(share), box.y + box.height / 2);
    await page.mouse.down();
    try {
      const y = box.y + box.height / 2;
      const from = Number((await stateOf(page)).arms[0]!.q[0]);
      await drag(page, [x(share), y], [x(share + (share < 0.6 ? 0.15 : -0.15)), y]);
      await heldUntil(page, (state) => Number(state.arms[0]!.q[0]), share < 0.6 ? 0.05 : -0.05, from);
    } finally {
      await page.mouse.up();
    }
  });
  await assertStays(page);
  await page.locator("summary", { hasText: "Joints" }).click();
  await lead(page, kCartesian);
}

async function byGizmo({ page }: Cockpit): Promise<void> {
  const box = page.getByRole("checkbox", { name: "Drag the target in the picture" });
  await box.check();
  await page.getByRole("button", { name: "Side" }).click();
  await patiently(page, kCartesian, async () => {
    await page.waitForTimeout(300);
    const [x = NaN, y = NaN] = await gizmoHandle(page);
    await page.mouse.move(x, y);
    await page.waitForTimeout(200);
    await page.mouse.down();
    try {
      const from = (await stateOf(page)).arms[0]!.hand.position[2];
      await drag(page, [x, y], [x, y - 30]);
      await heldUntil(page, (state) => state.arms[0]!.hand.position[2]!, 0.02, from);
    } finally {
      await page.mouse.up();
    }
  });
  await assertStays(page);
  await droppedDrag(page);
  await box.uncheck();
}

// Another owner ends the drag: the rest of it moves neither the arm nor the view.
async function droppedDrag(page: Cockpit["page"]): Promise<void> {
  const camera = () => page.evaluate(() => window.cockpit.stage.camera.position.toArray());
  await patiently(page, kCartesian, async () => {
    await page.waitForTimeout(300);
    const before = await camera();
    const [x = NaN, y = NaN] = await gizmoHandle(page);
    await page.mouse.move(x, y);
    await page.waitForTimeout(200);
    await page.mouse.down();
    try {
      if (!(await page.evaluate(() => window.cockpit.held()))) throw new Late("the drag did not begin");
      await page.evaluate(() => window.cockpit.session.request("switch", { activate: ["left_hold"] }));
      await until(page, () => !window.cockpit.held());
      await drag(page, [x, y], [x, y - 60]);
    } finally {
      await page.mouse.up();
    }
    assert.deepEqual(await camera(), before);
    await drag(page, [x + 100, y], [x + 100, y - 60]); // no button is pressed
    assert.deepEqual(await camera(), before);
  });
}

async function hidden({ page }: Cockpit): Promise<void> {
  await patiently(page, kCartesian, () =>
    hold(page, up(page), async () => {
      await handMoves(page, 0, 2, 0.005);
      await page.evaluate(() => {
        Object.defineProperty(document, "visibilityState", { configurable: true, get: () => "hidden" });
        document.dispatchEvent(new Event("visibilitychange"));
      });
      await assertStays(page); // although the button is still pressed
      await page.evaluate(() => delete (document as { visibilityState?: unknown }).visibilityState);
      // A computer that came too late has let go before the tab was hidden.
      const said = page.locator(".toast p").filter({ hasText: /the tab was hidden|The run ended the hold/ });
      await said.first().waitFor();
      const why = await said.allTextContents();
      if (!why.some((text) => text.includes("the tab was hidden"))) throw new Late(why.join(" "));
    }),
  );
}

async function taken({ page }: Cockpit): Promise<void> {
  await patiently(page, kCartesian, () =>
    hold(page, up(page), async () => {
      await handMoves(page, 0, 2, 0.005);
      await up(page).evaluate((button) => button.releasePointerCapture(1));
      await assertStays(page);
    }),
  );
}

async function frozen({ page }: Cockpit): Promise<void> {
  await patiently(page, kCartesian, () =>
    hold(page, up(page), async () => {
      await handMoves(page, 0, 2, 0.005);
      // The main thread stands still for longer than the run waits for the next beat.
      const held = await page.evaluate(() => {
        const held = window.cockpit.held();
        const end = performance.now() + 600;
        while (performance.now() < end);
        return held;
      });
      if (!held) throw new Late("the hold had ended before the page stood still");
      await page.getByText("The run ended the hold", { exact: false }).first().waitFor({ timeout: kPatience });
      await assertStays(page);
    }),
  );
  await until(page, () => window.cockpit.session.state!.arms[0]!.controllet !== "left_cartesian");
}

async function closed({ page, context }: Cockpit, run: Run): Promise<void> {
  await patiently(page, kCartesian, () => hold(page, up(page), () => handMoves(page, 0, 2, 0.005), false));
  await context.close();
  const watcher = await open(run.url);
  await endsInHold(watcher.page);
  await watcher.context.close();
}

async function cut(run: Run): Promise<void> {
  const network = await Network.to(run.url);
  try {
    const { page, context } = await open(network.url);
    await takeControl(page);
    await patiently(page, kCartesian, () => hold(page, up(page), () => handMoves(page, 0, 2, 0.005), false));
    network.cut();
    const watcher = await open(run.url);
    await endsInHold(watcher.page);
    // The page notices by the silence: nobody closes a connection whose cable is out.
    await page.getByRole("status").getByText("lost").waitFor();
    await page.mouse.up();
    // A stop that cannot be sent now is sent when the network is back.
    await page.getByRole("button", { name: "Stop", exact: true }).click();
    await page.getByText("The stop may not have reached the run", { exact: false }).first().waitFor();
    assert.ok((await stateOf(watcher.page)).arms.every((arm) => !arm.stopped));
    network.repair();
    await until(watcher.page, () => window.cockpit.session.state!.arms.every((arm) => arm.stopped));
    await context.close();
    await watcher.context.close();
  } finally {
    network.end();
  }
}

async function endsInHold(page: Cockpit["page"]): Promise<void> {
  await until(page, () => window.cockpit.session.state!.arms[0]!.controllet !== "left_cartesian");
  await assertStays(page);
}
