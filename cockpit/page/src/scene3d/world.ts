// The picture of a scene: bodies at the poses of the state, and invisible quantities: forces, paths,
// set-points, small distances, limits.
import {
  Box3,
  Box3Helper,
  BufferAttribute,
  BufferGeometry,
  Color,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshStandardMaterial,
  Vector3,
} from "three";
import { limitMargin, type LiveState, type SceneInfo } from "../model/live.ts";
import { Arrow, TargetFrame, Trail } from "./marks.ts";
import { place, ShapeFactory } from "./shapes.ts";
import type { Stage } from "./stage.ts";

export interface Layers {
  forces: boolean;
  contacts: boolean;
  targets: boolean;
  trails: boolean;
  distances: boolean;
  limits: boolean;
}

export const kLayerNames: Record<keyof Layers, string> = {
  forces: "Estimated forces",
  contacts: "Contact forces",
  targets: "Targets",
  trails: "Trajectories",
  distances: "Distances below 5 cm",
  limits: "Limits of joints and workspaces",
};

const kNearLimit = 0.06; // share of a joint's range
const kNearWall = 0.08; // [m] from the end of a workspace
const kMostNear = 16;
const kVisible = 2e-4; // [m]; smaller changes are not drawn
const kForceUnit = 0.008; // [m/N] of the arrows

interface ArmView {
  links: Group[];
  wrench: Arrow;
  moment: Arrow;
  contact: Arrow;
  trail: Trail;
  alarm: Mesh[];
  workspace: Box3Helper | undefined;
}

export class World {
  readonly group = new Group();
  /** Groups of the bodies, in the order of the scene. */
  readonly bodies: Group[] = [];
  readonly layers: Layers = {
    forces: true,
    contacts: true,
    targets: true,
    trails: true,
    distances: true,
    limits: true,
  };
  private readonly arms: ArmView[] = [];
  private readonly targets = new Map<string, TargetFrame>();
  private readonly near: LineSegments<BufferGeometry, LineBasicMaterial>;
  private readonly alarmMaterial = new MeshStandardMaterial({ color: "#e5484d", emissive: "#7a1216", roughness: 0.6 });
  private readonly usual = new Map<Mesh, Mesh["material"]>();
  private colors: string[] = [];
  private shown = new Float64Array();

  constructor(
    private readonly stage: Stage,
    private readonly scene: SceneInfo,
    /** Drawn pale, as the second one of two compared logs. */
    pale = false,
  ) {
    const factory = new ShapeFactory();
    for (const body of scene.bodies) {
      const group = factory.body(body.shapes);
      group.name = body.name;
      place(group, body.pose);
      this.bodies.push(group);
      this.group.add(group);
    }
    scene.arms.forEach((info, arm) => {
      const { min_m, max_m } = info.workspace ?? {};
      const box = min_m && max_m && new Box3(new Vector3(...min_m), new Vector3(...max_m));
      const view: ArmView = {
        links: this.bodies.filter((_, k) => scene.bodies[k]!.arm === arm),
        wrench: new Arrow(kForceUnit, 0.45),
        moment: new Arrow(0.04, 0.3, 0.004),
        contact: new Arrow(kForceUnit, 0.45, 0.004),
        trail: new Trail(1200),
        alarm: [],
        workspace: box && new Box3Helper(box, "#e5484d"),
      };
      if (view.workspace) this.group.add(view.workspace);
      this.arms.push(view);
      this.group.add(view.wrench, view.moment, view.contact, view.trail);
    });
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(6 * kMostNear), 3));
    this.near = new LineSegments(geometry, new LineBasicMaterial({ depthTest: false }));
    this.near.frustumCulled = false;
    this.near.renderOrder = 2;
    this.group.add(this.near);
    if (pale) this.makePale();
    stage.scene.add(this.group);
    // Also compiles shaders of invisible parts: compiling them at the first force would stall the page.
    stage.renderer.compile(stage.scene, stage.camera);
  }

  dispose(): void {
    this.stage.scene.remove(this.group);
  }

  /** Passes the positions of the arms to the stage, so that its viewpoints show all of them. */
  frame(): void {
    const bases = this.scene.arms.map((arm) => arm.base.position);
    if (bases.length === 0) return;
    const span = (axis: 0 | 1) => {
      const values = bases.map((position) => position[axis]);
      return [Math.min(...values), Math.max(...values)] as const;
    };
    const [x, y] = [span(0), span(1)];
    // Arms in a row work towards their front.
    const center = [(x[0] + x[1]) / 2 + (x[0] === x[1] ? 0.3 : 0), (y[0] + y[1]) / 2, 0.32];
    const spread = Math.hypot(x[1] - x[0], y[1] - y[0]);
    this.stage.frameScene(center, 1.15 + 0.45 * spread);
  }

  paint(armColors: readonly string[], contact: string, near: string): void {
    this.colors = [...armColors];
    this.arms.forEach((arm, k) => {
      const color = armColors[k % armColors.length]!;
      for (const part of [arm.wrench, arm.trail]) part.paint(color);
      arm.moment.paint(color);
      arm.contact.paint(contact);
    });
    for (const frame of this.targets.values()) frame.paint(this.colors[frame.arm % this.colors.length] ?? "#888888");
    this.near.material.color = new Color(near);
    this.stage.touch();
  }

  clearTrails(): void {
    for (const arm of this.arms) arm.trail.clearPoints();
    this.stage.touch();
  }

  /** Shows the newest state; skips drawing if the picture would not change. */
  show(state: LiveState): void {
    if (!this.differs(state)) return;
    const { bodies } = state;
    for (let k = 0; k < this.bodies.length && 7 * k + 6 < bodies.length; ++k) {
      const at = 7 * k;
      if (!Number.isFinite(bodies[at]!)) continue;
      this.bodies[k]!.position.set(bodies[at]!, bodies[at + 1]!, bodies[at + 2]!);
      this.bodies[k]!.quaternion.set(bodies[at + 4]!, bodies[at + 5]!, bodies[at + 6]!, bodies[at + 3]!);
    }
    state.arms.forEach((arm, k) => this.showArm(k, arm));
    this.showTargets(state);
    this.showNear(state);
    this.stage.touch();
  }

  /** The visible elements have changed. */
  showAgain(state: LiveState): void {
    this.shown = new Float64Array();
    this.show(state);
  }

  // Whether anything has moved visibly since it was drawn. 2e-4 of a quaternion moves a point 0.5 m away by 0.2 mm.
  private differs({ bodies, arms, references, near }: LiveState): boolean {
    const forces = arms.flatMap((arm) => [...Array.from(arm.wrench ?? []), ...Array.from(arm.contact ?? [])]);
    const numbers = Float64Array.from([
      ...Array.from(bodies),
      ...forces.map((value) => value * kForceUnit),
      ...references.flatMap((one) => (one.quantity === "pose" ? Array.from(one.values) : [])),
      ...near.flatMap((one) => [...one.from, ...one.to]),
    ]);
    const { shown } = this;
    const same =
      numbers.length === shown.length &&
      numbers.every((value, k) => Math.abs(value - shown[k]!) < kVisible || value !== value);
    if (!same) this.shown = numbers;
    return !same;
  }

  private showArm(k: number, state: LiveState["arms"][number]): void {
    const view = this.arms[k];
    if (!view) return;
    const at = state.hand.position;
    const from = state.wrenchAt;
    const wrench = Array.from(state.wrench ?? []);
    view.wrench.show(from, this.layers.forces ? wrench.slice(0, 3) : [], 1);
    view.moment.show(from, this.layers.forces ? wrench.slice(3, 6) : [], 0.5);
    view.contact.show(from, this.layers.contacts ? Array.from(state.contact ?? []).slice(0, 3) : [], 0.5);
    view.trail.visible = this.layers.trails;
    view.trail.extend(at);
    if (view.workspace) view.workspace.visible = this.layers.limits && wallDistance(view.workspace.box, at) < kNearWall;
    const margin = limitMargin(this.scene.arms[k]!, state);
    this.alarm(view, this.layers.limits && margin.share < kNearLimit ? margin.joint : -1);
  }

  // The link behind a joint near its limit is red.
  private alarm(view: ArmView, joint: number): void {
    const link = joint < 0 ? undefined : view.links[joint + 1];
    const meshes = (link?.children.filter((child) => child instanceof Mesh) ?? []) as Mesh[];
    if (meshes[0] === view.alarm[0]) return;
    for (const mesh of view.alarm) mesh.material = this.usual.get(mesh) ?? mesh.material;
    for (const mesh of meshes) {
      if (!this.usual.has(mesh)) this.usual.set(mesh, mesh.material);
      mesh.material = this.alarmMaterial;
    }
    view.alarm = meshes;
  }

  private showTargets(state: LiveState): void {
    const seen = new Set<string>();
    if (this.layers.targets) {
      for (const { controllet, input, quantity, values } of state.references) {
        if (quantity !== "pose" || !Number.isFinite(values[0] ?? NaN)) continue;
        const key = `${controllet}.${input}`;
        seen.add(key);
        let frame = this.targets.get(key);
        if (!frame) {
          const arm = Math.max(
            0,
            state.arms.findIndex((one) => one.controllet === controllet),
          );
          frame = new TargetFrame(arm);
          frame.paint(this.colors[arm % this.colors.length] ?? "#888888");
          this.targets.set(key, frame);
          this.group.add(frame);
        }
        frame.setPose(values);
      }
    }
    for (const [key, frame] of this.targets) frame.visible = seen.has(key);
  }

  private showNear(state: LiveState): void {
    const shown = this.layers.distances ? state.near.slice(0, kMostNear) : [];
    const positions = this.near.geometry.getAttribute("position") as BufferAttribute;
    shown.forEach(({ from, to }, k) => {
      positions.setXYZ(2 * k, ...from);
      positions.setXYZ(2 * k + 1, ...to);
    });
    positions.needsUpdate = true;
    this.near.geometry.setDrawRange(0, 2 * shown.length);
  }

  private makePale(): void {
    this.group.traverse((object) => {
      if (!(object instanceof Mesh)) return;
      const material = (object.material as MeshStandardMaterial).clone();
      Object.assign(material, { transparent: true, opacity: 0.3, depthWrite: false });
      object.material = material;
    });
  }
}

/** Distance of a point from the nearest wall of a box [m]; negative outside of it. */
export function wallDistance({ min, max }: Box3, point: readonly number[]): number {
  const [x = NaN, y = NaN, z = NaN] = point;
  return Math.min(x - min.x, max.x - x, y - min.y, max.y - y, z - min.z, max.z - z);
}
