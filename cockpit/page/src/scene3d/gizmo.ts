// The target of one hand, to be dragged in the picture. The hand follows while it is dragged; when it is let go, the arm
// stops, and the gizmo returns to it.
import { Group, Mesh, MeshBasicMaterial, SphereGeometry } from "three";
import { TransformControls } from "three/examples/jsm/controls/TransformControls.js";
import { endingWith, type Holding, type Motion } from "../safety/holding.ts";
import type { Pose } from "../teleop/vectors.ts";
import { place } from "./shapes.ts";
import type { Stage } from "./stage.ts";

export class TargetGizmo {
  private readonly handle = new Group();
  private readonly controls: TransformControls;
  private on = false;
  private dragging = false;

  constructor(
    private readonly stage: Stage,
    private readonly holding: Holding,
    motion: (goal: () => Pose | undefined) => Motion,
  ) {
    this.handle.add(new Mesh(new SphereGeometry(0.018), new MeshBasicMaterial({ color: "#ffd33d", depthTest: false })));
    this.controls = new TransformControls(stage.camera, stage.renderer.domElement);
    this.controls.setSize(0.9);
    this.controls.attach(this.handle);
    this.controls.addEventListener("change", () => stage.touch());
    const moves = motion(() => (this.dragging ? this.pose() : undefined));
    const dragged = endingWith(moves, () => this.drop());
    this.controls.addEventListener("dragging-changed", (event) => {
      this.dragging = event.value === true;
      if (!this.dragging) return this.holding.letGo("target");
      this.stage.controls.enabled = false; // until the pointer is up: the rest of a dropped drag must not turn the view
      if (!this.holding.begin("target", () => this.dragging, dragged)) this.drop();
    });
    const canvas = stage.renderer.domElement;
    canvas.addEventListener("pointercancel", () => this.holding.letGo("target", "the browser took the pointer"));
    canvas.addEventListener("lostpointercapture", () => {
      this.holding.letGo("target", "the pointer was lost");
      this.stage.controls.enabled = true;
    });
  }

  get mode(): "translate" | "rotate" {
    return this.controls.mode === "rotate" ? "rotate" : "translate";
  }

  set mode(mode: "translate" | "rotate") {
    this.controls.setMode(mode);
    this.stage.touch();
  }

  set visible(on: boolean) {
    if (on === this.on) return;
    this.holding.letGo("target");
    this.on = on;
    const parts = [this.handle, this.controls.getHelper()];
    if (on) this.stage.scene.add(...parts);
    else this.stage.scene.remove(...parts);
    this.controls.enabled = on;
    this.stage.touch();
  }

  get visible(): boolean {
    return this.on;
  }

  /** Stays at the hand's set-point unless dragged. */
  follow(pose: Pose): void {
    if (this.on && !this.dragging && !this.holding.holds("target")) place(this.handle, pose);
  }

  // Ends a drag that continues in the browser but is no longer valid.
  private drop(): void {
    this.dragging = false;
    this.controls.dragging = false;
    this.controls.axis = null;
  }

  private pose(): Pose {
    const { position: p, quaternion: q } = this.handle;
    return { position: [p.x, p.y, p.z], quaternion: [q.w, q.x, q.y, q.z] };
  }
}
