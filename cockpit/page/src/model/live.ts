// The page's knowledge of the scene and its newest state, live or from a recorded log.
import type { Shape } from "../scene3d/shapes.ts";
import type { Pose, Vector3 } from "../teleop/vectors.ts";
import type { WireArm } from "../wire/hello.ts";

export interface ArmInfo extends WireArm {
  base: Pose;
}

/** A rigid body that is drawn: a link, a tool, an object. */
export interface BodyInfo {
  name: string;
  /** Index of the arm that it belongs to. */
  arm?: number;
  /** It can be placed and pushed. */
  movable?: boolean;
  shapes: Shape[];
  /** Pose until the state says otherwise. */
  pose: Pose;
}

export interface SceneInfo {
  name: string;
  description: string;
  simulated: boolean;
  arms: ArmInfo[];
  bodies: BodyInfo[];
}

export interface Connection {
  received: number;
  lost: number;
  late: number;
  success: number;
}

export interface Gripper {
  width_m: number;
  max_width_m: number;
  grasped: boolean;
  moving: boolean;
}

export interface ArmState {
  controllet: string;
  mode: string;
  stopped: boolean;
  q: ArrayLike<number>;
  tau_cmd: ArrayLike<number>;
  hand: Pose;
  /** Reference point of wrenches. */
  wrenchAt: ArrayLike<number>;
  /** Wrench of the arm on its environment: estimated, and from the simulation's contacts [N, N m]. */
  wrench: ArrayLike<number> | undefined;
  contact: ArrayLike<number> | undefined;
  errors: string[];
  reason: string;
  cures: { error: string; cure: string }[];
  age_s: number;
  interventions: number;
  lastIntervention: string;
  removedBy: string;
  manipulability: number | undefined;
  /** Distance to the set-point, in `trackingUnit` ("m", "rad"). */
  tracking: number | undefined;
  trackingUnit: string;
  connection: Connection | undefined;
  gripper: Gripper | undefined;
  /** Any quantity by its name in shared records, such as joint_collision; undefined if the run does not send it. */
  quantity(name: string): ArrayLike<number> | undefined;
}

/** A set-point of an input, in world coordinates. */
export interface ReferenceState {
  controllet: string;
  input: string;
  quantity: string;
  values: ArrayLike<number>;
}

/** One or more numbers that a controllet reports. */
export interface OutputState {
  controllet: string;
  name: string;
  values: ArrayLike<number>;
}

/** Two parts that are close to one another. */
export interface Nearness {
  from: Vector3;
  to: Vector3;
  distance_m: number;
}

export interface LiveState {
  cycle: number;
  t_s: number;
  /** When the run sent it: Unix time of its computer [ms]. */
  sent_ms: number;
  /** Age of the cycle when it was sent [s]. */
  since_s: number;
  rate_hz: number;
  cycle_us: number;
  overruns: number;
  /** Number of stops so far, of which a resume says which the person has seen. */
  stops: number | undefined;
  paused: boolean;
  arms: ArmState[];
  /** Poses of the bodies, seven numbers each: x y z qw qx qy qz. */
  bodies: ArrayLike<number>;
  references: ReferenceState[];
  outputs: OutputState[];
  near: Nearness[];
}

export function poseAt(values: ArrayLike<number>, offset = 0): Pose {
  const at = (k: number) => values[offset + k] ?? NaN;
  return { position: [at(0), at(1), at(2)], quaternion: [at(3), at(4), at(5), at(6)] };
}

/** Joints, counted from 1, whose flag is set. */
export function flagged(state: ArmState, name: string): number[] {
  return Array.from(state.quantity(name) ?? [], (flag, k) => (flag > 0 ? k + 1 : 0)).filter((joint) => joint > 0);
}

/** The fraction of the largest torque in use, 0 to 1, and its joint. */
export function torqueUse(arm: ArmInfo, state: ArmState): { share: number; joint: number } {
  let [share, joint] = [0, 0];
  for (let k = 0; k < arm.joints; ++k) {
    const use = Math.abs(state.tau_cmd[k] ?? 0) / (arm.tau_max_nm[k] ?? Infinity);
    if (use > share) [share, joint] = [use, k];
  }
  return { share, joint };
}

/** Distance of the nearest joint from an end of its range, as a fraction of the range, 0 to 0.5. */
export function limitMargin(arm: ArmInfo, state: ArmState): { share: number; joint: number } {
  let [share, joint] = [0.5, 0];
  for (let k = 0; k < arm.joints; ++k) {
    const [low = 0, high = 0, q = 0] = [arm.q_min_rad[k], arm.q_max_rad[k], state.q[k]];
    const margin = Math.min(q - low, high - q) / (high - low);
    if (margin < share) [share, joint] = [margin, k];
  }
  return { share: Math.max(0, share), joint };
}
