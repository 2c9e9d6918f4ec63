// The picture with its tools: viewpoints, visible elements, the target to drag, a snapshot.
import type { Session } from "../model/session.ts";
import { kLayerNames, type Layers, type World } from "../scene3d/world.ts";
import type { TargetGizmo } from "../scene3d/gizmo.ts";
import { Stage, type Viewpoint } from "../scene3d/stage.ts";
import { button, check, div, download, h, setText, icon } from "../ui/dom.ts";
import { fixed } from "../ui/words.ts";

export class ViewPanel {
  readonly element: HTMLElement;
  readonly stage: Stage;
  world: World | undefined;
  gizmo: TargetGizmo | undefined;
  private readonly notes = h("div", { class: "view-notes", role: "status" });
  private readonly near = h("span", { class: "badge warning", hidden: true });
  private readonly limits = h("span", { class: "badge warning", hidden: true });
  private readonly legend = h("span", { class: "badge" });
  private readonly turn = button("Turn target", () => this.turnTarget(), { "aria-pressed": "false", hidden: true });

  constructor(private readonly session: Session) {
    const canvas = h("canvas", { "aria-label": "3D view of the scene", role: "img", tabindex: 0 });
    this.element = h("main", { class: "view", "aria-label": "Scene" }, canvas, this.tools(), this.notes);
    this.notes.append(this.near, this.limits, this.legend);
    this.stage = new Stage(canvas);
    canvas.addEventListener("keydown", (event) => this.turnCamera(event));
  }

  set dragging(on: boolean) {
    if (this.gizmo) this.gizmo.visible = on;
    this.turn.hidden = !on;
  }

  /** A few times a second. */
  update(): void {
    const { state, scene } = this.session;
    if (!state || !scene) return;
    const nearest = Math.min(Infinity, ...state.near.map((one) => one.distance_m));
    this.near.hidden = !(nearest < 0.05);
    setText(this.near, `Parts ${fixed(1000 * nearest, 0)} mm apart`);
    const close = scene.arms.flatMap((arm, k) => {
      const q = state.arms[k]?.q ?? [];
      const margins = Array.from(q, (value, j) => Math.min(value - arm.q_min_rad[j]!, arm.q_max_rad[j]! - value));
      return margins.flatMap((margin, j) =>
        margin < 0.1 ? [`${arm.name} joint ${j + 1}: ${fixed(margin, 2)} rad to its limit`] : [],
      );
    });
    this.limits.hidden = close.length === 0;
    setText(this.limits, close.slice(0, 3).join(" · "));
    const force = Math.max(0, ...state.arms.map((arm) => Math.hypot(...Array.from(arm.wrench ?? []).slice(0, 3))));
    setText(this.legend, `Arrows: forces, 0.1 m is 12.5 N · largest ${fixed(force, 1)} N`);
  }

  private tools(): HTMLElement {
    const views = h("div", { class: "row group", role: "group", "aria-label": "Viewpoint" });
    for (const [from, text] of [
      ["front", "Front"],
      ["left", "Side"],
      ["top", "Top"],
      ["behind", "Behind"],
    ] as [Viewpoint, string][]) {
      views.append(button(text, () => this.stage.look(from)));
    }
    const layers = div("menu");
    for (const [key, text] of Object.entries(kLayerNames) as [keyof Layers, string][]) {
      const show = (on: boolean) => {
        if (!this.world) return;
        this.world.layers[key] = on;
        if (this.session.state) this.world.showAgain(this.session.state);
      };
      layers.append(check(text, show, { checked: true }));
    }
    layers.append(button("Clear trajectories", () => this.world?.clearTrails()));
    const save = () => download(`${this.session.scene?.name ?? "scene"}.png`, this.stage.picture());
    const snapshot = button(icon("camera"), save, { class: "icon-only", "aria-label": "Save a picture" });
    const menu = h("details", { class: "drop" }, h("summary", {}, "Show"), layers);
    return div("view-tools", views, menu, snapshot, this.turn);
  }

  private turnTarget(): void {
    if (!this.gizmo) return;
    this.gizmo.mode = this.gizmo.mode === "rotate" ? "translate" : "rotate";
    this.turn.setAttribute("aria-pressed", String(this.gizmo.mode === "rotate"));
  }

  // The arrow keys turn the camera, + and - bring it nearer and farther.
  private turnCamera(event: KeyboardEvent): void {
    const { camera, controls } = this.stage;
    const offset = camera.position.clone().sub(controls.target);
    const steps: Record<string, () => void> = {
      ArrowLeft: () => offset.applyAxisAngle(camera.up, -0.1),
      ArrowRight: () => offset.applyAxisAngle(camera.up, 0.1),
      ArrowUp: () => (offset.z += 0.08 * offset.length()),
      ArrowDown: () => (offset.z -= 0.08 * offset.length()),
      "+": () => offset.multiplyScalar(0.9),
      "-": () => offset.multiplyScalar(1.1),
    };
    const step = steps[event.key];
    if (!step) return;
    event.preventDefault();
    step();
    camera.position.copy(controls.target).add(offset);
    controls.update();
  }
}
