import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import type { WebGLRenderer } from "three";
import { Holding, type Motion } from "../src/safety/holding.ts";
import { Headset } from "../src/teleop/headset.ts";
import { SpaceMouse } from "../src/teleop/space_mouse.ts";

// A window without a browser: what the gate and the devices ask of it.
const target = new EventTarget();
let focused = true;
const device = Object.assign(new EventTarget(), { productName: "test", opened: true });
const hid = Object.assign(new EventTarget(), { requestDevice: async () => [device] });
const globals = {
  addEventListener: target.addEventListener.bind(target),
  document: Object.assign(new EventTarget(), { visibilityState: "visible", hasFocus: () => focused }),
  navigator: { hid },
};
for (const [name, value] of Object.entries(globals))
  Object.defineProperty(globalThis, name, { value, configurable: true });

let begun = 0;
const motion: Motion = { begin: () => void ++begun, step: () => undefined, end: () => {} };
const holdingOf = () => new Holding({ beat: () => {}, release: () => {} }, () => {});
const mouseOf = async (holding: Holding) => {
  const nothing = () => {};
  const mouse = new SpaceMouse(holding, () => motion, nothing, nothing);
  await mouse.choose();
  return mouse;
};
const report = (x: number) => {
  const data = new DataView(new ArrayBuffer(12));
  data.setInt16(0, x, true);
  device.dispatchEvent(Object.assign(new Event("inputreport"), { reportId: 1, data }));
};

beforeEach(() => {
  begun = 0;
  focused = true;
});

test("a SpaceMouse's reports do not renew a hold that the window has ended: its cap must spring back first", async () => {
  const holding = holdingOf();
  const mouse = await mouseOf(holding);
  mouse.enabled = mouse.capHolds = true;
  report(300);
  assert.equal(begun, 1);
  target.dispatchEvent(new Event("blur"));
  for (let k = 0; k < 10; ++k) report(300);
  assert.deepEqual([begun, holding.held], [1, false]);
  report(0);
  focused = false; // the reports go on for another program
  report(300);
  assert.equal(begun, 1);
  focused = true;
  report(0);
  report(300);
  assert.equal(begun, 2);
});

test("a SpaceMouse out of reach is let go, although its button was never told to be up", async (t) => {
  let now = 1000;
  t.mock.method(performance, "now", () => now);
  const holding = holdingOf();
  const mouse = await mouseOf(holding);
  mouse.enabled = true;
  const button = new DataView(Uint8Array.of(1).buffer);
  device.dispatchEvent(Object.assign(new Event("inputreport"), { reportId: 3, data: button }));
  for (let k = 0; k < 20; ++k, now += 50) {
    report(300);
    holding.frame(now);
  }
  assert.ok(holding.held);
  const battery = new DataView(Uint8Array.of(50).buffer);
  for (let k = 0; k < 4; ++k, now += 50) {
    device.dispatchEvent(Object.assign(new Event("inputreport"), { reportId: 23, data: battery }));
    holding.frame(now);
  }
  assert.ok(!holding.held);
});

test("the command key ends every hold, since macOS tells no release of a key beside it", () => {
  const holding = holdingOf();
  assert.ok(holding.begin("keyboard", () => true, motion));
  target.dispatchEvent(Object.assign(new Event("keydown"), { metaKey: false }));
  assert.ok(holding.held);
  target.dispatchEvent(Object.assign(new Event("keydown"), { metaKey: true }));
  assert.equal(holding.held, false);
});

test("a button is not held by a key beside the command key", () => {
  const holding = holdingOf();
  const classList = { add: () => {}, remove: () => {} };
  const button = Object.assign(new EventTarget(), { classList }) as unknown as HTMLElement;
  holding.bindButton(button, "jog", motion);
  const press = (metaKey: boolean) => {
    const event = Object.assign(new Event("keydown"), { key: "Enter", repeat: false, metaKey });
    target.dispatchEvent(Object.assign(new Event("keydown"), { metaKey }));
    button.dispatchEvent(event);
  };
  press(true);
  assert.equal(begun, 0);
  press(false);
  assert.equal(begun, 1);
});

test("a headset's controller that is not reported any more holds nothing", () => {
  const holding = holdingOf();
  const hooks = { motion: () => motion, stop: () => {}, ended: () => {} };
  const headset = new Headset({} as WebGLRenderer, holding, hooks);
  const buttons = [{ pressed: false }, { pressed: true }];
  const source = { handedness: "right", gamepad: { buttons }, gripSpace: {} };
  const transform = { position: { x: 0, y: 0, z: 0 }, orientation: { x: 0, y: 0, z: 0, w: 1 } };
  const frame = { getPose: () => ({ transform, emulatedPosition: false }) } as unknown as XRFrame;
  const see = (...inputSources: unknown[]) => {
    headset.session = { inputSources } as unknown as XRSession;
    headset.frame(frame, {} as XRReferenceSpace);
    holding.frame(performance.now());
  };
  see(source);
  assert.ok(holding.held);
  see(source);
  assert.ok(holding.held);
  see();
  assert.equal(holding.held, false);
});

test("a motion that cannot go on ends its hold, and says why", () => {
  const said: string[] = [];
  const holding = new Holding({ beat: () => {}, release: () => {} }, (why) => said.push(why));
  let why: string | undefined;
  holding.begin("button", () => true, { ...motion, step: () => why });
  holding.frame(performance.now());
  assert.ok(holding.held);
  why = "'left_hold' leads left now";
  holding.frame(performance.now());
  assert.ok(!holding.held);
  assert.deepEqual(said, ["Let go: 'left_hold' leads left now."]);
});
