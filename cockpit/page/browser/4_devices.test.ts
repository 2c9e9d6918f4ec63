// Devices by replayed reports: a gamepad, a SpaceMouse over WebHID, a headset by an emulator.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { after, afterEach, before, suite, test, type TestContext } from "node:test";
import {
  atRest,
  handMoves,
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

declare global {
  /** What the replayed devices are led by. */
  interface Window {
    pad: { axes: number[]; buttons: { pressed: boolean; value: number }[]; connected: boolean };
    report(id: number, bytes: number[]): void;
    headset: {
      controllers: {
        right: {
          position: { set(x: number, y: number, z: number): void };
          updateButtonValue(id: string, value: number): void;
        };
      };
    };
  }
}

const devices = (backend: string) => () => {
  let run: Run;
  before(async () => (run = await Run.idle("two_arms", "--backend", backend)));
  // What a test that failed has left in control would keep it from the next ones.
  afterEach(() => run.closePages());
  after(() => run.end());

  async function lead(before: string | (() => void)): Promise<Cockpit> {
    const cockpit = await open(run.url, { before });
    await takeControl(cockpit.page);
    return cockpit;
  }

  const moves = (t: TestContext, page: Cockpit["page"], owners: string | string[], act: () => Promise<void>) =>
    unlessTooSlow(t, page, () => patiently(page, owners, act));
  const hand = async ({ page }: Cockpit, arm: number) => (await stateOf(page)).arms[arm]!.hand.position;
  async function leave({ page, context }: Cockpit): Promise<void> {
    await atRest(page);
    await page.getByRole("button", { name: "Give up control" }).click();
    await context.close();
  }

  test("a gamepad leads one hand while its bumper is held, then two hands", async (t) => {
    const cockpit = await lead(() => {
      const pad = {
        id: "Test pad",
        index: 0,
        connected: true,
        mapping: "standard",
        axes: [0, 0, 0, 0],
        buttons: Array.from({ length: 17 }, () => ({ pressed: false, touched: false, value: 0 })),
      };
      Object.assign(window, { pad });
      navigator.getGamepads = () => [pad as never, null, null, null];
    });
    const { page } = cockpit;
    const set = (axes: number[], bumper: boolean, trigger = 0) =>
      page.evaluate(
        ([axes, bumper, trigger]) => {
          const { pad } = window;
          pad.axes = axes as number[];
          pad.buttons[5]!.pressed = bumper as boolean;
          pad.buttons[7]!.value = trigger as number;
        },
        [axes, bumper, trigger] as const,
      );
    await page.getByRole("checkbox", { name: "Gamepad", exact: true }).check();
    await page.getByText("Test pad").waitFor();
    const from = await hand(cockpit, 0);
    await set([0, 0, 0, 0], false, 1); // without the bumper nothing moves
    await page.waitForTimeout(300);
    assert.ok(Math.abs((await hand(cockpit, 0))[2] - from[2]) < 1e-3);
    await moves(t, page, "left_cartesian", async () => {
      await set([0, 0, 0, 0], true, 1);
      await handMoves(page, 0, 2, 0.01).finally(() => set([0, 0, 0, 0], false, 1));
    });
    await atRest(page);

    await page.getByRole("checkbox", { name: "Gamepad: each stick moves a hand" }).check();
    await page.getByRole("radio", { name: "Base" }).check();
    await moves(t, page, ["left_cartesian", "right_cartesian"], async () => {
      await set([0, -1, 0, -1], true); // both sticks away from the operator: along the bases' x
      await Promise.all([handMoves(page, 0, 0, 0.01), handMoves(page, 1, 0, 0.01)]).catch(async (error) => {
        await set([0, 0, 0, 0], false);
        throw error;
      });
    });
    // A pad that is unplugged holds nothing.
    await page.evaluate(() => {
      window.pad.connected = false;
      window.dispatchEvent(new Event("gamepaddisconnected"));
    });
    await leave(cockpit);
  });

  test("a SpaceMouse over WebHID leads the hand by its reports", async (t) => {
    const cockpit = await lead(() => {
      const device = Object.assign(new EventTarget(), {
        productName: "Test SpaceMouse",
        vendorId: 0x256f,
        opened: false,
        open: async () => void (device.opened = true),
      });
      const hid = Object.assign(new EventTarget(), {
        requestDevice: async () => [device],
        getDevices: async () => [],
      });
      Object.defineProperty(navigator, "hid", { value: hid });
      const send = (id: number, bytes: number[]) =>
        device.dispatchEvent(
          Object.assign(new Event("inputreport"), {
            reportId: id,
            data: new DataView(Uint8Array.from(bytes).buffer),
          }),
        );
      let cap: number[] = [];
      setInterval(() => cap.length && send(1, cap), 10); // a deflected cap reports all the time
      Object.assign(window, {
        report: (id: number, bytes: number[]) => {
          if (id === 1) cap = bytes;
          send(id, bytes);
        },
      });
    });
    const { page } = cockpit;
    const report = (id: number, ...bytes: number[]) =>
      page.evaluate(([id, bytes]) => window.report(id as number, bytes as number[]), [id, bytes] as const);
    await page.getByRole("checkbox", { name: "SpaceMouse", exact: true }).check();
    await page.getByRole("button", { name: "Choose device" }).click();
    await page.getByText("Test SpaceMouse").waitFor();
    const from = await hand(cockpit, 0);
    await report(1, 0, 0, 0, 0, 0xa2, 0xfe); // the cap is lifted: z is -350 on the device
    await page.waitForTimeout(300);
    assert.ok(Math.abs((await hand(cockpit, 0))[2] - from[2]) < 1e-3, "it moved without its button");
    await moves(t, page, "left_cartesian", async () => {
      await report(3, 1);
      await handMoves(page, 0, 2, 0.01).finally(() => report(3, 0));
    });
    await leave(cockpit);
  });

  test("a headset's controller leads the hand while it is squeezed", async (t) => {
    const emulator = readFileSync(createRequire(import.meta.url).resolve("iwer/build/iwer.js"), "utf8");
    const cockpit = await lead(`${emulator};
  delete Navigator.prototype.xr;
  const headset = new IWER.XRDevice(IWER.metaQuest3);
  headset.installRuntime();
  window.headset = headset;
  // The emulator calls all its poses emulated; a headset says so where it has lost a controller.
  Object.defineProperty(XRPose.prototype, "emulatedPosition", { get: () => window.lost ?? false });`);
    const { page } = cockpit;
    await page.getByRole("button", { name: "Enter or leave the headset" }).click();
    await until(page, () => window.cockpit.stage.renderer.xr.isPresenting);
    const move = (y: number, squeeze: number) =>
      page.evaluate(
        ([y, squeeze]) => {
          const right = window.headset.controllers.right;
          right.position.set(0.2, y!, -0.3);
          right.updateButtonValue("squeeze", squeeze!);
        },
        [y, squeeze],
      );
    await move(1.0, 0);
    await page.waitForTimeout(300);
    const from = await hand(cockpit, 0);
    await move(1.05, 0); // moved without squeezing: nothing
    await page.waitForTimeout(300);
    assert.ok(Math.abs((await hand(cockpit, 0))[2] - from[2]) < 1e-3);
    await moves(t, page, "left_cartesian", async () => {
      await move(1.05, 1);
      await until(page, () => window.cockpit.held());
      await move(1.1, 1);
      await handMoves(page, 0, 2, 0.02).finally(() => move(1.1, 0));
    });
    await atRest(page);
    const arrived = await hand(cockpit, 0);
    await move(1.5, 0);
    await page.waitForTimeout(300);
    assert.ok(Math.abs((await hand(cockpit, 0))[2] - arrived[2]) < 2e-3);
    // A controller that is not seen any more is let go, and holds nothing when it is seen again.
    await moves(t, page, "left_cartesian", async () => {
      await move(1.5, 1);
      await until(page, () => window.cockpit.held());
      await page.evaluate(() => Object.assign(window, { lost: true }));
      await until(page, () => !window.cockpit.held());
      await page.evaluate(() => Object.assign(window, { lost: false }));
      await page.waitForTimeout(300);
      assert.equal(await page.evaluate(() => window.cockpit.held()), false);
      await move(1.5, 0);
    });
    await cockpit.context.close();
  });
};

for (const backend of kBackends) suite(`devices lead ${backend} arms`, devices(backend));
