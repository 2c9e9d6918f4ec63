import assert from "node:assert/strict";
import { test } from "node:test";
import { readPad, type PadLike } from "../src/teleop/gamepad.ts";
import { afterReport, kAtRest } from "../src/teleop/space_mouse.ts";

const bytes = (...list: number[]) => new DataView(Uint8Array.from(list).buffer);
// A report of six signed 16-bit numbers, as the device sends it.
const report = (...values: number[]) => {
  const view = new DataView(new ArrayBuffer(2 * values.length));
  values.forEach((value, k) => view.setInt16(2 * k, value, true));
  return view;
};

test("a six-axis report: the device's right, towards and down become right, away and up", () => {
  const state = afterReport(kAtRest, 1, report(350, -350, -175, 35, 70, -350));
  assert.deepEqual(state.deflection.linear, [1, 1, 0.5]);
  assert.deepEqual(state.deflection.angular, [0.1, -0.2, 1]);
});

test("older devices send translation and rotation in reports of their own", () => {
  let state = afterReport(kAtRest, 1, bytes(0x5e, 0x01, 0, 0, 0, 0)); // 0x015e = 350
  state = afterReport(state, 2, bytes(0, 0, 0, 0, 0xa2, 0xfe)); // 0xfea2 = -350
  assert.deepEqual(state.deflection, { linear: [1, 0, 0], angular: [0, 0, 1] });
  assert.deepEqual(afterReport(state, 1, report(0, 0, 0)).deflection.angular, [0, 0, 1]);
});

test("buttons are bits, from one to four bytes", () => {
  assert.equal(afterReport(kAtRest, 3, bytes(0b10)).buttons, 2);
  assert.equal(afterReport(kAtRest, 3, bytes(1, 0, 0, 0x80)).buttons, 0x80000001);
});

test("values beyond the end count as the end; unknown and cut reports change nothing", () => {
  assert.deepEqual(afterReport(kAtRest, 1, report(32767, 0, -32768)).deflection.linear, [1, 0, 1]);
  const state = afterReport(kAtRest, 1, report(350, 0, 0));
  for (const [id, data] of [
    [1, bytes(1, 2, 3)],
    [2, bytes()],
    [3, bytes()],
    [23, bytes(1, 2, 3, 4, 5, 6)],
  ] as const) {
    assert.deepEqual(afterReport(state, id, data), state);
  }
});

const pad = (axes: number[], pressed: number[] = [], connected = true): PadLike => ({
  connected,
  axes,
  buttons: Array.from({ length: 17 }, (_, k) => ({ pressed: pressed.includes(k), value: pressed.includes(k) ? 1 : 0 })),
});

test("a gamepad moves only with its right bumper held, and a lost one holds nothing", () => {
  assert.equal(readPad(pad([1, 0, 0, 0]), 1).held, false);
  assert.equal(readPad(pad([1, 0, 0, 0], [5]), 1).held, true);
  assert.equal(readPad(pad([1, 0, 0, 0], [5], false), 1).held, false);
  assert.equal(readPad(pad([], [1]), 1).stop, true);
});

test("one hand: left stick in the plane, triggers vertical, right stick turns", () => {
  const { first } = readPad(pad([1, -1, 0, 0], [7]), 1);
  assert.deepEqual(first.linear, [1, 1, 1]);
  const turned = readPad(pad([0, 0, -1, 0]), 1).first;
  assert.deepEqual(turned.angular, [0, 0, 1]); // stick to the left: counter-clockwise from above
  assert.deepEqual(turned.linear, [0, 0, 0]);
});

test("two hands: a stick each", () => {
  const { first, second } = readPad(pad([1, 0, 0, -1]), 2);
  assert.deepEqual(first.linear, [1, 0, 0]);
  assert.deepEqual(second.linear, [0, 1, 0]);
});
