// Converts an operator's deflection (a twist between -1 and 1) to a moving target of one hand: axes, speed
// limit, force limit, and the lead of the target over the hand.
import {
  add,
  conjugate,
  dot,
  exponential,
  limited,
  logarithm,
  multiply,
  norm,
  normalized,
  rotate,
  scale,
  subtract,
  type Pose,
  type Quaternion,
  type Vector3,
} from "./vectors.ts";

/** Deflections of a device, each -1 to 1: x right, y away from the operator, z up; rotations about the same axes. */
export interface Deflection {
  linear: Vector3;
  angular: Vector3;
}

export type JogAxes = "camera" | "base" | "hand";

export interface JogLimits {
  speed_m_per_s: number;
  turn_rad_per_s: number;
  /** Above this force the target does not press further [N]. */
  force_n: number;
  /** Largest distance of the target ahead of the hand. */
  lead_m: number;
  lead_rad: number;
}

/**
 * Rotation from the device's axes to the world's. The camera counts by its heading only, so that "up" on the device is
 * up in the world however the view is tilted. In the base's axes, away from the operator is the base's x.
 */
export function axesRotation(axes: JogAxes, view: Vector3, base: Quaternion, hand: Quaternion): Quaternion {
  if (axes === "hand") return hand;
  const [x, y] = axes === "base" ? rotate(base, [1, 0, 0]) : view;
  // The device's y points away from the operator; at zero heading this is the world's y.
  const heading = Math.atan2(y, x) - Math.PI / 2;
  return exponential([0, 0, heading]);
}

/** Removes the dead zone of a stick and bends the rest: fine near the middle, full speed at the end. */
export function shaped(value: number, deadZone = 0.12, exponent = 1.7): number {
  const size = Math.min(1, Math.abs(value));
  if (!(size > deadZone)) return 0;
  return Math.sign(value) * ((size - deadZone) / (1 - deadZone)) ** exponent;
}

/**
 * Removes the part of a velocity that would press further where the hand already presses with `force_n` or more; between half and all of the limit it fades. `force` is what the arm exerts on its surroundings [N].
 */
export function forceLimited(velocity: Vector3, force: Vector3, limit: number): Vector3 {
  const pressed = norm(force);
  if (!(pressed > limit / 2)) return velocity;
  const direction = scale(force, 1 / pressed);
  const into = dot(velocity, direction);
  if (into <= 0) return velocity;
  const share = Math.min(1, (pressed - limit / 2) / (limit / 2));
  return subtract(velocity, scale(direction, into * share));
}

/** The target after `dt` seconds. `hand` is the hand's pose, `force` the force that it exerts, both in world axes. */
export function jogged(
  target: Pose,
  deflection: Deflection,
  axes: Quaternion,
  dt: number,
  hand: Pose,
  force: Vector3,
  limits: JogLimits,
): Pose {
  const step = Math.max(0, Math.min(dt, 0.1));
  const linear = scale(rotate(axes, limited(deflection.linear, 1)), limits.speed_m_per_s);
  const angular = scale(rotate(axes, limited(deflection.angular, 1)), limits.turn_rad_per_s);
  const moved: Pose = {
    position: add(target.position, scale(forceLimited(linear, force, limits.force_n), step)),
    quaternion: normalized(multiply(exponential(scale(angular, step)), target.quaternion)),
  };
  return withinLead(moved, hand, limits);
}

/** Keeps a target near the hand, so that a blocked hand accumulates no long path. */
export function withinLead(target: Pose, hand: Pose, limits: JogLimits): Pose {
  const ahead = limited(subtract(target.position, hand.position), limits.lead_m);
  const turn = logarithm(multiply(target.quaternion, conjugate(hand.quaternion)));
  const turned = limited(turn, limits.lead_rad);
  return {
    position: add(hand.position, ahead),
    quaternion: turned === turn ? target.quaternion : normalized(multiply(exponential(turned), hand.quaternion)),
  };
}

/** The deflection that moves a target to a goal within the limits, in world axes: full until the last step. */
export function towards(target: Pose, goal: Pose, dt: number, limits: JogLimits): Deflection {
  const step = Math.max(1e-3, Math.min(dt, 0.1));
  const turn = logarithm(multiply(goal.quaternion, conjugate(target.quaternion)));
  return {
    linear: limited(scale(subtract(goal.position, target.position), 1 / (limits.speed_m_per_s * step)), 1),
    angular: limited(scale(turn, 1 / (limits.turn_rad_per_s * step)), 1),
  };
}

/** Joints moving to `goal`, each within `speed` and at most `lead` ahead of its position. */
export function jointsTowards(
  target: readonly number[],
  goal: readonly number[],
  actual: ArrayLike<number>,
  dt: number,
  speed: number,
  lead: number,
): number[] {
  const most = speed * Math.max(0, Math.min(dt, 0.1));
  return target.map((from, k) => {
    const to = from + Math.max(-most, Math.min(most, (goal[k] ?? from) - from));
    const at = actual[k] ?? from;
    return Math.max(at - lead, Math.min(at + lead, to));
  });
}
