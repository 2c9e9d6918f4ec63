// A vector quantity as an arrow: forces and moments. Long ones saturate, so that a crash does not fill the picture.
import { Color, ConeGeometry, CylinderGeometry, Group, Mesh, MeshBasicMaterial, Vector3 } from "three";

const kUp = new Vector3(0, 1, 0);
const shaftGeometry = new CylinderGeometry(1, 1, 1, 10).translate(0, 0.5, 0);
const headGeometry = new ConeGeometry(1, 1, 16).translate(0, 0.5, 0);

export class Arrow extends Group {
  private readonly shaft: Mesh;
  private readonly head: Mesh;
  private readonly material = new MeshBasicMaterial();
  private readonly direction = new Vector3();

  /** `unit` is the length per unit of the quantity [m], `longest` the length at which it saturates [m]. */
  constructor(
    private readonly unit: number,
    private readonly longest: number,
    private readonly thickness = 0.006,
  ) {
    super();
    this.shaft = new Mesh(shaftGeometry, this.material);
    this.head = new Mesh(headGeometry, this.material);
    this.add(this.shaft, this.head);
    this.visible = false;
  }

  paint(color: string): void {
    this.material.color = new Color(color);
  }

  /** From a point along a vector; nothing below `least` (in the quantity's unit). */
  show(at: ArrayLike<number>, vector: readonly number[], least: number): void {
    const [x = NaN, y = NaN, z = NaN] = vector;
    const size = Math.hypot(x, y, z);
    this.visible = size >= least && Number.isFinite(at[0] ?? NaN);
    if (!this.visible) return;
    const length = Math.min(this.longest, size * this.unit);
    const head = Math.min(0.6 * length, this.thickness * 5);
    this.position.set(at[0]!, at[1]!, at[2]!);
    this.quaternion.setFromUnitVectors(kUp, this.direction.set(x / size, y / size, z / size));
    this.shaft.scale.set(this.thickness, length - head, this.thickness);
    this.head.scale.set(this.thickness * 2.4, head, this.thickness * 2.4);
    this.head.position.set(0, length - head, 0);
  }
}
