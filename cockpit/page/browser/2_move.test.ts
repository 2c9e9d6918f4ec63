// Moving an arm: every device moves it only while it is held, and everything that ends a hold stops it.
import assert from "node:assert/strict";
import { test } from "node:test";
import {
  atRest,
  hold,
  handMoves,
  kPatience,
  open,
  Run,
  stateOf,
  takeControl,
  until,
  type Cockpit,
  type Window_,
} from "./support.ts";

for (const backend of ["mujoco", "virtual"]) {
  test(`${backend} arms`, async (t) => {
    const run = await Run.idle("two_arms", "--backend", backend);
    try {
      const cockpit = await open(run.url);
      await takeControl(cockpit.page);
      await t.test("jog by a button, held by the mouse", () => byMouse(cockpit));
      await t.test("jog by a button, held by a key", () => byKey(cockpit));
      await t.test("jog by the keyboard", () => byKeyboard(cockpit));
      await t.test("a joint by its slider", () => byJoint(cockpit));
      await t.test("the target is dragged in the picture", () => byGizmo(cockpit));
      await t.test("a hidden tab lets go", () => hidden(cockpit));
      await t.test("a pointer that the browser takes lets go", () => taken(cockpit));
      await t.test("a page that stands still is let go by the run", () => frozen(cockpit));
      await t.test("a page that is closed in mid motion leaves the arm held", () => closed(cockpit, run));
    } finally {
      await run.end();
    }
  });
}

const up = (page: Cockpit["page"]) => page.getByRole("button", { name: "Move up while held" });
const z = async (page: Cockpit["page"]) => (await stateOf(page)).arms[0]!.hand.position[2];

// After letting go, an arm may brake for as long as the limits take; then it stays.
async function assertStays(page: Cockpit["page"]): Promise<void> {
  await atRest(page);
  const from = (await stateOf(page)).arms[0]!.hand.position;
  await page.waitForTimeout(400);
  const to = (await stateOf(page)).arms[0]!.hand.position;
  const moved = Math.hypot(...to.map((x, k) => x - from[k]!));
  assert.ok(moved < 2e-3, `it moved by ${(1000 * moved).toFixed(1)} mm after it was let go`);
}

async function byMouse({ page }: Cockpit): Promise<void> {
  await page.getByRole("tab", { name: "Move" }).click();
  const from = await z(page);
  await hold(page, up(page), () => handMoves(page, 0, 2, from, 0.02));
  await assertStays(page);
  // The controllet is still active: the next hold needs no switch.
  assert.equal((await stateOf(page)).arms[0]!.controllet, "left_cartesian");
}

async function byKey({ page }: Cockpit): Promise<void> {
  const from = await z(page);
  await page.getByRole("button", { name: "Move down while held" }).focus();
  await page.keyboard.down("Space");
  await handMoves(page, 0, 2, from, -0.01);
  await page.keyboard.up("Space");
  await assertStays(page);
}

async function byKeyboard({ page }: Cockpit): Promise<void> {
  const box = page.getByRole("checkbox", { name: "Keyboard" });
  await box.check();
  const from = await z(page);
  await page.keyboard.down("KeyR");
  await handMoves(page, 0, 2, from, 0.01);
  await page.keyboard.up("KeyR");
  await assertStays(page);
  await box.uncheck();
}

async function activate(page: Cockpit["page"], name: string): Promise<void> {
  await page.getByRole("tab", { name: "Laws" }).click();
  await page.getByRole("button", { name: `Activate ${name}` }).click();
  await until(page, (name) => (window as never as Window_).cockpit.session.state.arms[0]!.controllet === name, name);
  await page.getByRole("tab", { name: "Move" }).click();
}

async function byJoint({ page }: Cockpit): Promise<void> {
  await activate(page, "left_joint");
  await page.locator("summary", { hasText: "Joints" }).click();
  const slider = page.getByRole("slider", { name: "Joint 1" });
  const from = Number((await stateOf(page)).arms[0]!.q[0]);
  await slider.scrollIntoViewIfNeeded();
  await page.waitForTimeout(300); // the slider follows the joint
  const box = (await slider.boundingBox())!;
  await page.mouse.move(box.x + box.width / 2 + 1, box.y + box.height / 2);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width * 0.6, box.y + box.height / 2, { steps: 4 });
  await until(
    page,
    (from) => Number((window as never as Window_).cockpit.session.state.arms[0]!.q[0]) > from + 0.05,
    from,
  );
  await page.mouse.up();
  await assertStays(page);
  await page.locator("summary", { hasText: "Joints" }).click();
  await activate(page, "left_cartesian");
}

async function byGizmo({ page }: Cockpit): Promise<void> {
  const box = page.getByRole("checkbox", { name: "Drag the target in the picture" });
  await box.check();
  await page.getByRole("button", { name: "Side" }).click();
  await page.waitForTimeout(300);
  const from = await z(page);
  // The handle of the vertical axis is a way above the target on the screen.
  const at = await page.evaluate(() => {
    const { stage, session } = (
      window as never as { cockpit: { stage: StageLike; session: Window_["cockpit"]["session"] } }
    ).cockpit;
    const p = session.state.arms[0]!.hand.position;
    const { camera, renderer } = stage;
    const v = camera.position
      .clone()
      .set(p[0], p[1], p[2] + 0.25)
      .project(camera);
    const { left, top, width, height } = renderer.domElement.getBoundingClientRect();
    return [left + ((v.x + 1) / 2) * width, top + ((1 - v.y) / 2) * height];
  });
  await page.mouse.move(at[0]!, at[1]!);
  await page.waitForTimeout(200);
  await page.mouse.down();
  try {
    await page.mouse.move(at[0]!, at[1]! - 25, { steps: 5 });
    await handMoves(page, 0, 2, from, 0.01);
  } finally {
    await page.mouse.up();
  }
  await assertStays(page);
  await box.uncheck();
}

interface StageLike {
  camera: {
    position: {
      clone(): { set(x: number, y: number, z: number): { project(camera: unknown): { x: number; y: number } } };
    };
  };
  renderer: { domElement: HTMLCanvasElement };
}

async function hidden({ page }: Cockpit): Promise<void> {
  const from = await z(page);
  await hold(page, up(page), async () => {
    await handMoves(page, 0, 2, from, 0.005);
    await page.evaluate(() => {
      Object.defineProperty(document, "visibilityState", { configurable: true, get: () => "hidden" });
      document.dispatchEvent(new Event("visibilitychange"));
    });
    await assertStays(page); // although the button is still pressed
    await page.evaluate(() => delete (document as { visibilityState?: unknown }).visibilityState);
  });
  await page.getByText("the tab was hidden", { exact: false }).first().waitFor();
}

async function taken({ page }: Cockpit): Promise<void> {
  const from = await z(page);
  await hold(page, up(page), async () => {
    await handMoves(page, 0, 2, from, 0.005);
    await up(page).evaluate((button) => button.releasePointerCapture(1));
    await assertStays(page);
  });
}

async function frozen({ page }: Cockpit): Promise<void> {
  const from = await z(page);
  await hold(page, up(page), async () => {
    await handMoves(page, 0, 2, from, 0.005);
    // The main thread stands still for longer than the run waits for the next beat.
    await page.evaluate(() => {
      const end = performance.now() + 600;
      while (performance.now() < end);
    });
    await page.getByText("The run ended the hold", { exact: false }).first().waitFor({ timeout: kPatience });
    await assertStays(page);
  });
  await until(page, () => (window as never as Window_).cockpit.session.state.arms[0]!.controllet !== "left_cartesian");
  await activate(page, "left_cartesian");
}

async function closed({ page, context }: Cockpit, run: Run): Promise<void> {
  const watcher = await open(run.url);
  const from = await z(page);
  await hold(page, up(page), () => handMoves(page, 0, 2, from, 0.005), false);
  await context.close();
  await until(watcher.page, () => {
    const { state, control } = (window as never as Window_).cockpit.session;
    return !control.taken && state.arms[0]!.controllet !== "left_cartesian";
  });
  await assertStays(watcher.page);
  await watcher.context.close();
}
