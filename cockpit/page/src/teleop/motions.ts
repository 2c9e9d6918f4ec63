// Motions while a control is held: each sends one sample of a stream per drawn frame.
import { poseAt, type ArmInfo, type ArmState } from "../model/live.ts";
import type { Session } from "../model/session.ts";
import type { Motion } from "../safety/holding.ts";
import { axesRotation, jogged, jointsTowards, towards, type Deflection, type JogAxes, type JogLimits } from "./jog.ts";
import { kIdentity, kZero, type Pose, type Vector3 } from "./vectors.ts";

/** The operator's settings for all devices. */
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

const kOldest = 500; // oldest state for motion [ms]

interface Addressed {
  arm: ArmInfo;
  state: ArmState;
  controllet: string;
  input: string;
}

/** The arm and the input of a motion, or why there is none. */
export function address(session: Session, arm: string, quantity: "pose" | "joints" | "wrench"): Addressed | string {
  const { scene, state } = session;
  const index = session.armIndex(arm);
  if (!scene || !state || index < 0) return "There is no state of the arm yet.";
  if (!session.control.mine) return "Take control first: only one page moves the arms.";
  if (performance.now() - session.arrived > kOldest) return "The newest state is too old for motion.";
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

/** A motion of one arm: its stream stays with its input, or ends. */
abstract class ArmMotion implements Motion {
  private to: { controllet: string; input: string } | undefined;

  constructor(
    protected readonly session: Session,
    private readonly arm: () => string,
    private readonly quantity: "pose" | "joints" | "wrench",
  ) {}

  begin(): string | undefined {
    const found = address(this.session, this.arm(), this.quantity);
    if (typeof found === "string") return found;
    this.to = { controllet: found.controllet, input: found.input };
    const set = this.session.reference(found.controllet, found.input);
    this.begun(found, set && Number.isFinite(set[0]!) ? set : undefined);
    return undefined;
  }

  step(seconds: number): string | undefined {
    const found = address(this.session, this.arm(), this.quantity);
    if (typeof found === "string") return found;
    // Another owner or arm was chosen.
    if (this.to?.controllet !== found.controllet || this.to.input !== found.input)
      return `'${found.controllet}' leads ${found.arm.name} now`;
    this.session.send({ do: "reference", stream: true, ...this.to, ...this.sample(found, seconds) });
    return undefined;
  }

  end(): void {
    this.to = undefined;
  }

  /** `set`: the set-point so far. */
  protected begun(_found: Addressed, _set: ArrayLike<number> | undefined): void {}
  protected abstract sample(found: Addressed, seconds: number): Record<string, unknown>;
}

export type PoseSource = { deflection(): Deflection } | { goal(): Pose | undefined };

/** Moves one hand: by the deflection of a device, or towards a moving goal. */
export class PoseMotion extends ArmMotion {
  private target: Pose = { position: kZero, quaternion: kIdentity };

  constructor(
    session: Session,
    arm: () => string,
    private readonly settings: () => JogSettings,
    private readonly view: () => Vector3,
    private readonly source: PoseSource,
    private readonly tell: (target: Pose) => void = () => {},
  ) {
    super(session, arm, "pose");
  }

  protected override begun({ state }: Addressed, set: ArrayLike<number> | undefined): void {
    this.target = set ? poseAt(set) : state.hand;
    this.tell(this.target);
  }

  protected sample({ arm, state, controllet }: Addressed, seconds: number): Record<string, unknown> {
    const settings = this.settings();
    const force = Array.from(state.wrench ?? kZero).slice(0, 3) as unknown as Vector3;
    // A common pose of several hands differs from each hand's: it only moves itself.
    const own = this.session.controllet(controllet)?.arms.length === 1;
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
    return { position_m: this.target.position, quaternion_wxyz: this.target.quaternion };
  }
}

/** Moves the joints of one arm to the positions of the sliders. */
export class JointMotion extends ArmMotion {
  private target: number[] = [];

  constructor(
    session: Session,
    arm: () => string,
    private readonly settings: () => JogSettings,
    private readonly goal: () => readonly number[],
  ) {
    super(session, arm, "joints");
  }

  protected override begun({ arm, state }: Addressed, set: ArrayLike<number> | undefined): void {
    this.target = Array.from(set ?? state.q).slice(0, arm.joints);
  }

  protected sample({ state }: Addressed, seconds: number): Record<string, unknown> {
    const { joint_rad_per_s, lead_rad } = this.settings();
    this.target = jointsTowards(this.target, this.goal(), state.q, seconds, joint_rad_per_s, lead_rad);
    return { q_rad: this.target };
  }
}

/** Presses with a wrench while held; on release the run ends the stream. */
export class WrenchMotion extends ArmMotion {
  constructor(
    session: Session,
    arm: () => string,
    private readonly wrench: () => { force_n: number[]; torque_nm: number[] },
  ) {
    super(session, arm, "wrench");
  }

  protected sample(): Record<string, unknown> {
    return this.wrench();
  }
}
