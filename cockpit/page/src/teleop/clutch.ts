// A tracked controller moves a hand relative to both poses when the clutch was closed, scaled and rotated
// from the operator's room into the world.
import {
  add,
  conjugate,
  exponential,
  logarithm,
  multiply,
  normalized,
  rotate,
  scale,
  subtract,
  type Pose,
  type Quaternion,
  type Vector3,
} from "./vectors.ts";

export interface WorkspaceMapping {
  /** Meters of the hand per meter of the controller. */
  scale: number;
  /** Heading of the operator in the world of the arms [rad]: 0 looks along x. */
  heading_rad: number;
}

/**
 * From WebXR's axes (x right, y up, z towards the operator) to the world's (z up): first x forward, y left, z up, then
 * turned by the heading.
 */
export function roomRotation(heading_rad: number): Quaternion {
  // Columns: room x (right) -> -y, room y (up) -> z, room z (back) -> -x. As a quaternion: (0.5, 0.5, -0.5, -0.5).
  const upright: Quaternion = [0.5, 0.5, -0.5, -0.5];
  return normalized(multiply(exponential([0, 0, heading_rad]), upright));
}

export class Clutch {
  private from: { controller: Pose; hand: Pose } | undefined;

  get closed(): boolean {
    return this.from !== undefined;
  }

  close(controller: Pose, hand: Pose): void {
    this.from = { controller, hand };
  }

  open(): void {
    this.from = undefined;
  }

  /** The hand's target for the controller's pose; undefined while the clutch is open. */
  target(controller: Pose, mapping: WorkspaceMapping): Pose | undefined {
    if (!this.from) return undefined;
    const room = roomRotation(mapping.heading_rad);
    const moved: Vector3 = rotate(room, subtract(controller.position, this.from.controller.position));
    const turn = logarithm(multiply(controller.quaternion, conjugate(this.from.controller.quaternion)));
    return {
      position: add(this.from.hand.position, scale(moved, mapping.scale)),
      quaternion: normalized(multiply(exponential(rotate(room, turn)), this.from.hand.quaternion)),
    };
  }
}
