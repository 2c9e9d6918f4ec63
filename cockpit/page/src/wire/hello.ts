// What the run says at the beginning, and the scene made of it.
import type { ControlletInfo } from "../model/description.ts";
import type { SceneInfo } from "../model/live.ts";
import type { Shape } from "../scene3d/shapes.ts";
import type { Pose, Quaternion, Vector3 } from "../teleop/vectors.ts";
import type { FieldList } from "./binary.ts";

interface WirePose {
  position_m: number[];
  quaternion_wxyz: number[];
}

interface WireArm {
  name: string;
  model: string;
  title?: string;
  kind: string;
  joints: number;
  base_position_m: number[];
  base_quaternion_wxyz: number[];
  q_min_rad: number[];
  q_max_rad: number[];
  dq_max_rad_per_s: number[];
  tau_max_nm: number[];
  gripper?: unknown;
  vacuum?: unknown;
  workspace?: { min_m: number[]; max_m: number[] } | null;
}

interface WireShape extends WirePose {
  kind: Shape["kind"];
  size_m: number[];
  color_rgba: number[];
}

interface WireBody extends WirePose {
  name: string;
  arm?: number | string;
  object?: string;
  movable?: boolean;
  shapes: WireShape[];
}

export interface WireEvent {
  cycle: number;
  t_s: number;
  kind: string;
  arm: string;
  text: string;
}

export interface WireLog {
  name: string;
  t_from_s: number;
  t_to_s: number;
  events: WireEvent[];
}

export interface Hello {
  wire: number;
  version: string;
  kind: "run" | "virtual_arm" | "log";
  client: number;
  scene: {
    name: string;
    description: string;
    simulated: boolean;
    arms: WireArm[];
    bodies: WireBody[];
  };
  list: { controllets: ControlletInfo[] };
  state_fields: FieldList;
  record_fields: FieldList;
  names: { modes: string[]; controllets: string[]; errors: string[]; interventions: string[] };
  control: WireControl;
  commands: string[];
  logs?: WireLog[];
}

export interface WireControl {
  holder: number | null;
  mine: boolean;
  requests: number[];
  watchers: number;
}

export const kWire = 1;

const vector = (v: number[]): Vector3 => [v[0] ?? 0, v[1] ?? 0, v[2] ?? 0];
const quaternion = (q: number[]): Quaternion => [q[0] ?? 1, q[1] ?? 0, q[2] ?? 0, q[3] ?? 0];
const pose = (p: WirePose): Pose => ({ position: vector(p.position_m), quaternion: quaternion(p.quaternion_wxyz) });

export function sceneOf({ scene }: Hello): SceneInfo {
  const index = (arm: number | string | undefined) =>
    typeof arm === "string" ? scene.arms.findIndex((one) => one.name === arm) : arm;
  return {
    name: scene.name,
    description: scene.description,
    simulated: scene.simulated,
    arms: scene.arms.map((arm) => ({
      name: arm.name,
      model: arm.title || arm.model,
      kind: arm.kind,
      joints: arm.joints,
      base: { position: vector(arm.base_position_m), quaternion: quaternion(arm.base_quaternion_wxyz) },
      q_min: arm.q_min_rad,
      q_max: arm.q_max_rad,
      dq_max: arm.dq_max_rad_per_s,
      tau_max: arm.tau_max_nm,
      vacuum: Boolean(arm.vacuum),
      workspace: arm.workspace ? { min: vector(arm.workspace.min_m), max: vector(arm.workspace.max_m) } : undefined,
    })),
    bodies: scene.bodies.map((body) => {
      const arm = index(body.arm);
      return {
        name: body.object ?? body.name,
        ...(arm !== undefined && arm >= 0 ? { arm } : {}),
        movable: body.object !== undefined && (body.movable ?? false),
        pose: pose(body),
        shapes: body.shapes.map((shape) => ({
          kind: shape.kind,
          size: shape.size_m,
          pose: pose(shape),
          color: shape.color_rgba,
        })),
      };
    }),
  };
}
