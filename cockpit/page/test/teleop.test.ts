import assert from "node:assert/strict";
import { test } from "node:test";
import { Clutch, roomRotation } from "../src/teleop/clutch.ts";
import {
  axesRotation,
  forceLimited,
  jogged,
  jointsTowards,
  shaped,
  towards,
  withinLead,
  type JogLimits,
} from "../src/teleop/jog.ts";
import * as v from "../src/teleop/vectors.ts";

const near = (actual: readonly number[], expected: readonly number[], tolerance = 1e-9) => {
  assert.equal(actual.length, expected.length);
  actual.forEach((value, k) =>
    assert.ok(Math.abs(value - expected[k]!) <= tolerance, `${actual} is not ${expected} within ${tolerance}`),
  );
};
const limits: JogLimits = { speed_m_per_s: 0.1, turn_rad_per_s: 0.5, force_n: 20, lead_m: 0.05, lead_rad: 0.2 };
const at = (position: v.Vector3, quaternion: v.Quaternion = v.kIdentity): v.Pose => ({ position, quaternion });

let seed = 11;
const random = () => (seed = (seed * 48271) % 2147483647) / 2147483647;
const randomVector = (size: number): v.Vector3 => [0, 1, 2].map(() => (random() * 2 - 1) * size) as never;
const randomQuaternion = (): v.Quaternion => v.normalized([0, 1, 2, 3].map(() => random() * 2 - 1) as never);

test("exponential and logarithm are inverse, and rotation agrees with Rodrigues' formula", () => {
  for (let k = 0; k < 200; ++k) {
    const r = randomVector(1.7);
    near(v.logarithm(v.exponential(r)), r, 1e-9);
    const x = randomVector(3);
    const angle = v.norm(r);
    const axis = v.scale(r, 1 / angle);
    const expected = v.add(
      v.add(v.scale(x, Math.cos(angle)), v.scale(v.cross(axis, x), Math.sin(angle))),
      v.scale(axis, v.dot(axis, x) * (1 - Math.cos(angle))),
    );
    near(v.rotate(v.exponential(r), x), expected, 1e-9);
  }
});

test("in the camera's axes, away from the operator is where the camera looks, and up is the world's up", () => {
  const looking: v.Vector3 = [1, 0, -0.8]; // along the world's x, from above
  const axes = axesRotation("camera", looking, v.kIdentity, v.kIdentity);
  near(v.rotate(axes, [0, 1, 0]), [1, 0, 0]); // away
  near(v.rotate(axes, [1, 0, 0]), [0, -1, 0]); // right
  near(v.rotate(axes, [0, 0, 1]), [0, 0, 1]); // up
});

test("in the base's axes, away is the base's x; in the hand's axes, the hand's own", () => {
  const base = v.exponential([0, 0, 2]);
  near(v.rotate(axesRotation("base", [9, 9, 9], base, v.kIdentity), [0, 1, 0]), [Math.cos(2), Math.sin(2), 0]);
  const hand = randomQuaternion();
  near(axesRotation("hand", [9, 9, 9], base, hand), hand);
});

test("a stick at rest says nothing, its end says everything, and it is odd and monotonic", () => {
  assert.equal(shaped(0.1), 0);
  near([shaped(1), shaped(-1), shaped(2)], [1, -1, 1]);
  let last = -1;
  for (let x = -1; x <= 1; x += 0.01) {
    near([shaped(-x)], [-shaped(x)]);
    assert.ok(shaped(x) >= last - 1e-12);
    last = shaped(x);
  }
  assert.equal(shaped(NaN), 0);
});

test("a target moves with the limited speed, also on a diagonal", () => {
  let target = at([0, 0, 0]);
  for (let k = 0; k < 20; ++k) {
    const full = { linear: [1, 1, 1] as v.Vector3, angular: [0, 0, 1] as v.Vector3 };
    target = jogged(target, full, v.kIdentity, 0.01, target, v.kZero, limits);
  }
  near([v.norm(target.position)], [0.1 * 0.2], 1e-9);
  near(v.logarithm(target.quaternion), [0, 0, 0.5 * 0.2], 1e-9);
});

test("a long pause between two frames moves no farther than a tenth of a second does", () => {
  const full = { linear: [1, 0, 0] as v.Vector3, angular: v.kZero };
  near(jogged(at(v.kZero), full, v.kIdentity, 5, at(v.kZero), v.kZero, limits).position, [0.01, 0, 0]);
  near(jogged(at(v.kZero), full, v.kIdentity, -1, at(v.kZero), v.kZero, limits).position, [0, 0, 0]);
});

test("the target leads the hand by no more than the allowed distance and angle", () => {
  const hand = at([0.4, 0, 0.5], randomQuaternion());
  let target = hand;
  for (let k = 0; k < 1000; ++k) {
    const full = { linear: randomVector(5), angular: randomVector(5) };
    target = jogged(target, full, randomQuaternion(), 0.05, hand, v.kZero, limits);
    assert.ok(v.norm(v.subtract(target.position, hand.position)) <= limits.lead_m + 1e-12);
    const turn = v.logarithm(v.multiply(target.quaternion, v.conjugate(hand.quaternion)));
    assert.ok(v.norm(turn) <= limits.lead_rad + 1e-9);
  }
  near(withinLead(hand, hand, limits).position, hand.position);
});

test("a hand that presses with the limit is not pushed further, but may leave and slide", () => {
  const down: v.Vector3 = [0, 0, -20];
  near(forceLimited([0, 0, -1], down, 20), [0, 0, 0]);
  near(forceLimited([0, 0, 1], down, 20), [0, 0, 1]);
  near(forceLimited([1, 0, -1], down, 20), [1, 0, 0]);
  near(forceLimited([0, 0, -1], [0, 0, -15], 20), [0, 0, -0.5]); // halfway between half and all of it
  near(forceLimited([0, 0, -1], [0, 0, -10], 20), [0, 0, -1]);
});

test("a target goes to its goal with the limited speed and stays there", () => {
  const goal = at([0.03, -0.02, 0.04], v.exponential([0, 0.1, 0]));
  let target = at(v.kZero);
  const far = { ...limits, lead_m: 1, lead_rad: 3 };
  for (let t = 0; t < 1.0001; t += 0.016) {
    const before = target.position;
    target = jogged(target, towards(target, goal, 0.016, far), v.kIdentity, 0.016, target, v.kZero, far);
    assert.ok(v.norm(v.subtract(target.position, before)) <= 0.1 * 0.016 + 1e-12);
  }
  near(target.position, goal.position, 1e-9);
  near(v.logarithm(v.multiply(target.quaternion, v.conjugate(goal.quaternion))), [0, 0, 0], 1e-7);
});

test("joints go to their goal within the speed, and wait for an arm that is held back", () => {
  let target = [0, 0];
  for (let k = 0; k < 10; ++k) target = jointsTowards(target, [1, -0.05], target, 0.02, 0.5, 0.1);
  near(target, [0.1, -0.05]);
  for (let k = 0; k < 100; ++k) target = jointsTowards(target, [1, -0.05], [0, 0], 0.02, 0.5, 0.15);
  near(target, [0.15, -0.05]);
});

test("the operator's room: right is right, up is up, away is forward, at every heading", () => {
  for (const heading of [0, 0.7, -2]) {
    const forward: v.Vector3 = [Math.cos(heading), Math.sin(heading), 0];
    const room = roomRotation(heading);
    near(v.rotate(room, [0, 0, -1]), forward);
    near(v.rotate(room, [0, 1, 0]), [0, 0, 1]);
    near(v.rotate(room, [1, 0, 0]), v.cross(forward, [0, 0, 1]));
  }
});

test("closing the clutch does not move the target, and only relative motion counts, scaled", () => {
  for (let k = 0; k < 50; ++k) {
    const controller = at(randomVector(2), randomQuaternion());
    const hand = at(randomVector(1), randomQuaternion());
    const mapping = { scale: 0.1 + random() * 2, heading_rad: random() * 6 };
    const clutch = new Clutch();
    assert.equal(clutch.target(controller, mapping), undefined);
    clutch.close(controller, hand);
    const same = clutch.target(controller, mapping)!;
    near(same.position, hand.position, 1e-9);
    near(v.logarithm(v.multiply(same.quaternion, v.conjugate(hand.quaternion))), [0, 0, 0], 1e-7);

    const moved = at(v.add(controller.position, [0, 0, -0.2]), controller.quaternion); // away from the operator
    const forward: v.Vector3 = [Math.cos(mapping.heading_rad), Math.sin(mapping.heading_rad), 0];
    near(
      v.subtract(clutch.target(moved, mapping)!.position, hand.position),
      v.scale(forward, 0.2 * mapping.scale),
      1e-9,
    );

    // Turned about the operator's vertical by 0.3 rad, the hand turns about the world's vertical by the same.
    const turned = at(controller.position, v.multiply(v.exponential([0, 0.3, 0]), controller.quaternion));
    const turn = v.multiply(clutch.target(turned, mapping)!.quaternion, v.conjugate(hand.quaternion));
    near(v.logarithm(turn), [0, 0, 0.3], 1e-7);
  }
});
