// From the numbers of a state to what the panels show: every quantity of an arm is there by name.
import assert from "node:assert/strict";
import { test } from "node:test";
import { flagged } from "../src/model/live.ts";
import { type Hello, sceneOf } from "../src/wire/hello.ts";
import { StateReader } from "../src/wire/state_reader.ts";

const arm = { kind: "simulated", joints: 3, base_position_m: [], base_quaternion_wxyz: [] };
const limits = { q_min_rad: [], q_max_rad: [], tau_max_nm: [] };
const fields: [string, number][] = [
  ["cycle", 1],
  ["left/q_rad", 3],
  ["right/q_rad", 3],
  ["right/joint_collision", 3],
  ["right/a_new_quantity", 2],
];
const hello = {
  scene: { arms: ["left", "right"].map((name) => ({ ...arm, ...limits, name })), bodies: [] },
  list: { controllets: [] },
  state_fields: fields,
  names: { modes: [], controllets: [], errors: [], interventions: [] },
} as unknown as Hello;

test("quantities of an arm are found by name, also those that no panel knows", () => {
  const reader = new StateReader(hello, sceneOf(hello));
  assert.equal(reader.numbers, 12);
  const state = reader.read(Float64Array.from([7, 1, 2, 3, 4, 5, 6, 1, 0, 1, 8, 9]));
  const [left, right] = state.arms;
  assert.deepEqual(Array.from(right!.q), [4, 5, 6]);
  assert.deepEqual(Array.from(right!.quantity("a_new_quantity")!), [8, 9]);
  assert.equal(left!.quantity("a_new_quantity"), undefined);
  assert.deepEqual(flagged(right!, "joint_collision"), [1, 3]);
  assert.deepEqual(flagged(left!, "joint_collision"), []);
});
