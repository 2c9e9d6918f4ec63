// The run's first message, and the scene built from it.
import type { ControlletInfo } from "../model/description.ts";
import type { SceneInfo } from "../model/live.ts";
import type { Shape } from "../scene3d/shapes.ts";
import type { Pose, Quaternion, Vector3 } from "../teleop/vectors.ts";
import type { FieldList } from "./binary.ts";

interface WirePose {
  position_m: Vector3;
  quaternion_wxyz: Quaternion;
}

export interface WireArm {
  name: string;
  /** "simulated", "virtual" or "real". */
  kind: string;
  joints: number;
  base_position_m: Vector3;
  base_quaternion_wxyz: Quaternion;
  q_min_rad: number[];
  q_max_rad: number[];
  tau_max_nm: number[];
  gripper?: unknown;
  vacuum?: unknown;
  /** Box that the hand must not leave, in the world. */
  workspace?: { min_m: Vector3; max_m: Vector3 } | null;
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

const pose = (p: WirePose): Pose => ({ position: p.position_m, quaternion: p.quaternion_wxyz });

export function sceneOf({ scene }: Hello): SceneInfo {
  const index = (arm: number | string | undefined) =>
    typeof arm === "string" ? scene.arms.findIndex((one) => one.name === arm) : arm;
  return {
    ...scene,
    arms: scene.arms.map((arm) => ({
      ...arm,
      base: { position: arm.base_position_m, quaternion: arm.base_quaternion_wxyz },
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
