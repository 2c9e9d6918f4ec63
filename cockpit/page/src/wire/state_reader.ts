// Converts a state's numbers, and the texts that arrive a few times a second, to the panels' data.
import {
  type ArmState,
  type LiveState,
  type Nearness,
  type OutputState,
  type ReferenceState,
  type SceneInfo,
  poseAt,
} from "../model/live.ts";
import type { Vector3 } from "../teleop/vectors.ts";
import { Layout } from "./binary.ts";
import type { Hello } from "./hello.ts";

/** One arm in the text message `state`: data that are not numbers. */
export interface SlowArm {
  arm: string;
  reason?: string;
  cures?: { error: string; cure: string }[];
  last_intervention: string;
  removed_by?: string;
  connection?: { received: number; lost: number; late: number; command_success_rate: number };
  gripper?: { width_m: number; max_width_m: number; grasped: boolean; moving: boolean };
  tracking_unit?: string;
}

export interface SlowState {
  rate_hz?: number;
  stops?: number;
  paused?: boolean;
  arms: SlowArm[];
}

const kNearPairs = 16;
const kNearNumbers = 9;

export class StateReader {
  slow: SlowState = { arms: [] };
  private readonly layout: Layout;
  private readonly inputs: { controllet: string; input: string; quantity: string; field: string }[] = [];
  private readonly outputs: { controllet: string; name: string; field: string }[] = [];

  constructor(
    private readonly hello: Hello,
    private readonly scene: SceneInfo,
  ) {
    this.layout = new Layout(hello.state_fields);
    const names = new Set(hello.state_fields.map(([name]) => name));
    for (const one of hello.list.controllets) {
      for (const input of one.inputs) {
        const field = `${one.name}/${input.name}`;
        if (names.has(field)) {
          this.inputs.push({ controllet: one.name, input: input.name, quantity: input.quantity, field });
        }
      }
      const prefix = `${one.name}/outputs/`;
      for (const name of names) {
        if (name.startsWith(prefix))
          this.outputs.push({ controllet: one.name, name: name.slice(prefix.length), field: name });
      }
    }
  }

  get numbers(): number {
    return this.layout.total;
  }

  read(numbers: Float64Array): LiveState {
    const one = (name: string) => this.layout.one(numbers, name);
    return {
      cycle: one("cycle"),
      t_s: one("t_s"),
      sent_ms: one("sent_ms"),
      since_s: one("since_cycle_s"),
      rate_hz: this.slow.rate_hz ?? NaN,
      stops: this.slow.stops,
      cycle_us: one("total_us"),
      overruns: one("overruns"),
      paused: this.slow.paused ?? false,
      arms: this.scene.arms.map((_, k) => this.arm(numbers, k)),
      bodies: this.layout.of(numbers, "bodies") ?? [],
      references: this.references(numbers),
      outputs: this.outputStates(numbers),
      near: this.near(numbers),
    };
  }

  private arm(numbers: Float64Array, k: number): ArmState {
    const { name } = this.scene.arms[k]!;
    const { names } = this.hello;
    const of = (field: string) => this.layout.of(numbers, `${name}/${field}`);
    const one = (field: string) => this.layout.one(numbers, `${name}/${field}`);
    const known = (values: Float64Array | undefined) => (values && Number.isFinite(values[0]!) ? values : undefined);
    const defined = (value: number) => (Number.isFinite(value) ? value : undefined);
    const slow = this.slow.arms.find((arm) => arm.arm === name);
    const position = of("position_m") ?? [NaN, NaN, NaN];
    const orientation = of("quaternion_wxyz") ?? [1, 0, 0, 0];
    const width = one("gripper_width_m");
    return {
      controllet: names.controllets[one("owner")] ?? "",
      mode: names.modes[one("mode")] ?? "unknown",
      stopped: one("stopped") > 0,
      q: of("q_rad") ?? [],
      tau_cmd: of("tau_cmd_nm") ?? [],
      hand: poseAt([...position, ...orientation]),
      wrenchAt: known(of("stiffness_frame_m")) ?? position,
      wrench: known(of("wrench_n_nm")),
      contact: known(of("contact_wrench_n_nm")),
      errors: errorNames(one("errors"), names.errors) ?? [],
      reason: slow?.reason ?? "",
      cures: slow?.cures ?? [],
      age_s: one("age_s"),
      interventions: defined(one("interventions")) ?? 0,
      removedBy: slow?.removed_by ?? names.interventions[one("removed_by")] ?? "",
      lastIntervention: slow?.last_intervention ?? names.interventions[one("last_intervention")] ?? "",
      manipulability: defined(one("manipulability")),
      tracking: defined(one("tracking_error")),
      trackingUnit: slow?.tracking_unit ?? "",
      connection: slow?.connection && { ...slow.connection, success: slow.connection.command_success_rate },
      quantity: of,
      gripper: slow?.gripper && { ...slow.gripper, ...(Number.isFinite(width) ? { width_m: width } : {}) },
    };
  }

  private references(numbers: Float64Array): ReferenceState[] {
    const list: ReferenceState[] = [];
    for (const { field, ...rest } of this.inputs) {
      const values = this.layout.of(numbers, field);
      if (values && Number.isFinite(values[0]!)) list.push({ ...rest, values });
    }
    return list;
  }

  private outputStates(numbers: Float64Array): OutputState[] {
    const list: OutputState[] = [];
    for (const { controllet, name, field } of this.outputs) {
      const values = this.layout.of(numbers, field);
      if (values && Number.isFinite(values[0]!)) list.push({ controllet, name, values });
    }
    return list;
  }

  private near(numbers: Float64Array): Nearness[] {
    const all = this.layout.of(numbers, "near");
    const list: Nearness[] = [];
    for (let k = 0; all && k < kNearPairs; ++k) {
      const at = k * kNearNumbers;
      const v = (i: number) => all[at + i] ?? NaN;
      if (!Number.isFinite(v(0))) break;
      const from: Vector3 = [v(1), v(2), v(3)];
      const to: Vector3 = [v(4), v(5), v(6)];
      list.push({ distance_m: v(0), from, to });
    }
    return list;
  }
}

/** Names of the bits that are set; undefined if the number is not known. */
export function errorNames(bits: number, names: readonly string[]): string[] | undefined {
  if (!Number.isFinite(bits)) return undefined;
  const set: string[] = [];
  // A number holds 53 bits exactly, more than there are errors; shifting would cut it to 32.
  for (let k = 0, rest = bits; rest >= 1 && k < names.length; ++k, rest = Math.floor(rest / 2)) {
    if (rest % 2 === 1) set.push(names[k]!);
  }
  return set;
}
