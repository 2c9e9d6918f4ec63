// A headset's controllers move one hand or two: the squeeze button is the clutch and the dead-man button. The
// arms are seen in the headset (mixed or virtual reality), drawn in the operator's room.
import type { WebGLRenderer } from "three";
import { endingWith, type Holding, type Motion } from "../safety/holding.ts";
import { Clutch, type WorkspaceMapping } from "./clutch.ts";
import type { Pose } from "./vectors.ts";

export interface HeadsetHooks {
  /** A motion towards a goal; `begun` gets the initial target of the hand. */
  motion(hand: 0 | 1, goal: () => Pose | undefined, begun: (target: Pose) => void): Motion;
  stop(): void;
  ended(): void;
}

const kSqueeze = 1; // index of the button in the standard layout of XR controllers
const kSecondButton = 5; // B or Y: stop

export class Headset {
  mapping: WorkspaceMapping = { scale: 1, heading_rad: 0 };
  hands: 1 | 2 = 1;
  session: XRSession | undefined;
  private readonly clutches = [new Clutch(), new Clutch()] as const;
  private readonly poses: (Pose | undefined)[] = [undefined, undefined];
  private readonly squeezed = [false, false];
  private wasStop = false;

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly holding: Holding,
    private readonly hooks: HeadsetHooks,
  ) {}

  static async supported(): Promise<boolean> {
    const xr = navigator.xr;
    if (!xr) return false;
    for (const mode of ["immersive-ar", "immersive-vr"] as const) {
      if (await xr.isSessionSupported(mode).catch(() => false)) return true;
    }
    return false;
  }

  async start(): Promise<void> {
    const xr = navigator.xr!;
    const mixed = await xr.isSessionSupported("immersive-ar").catch(() => false);
    const session = await xr.requestSession(mixed ? "immersive-ar" : "immersive-vr", {
      requiredFeatures: ["local-floor"],
    });
    this.session = session;
    session.addEventListener("end", () => {
      this.session = undefined;
      this.letGo("the headset's session ended");
      this.renderer.xr.enabled = false;
      this.hooks.ended();
    });
    session.addEventListener("visibilitychange", () => {
      if (session.visibilityState !== "visible") this.letGo("the headset shows something else");
    });
    session.addEventListener("inputsourceschange", (event) => {
      if (event.removed.length > 0) this.letGo("a controller was lost");
    });
    this.renderer.xr.enabled = true;
    this.renderer.xr.setReferenceSpaceType("local-floor");
    await this.renderer.xr.setSession(session);
  }

  async stop(): Promise<void> {
    await this.session?.end();
  }

  /** Reads the controllers, in the handler of a drawn frame and before the gate is read. */
  frame(frame: XRFrame | undefined, space: XRReferenceSpace | null): void {
    if (!this.session || !frame || !space) return;
    let stop = false;
    const seen = [false, false];
    for (const source of this.session.inputSources) {
      if (source.handedness === "none" || !source.gamepad) continue;
      const hand = this.hands === 2 && source.handedness === "left" ? 1 : 0;
      if (this.hands === 1 && source.handedness === "left") continue;
      seen[hand] = true;
      const buttons = source.gamepad.buttons;
      stop ||= buttons[kSecondButton]?.pressed ?? false;
      const held = buttons[kSqueeze]?.pressed ?? false;
      const space6 = source.gripSpace ?? source.targetRaySpace;
      const pose = frame.getPose(space6, space);
      // A controller without tracking is released, because its pose is unknown.
      this.poses[hand] = pose && !pose.emulatedPosition ? poseOf(pose.transform) : undefined;
      const pressed = held && !this.squeezed[hand];
      this.squeezed[hand] = held;
      if (pressed && this.poses[hand]) this.close(hand);
    }
    // A controller that is not reported, or no longer used, holds nothing.
    for (const hand of [0, 1] as const) if (!seen[hand]) this.squeezed[hand] = false;
    if (stop && !this.wasStop) this.hooks.stop();
    this.wasStop = stop;
  }

  private close(hand: 0 | 1): void {
    const clutch = this.clutches[hand];
    const moves = this.hooks.motion(
      hand,
      () => this.poses[hand] && clutch.target(this.poses[hand], this.mapping),
      (target) => clutch.close(this.poses[hand]!, target),
    );
    const read = () => this.squeezed[hand]! && this.poses[hand] !== undefined;
    this.holding.begin(
      name(hand),
      read,
      endingWith(moves, () => clutch.open()),
    );
  }

  private letGo(cause: string): void {
    this.squeezed.fill(false);
    for (const hand of [0, 1] as const) this.holding.letGo(name(hand), cause);
  }
}

const name = (hand: 0 | 1): string => `headset, hand ${hand + 1}`;

function poseOf({ position: p, orientation: q }: XRRigidTransform): Pose {
  return { position: [p.x, p.y, p.z], quaternion: [q.w, q.x, q.y, q.z] };
}
