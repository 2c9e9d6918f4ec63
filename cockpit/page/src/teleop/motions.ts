// Motions that run while something is held: each sends one sample of a stream per drawn frame.
import { poseAt, type ArmInfo, type ArmState } from "../model/live.ts";
import type { Session } from "../model/session.ts";
import type { Motion } from "../safety/holding.ts";
import { axesRotation, jogged, jointsTowards, towards, type Deflection, type JogAxes, type JogLimits } from "./jog.ts";
import { kIdentity, kZero, type Pose, type Vector3 } from "./vectors.ts";

/** What the operator has set for all devices. */
export interface JogSettings extends JogLimits {
  axes: JogAxes;
  joint_rad_per_s: number;
}

export const kDefaultJog: JogSettings = {
  axes: "camera",
  speed_m_per_s: 0.1,
  turn_rad_per_s: 0.4,
  force_n: 20,
  lead_m: 0.04,
  lead_rad: 0.15,
  joint_rad_per_s: 0.3,
};

const kOldest = 500; // [ms] of a state that somebody may move by

interface Addressed {
  arm: ArmInfo;
  state: ArmState;
  controllet: string;
  input: string;
}

/** The arm and the input that a motion goes to, or why there is none. */
export function address(session: Session, arm: string, quantity: "pose" | "joints" | "wrench"): Addressed | string {
  const { scene, state } = session;
  const index = session.armIndex(arm);
  if (!scene || !state || index < 0) return "There is no state of the arm yet.";
  if (!session.control.mine) return "Take control first: only one page moves the arms.";
  if (performance.now() - session.arrived > kOldest) return "The newest state is too old to move by.";
  const one = state.arms[index]!;
  if (one.stopped) return `${arm} is stopped. Resume it first.`;
  const found = session.inputFor(arm, quantity);
  if (!found) {
    const fitting = session.list
      .filter((known) => known.arms.includes(arm) && known.inputs.some((input) => input.quantity === quantity))
      .map((known) => known.name);
    const what = { pose: "poses", joints: "joint positions", wrench: "wrenches" }[quantity];
    const owner = one.controllet || "its owner";
    return `'${owner}' takes no ${what}. ${fitting.length ? `Activate ${fitting.join(" or ")}.` : "The scene has no controllet that does."}`;
  }
  return { arm: scene.arms[index]!, state: one, controllet: found.controllet.name, input: found.input.name };
}

interface Destination {
  controllet: string;
  input: string;
}

/** Why a motion that began with `to` cannot go on: its arm has another owner, or another arm was chosen. */
function elsewhere(to: Destination | undefined, { arm, controllet, input }: Addressed): string | undefined {
  if (to?.controllet === controllet && to.input === input) return undefined;
  return `'${controllet}' leads ${arm.name} now`;
}

/** Leads one hand: by the deflection of a device, or after a goal that moves. */
export class PoseMotion implements Motion {
  private target: Pose | undefined;
  private to: Destination | undefined;

  constructor(
    private readonly session: Session,
    private readonly arm: () => string,
    private readonly settings: () => JogSettings,
    private readonly view: () => Vector3,
    private readonly source: { deflection(): Deflection } | { goal(): Pose | undefined },
    private readonly hooks: { begun?: (target: Pose) => void; ended?: () => void } = {},
  ) {}

  begin(): string | undefined {
    const found = address(this.session, this.arm(), "pose");
    if (typeof found === "string") return found;
    this.to = { controllet: found.controllet, input: found.input };
    const set = this.session.reference(found.controllet, found.input);
    this.target = set && Number.isFinite(set[0]!) ? poseAt(set) : found.state.hand;
    this.hooks.begun?.(this.target);
    return undefined;
  }

  step(seconds: number): string | undefined {
    const found = address(this.session, this.arm(), "pose");
    if (typeof found === "string") return found;
    const other = elsewhere(this.to, found);
    if (!this.target || !this.to || other) return other;
    const settings = this.settings();
    const { arm, state } = found;
    const force = Array.from(state.wrench ?? kZero).slice(0, 3) as unknown as Vector3;
    // A common pose of several hands is not where one of them is: it leads nothing but itself.
    const own = this.session.controllet(this.to.controllet)?.arms.length === 1;
    const led = own ? state.hand : this.target;
    if ("deflection" in this.source) {
      const axes = axesRotation(settings.axes, this.view(), arm.base.quaternion, state.hand.quaternion);
      this.target = jogged(this.target, this.source.deflection(), axes, seconds, led, force, settings);
    } else {
      const goal = this.source.goal();
      if (goal) {
        const way = towards(this.target, goal, seconds, settings);
        this.target = jogged(this.target, way, kIdentity, seconds, led, force, settings);
      }
    }
    this.session.send({
      do: "reference",
      stream: true,
      ...this.to,
      position_m: this.target.position,
      quaternion_wxyz: this.target.quaternion,
    });
    return undefined;
  }

  end(): void {
    this.target = this.to = undefined;
    this.hooks.ended?.();
  }
}

/** Leads the joints of one arm to the positions of the sliders. */
export class JointMotion implements Motion {
  private target: number[] = [];
  private to: Destination | undefined;

  constructor(
    private readonly session: Session,
    private readonly arm: () => string,
    private readonly settings: () => JogSettings,
    private readonly goal: () => readonly number[],
    private readonly ended: () => void = () => {},
  ) {}

  begin(): string | undefined {
    const found = address(this.session, this.arm(), "joints");
    if (typeof found === "string") return found;
    this.to = { controllet: found.controllet, input: found.input };
    const set = this.session.reference(found.controllet, found.input);
    this.target = Array.from(set && Number.isFinite(set[0]!) ? set : found.state.q).slice(0, found.arm.joints);
    return undefined;
  }

  step(seconds: number): string | undefined {
    const found = address(this.session, this.arm(), "joints");
    if (typeof found === "string") return found;
    const other = elsewhere(this.to, found);
    if (other) return other;
    const { joint_rad_per_s, lead_rad } = this.settings();
    this.target = jointsTowards(this.target, this.goal(), found.state.q, seconds, joint_rad_per_s, lead_rad);
    this.session.send({ do: "reference", stream: true, ...this.to, q_rad: this.target });
    return undefined;
  }

  end(): void {
    this.to = undefined;
    this.ended();
  }
}

/** Presses with a wrench while it is held; when it is let go, the run ends the stream. */
export class WrenchMotion implements Motion {
  private to: Destination | undefined;

  constructor(
    private readonly session: Session,
    private readonly arm: () => string,
    private readonly wrench: () => { force_n: number[]; torque_nm: number[] },
  ) {}

  begin(): string | undefined {
    const found = address(this.session, this.arm(), "wrench");
    if (typeof found === "string") return found;
    this.to = { controllet: found.controllet, input: found.input };
    return undefined;
  }

  step(): string | undefined {
    const found = address(this.session, this.arm(), "wrench");
    if (typeof found === "string") return found;
    const other = elsewhere(this.to, found);
    if (other) return other;
    this.session.send({ do: "reference", stream: true, ...this.to, ...this.wrench() });
    return undefined;
  }

  end(): void {
    this.to = undefined;
  }
}
