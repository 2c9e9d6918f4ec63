// The picture's stage: camera, lights, floor grid, and the loop that draws. Drawn when the browser asks for a frame and
// something has changed; a hidden page draws nothing.
import {
  AmbientLight,
  Color,
  DirectionalLight,
  GridHelper,
  HemisphereLight,
  MathUtils,
  Object3D,
  PerspectiveCamera,
  Scene,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

Object3D.DEFAULT_UP.set(0, 0, 1);

export type Viewpoint = "front" | "left" | "top" | "behind";

export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(42, 1, 0.02, 50);
  readonly renderer: WebGLRenderer;
  readonly controls: OrbitControls;
  /** Called in each frame of the browser with the time [ms]; calls `touch` if the picture has changed. */
  readonly beforeFrame: ((now: number) => void)[] = [];
  /** Drawn pictures so far. */
  pictures = 0;
  private grid: GridHelper | undefined;
  private changed = true;
  private drew = false;
  private sharpness = Math.min(2, devicePixelRatio);
  private lastFrame = 0;
  private pace = 16; // [ms] between frames, smoothed
  private center = new Vector3(0.4, 0, 0.35);
  private reach = 1.9;

  constructor(canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, powerPreference: "high-performance" });
    this.renderer.setPixelRatio(this.sharpness);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = MathUtils.degToRad(97);
    this.controls.minDistance = 0.3;
    this.controls.maxDistance = 8;
    this.controls.addEventListener("change", () => this.touch());
    const sun = new DirectionalLight(0xffffff, 1.9);
    sun.position.set(1.5, -1.2, 3);
    this.scene.add(new AmbientLight(0xffffff, 0.55), new HemisphereLight(0xffffff, 0x777f8a, 1.1), sun);
    this.look("front");
    new ResizeObserver(() => this.fit(canvas)).observe(canvas);
    this.renderer.setAnimationLoop((now: number) => this.frame(now));
  }

  touch(): void {
    this.changed = true;
  }

  /** Direction in which the camera looks, in the world. */
  heading(): [number, number, number] {
    const direction = this.camera.getWorldDirection(new Vector3());
    return [direction.x, direction.y, direction.z];
  }

  /** View of the standard viewpoints: the middle of the arms and their distance [m]. */
  frameScene(center: readonly number[], reach: number): void {
    this.center = new Vector3(...center);
    this.reach = reach;
    this.look("front");
  }

  look(from: Viewpoint): void {
    const directions: Record<Viewpoint, [number, number, number]> = {
      front: [1.1, -0.62, 0.62],
      left: [0.05, 1.25, 0.3],
      top: [-0.001, 0, 1.4],
      behind: [-1.15, 0.25, 0.75],
    };
    this.controls.target.copy(this.center);
    this.camera.position.copy(this.center).addScaledVector(new Vector3(...directions[from]), this.reach);
    this.controls.update();
    this.touch();
  }

  paint(grid: string): void {
    if (this.grid) this.scene.remove(this.grid);
    this.grid = new GridHelper(4, 20, new Color(grid), new Color(grid));
    this.grid.rotation.x = Math.PI / 2; // three.js lays it into x and z
    this.grid.material.transparent = true;
    this.grid.material.opacity = 0.7;
    this.scene.add(this.grid);
    this.touch();
  }

  /** Draws once at full resolution, even on a slow computer: for saved pictures. */
  drawSharply(): void {
    this.sharpness = Math.min(2, devicePixelRatio);
    this.pace = 30;
    this.renderer.setPixelRatio(this.sharpness);
    this.fit(this.renderer.domElement);
    this.renderer.render(this.scene, this.camera);
  }

  /** The picture as a PNG. Drawn again, because browsers discard the previous drawing. */
  picture(): string {
    this.drawSharply();
    return this.renderer.domElement.toDataURL("image/png");
  }

  private fit(canvas: HTMLCanvasElement): void {
    const { clientWidth: width, clientHeight: height } = canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.touch();
  }

  // A computer that is too slow draws coarser pictures, because the buttons are read with the frames.
  private keepPace(step: number): void {
    this.pace += 0.05 * (Math.min(250, step) - this.pace);
    const finest = Math.min(2, devicePixelRatio);
    const next =
      this.pace > 45
        ? Math.max(Math.min(0.5, finest), this.sharpness * 0.8)
        : this.pace < 20
          ? Math.min(finest, this.sharpness * 1.1)
          : this.sharpness;
    if (next === this.sharpness) return;
    this.sharpness = next;
    this.pace = 30; // judged again after some frames
    this.renderer.setPixelRatio(next);
    this.fit(this.renderer.domElement);
  }

  private frame(now: number): void {
    if (this.drew) this.keepPace(now - this.lastFrame);
    this.lastFrame = now;
    this.drew = false;
    for (const call of this.beforeFrame) call(now);
    if (!this.changed && !this.renderer.xr.isPresenting) return;
    this.changed = false;
    this.drew = true;
    ++this.pictures;
    this.renderer.render(this.scene, this.camera);
  }
}
