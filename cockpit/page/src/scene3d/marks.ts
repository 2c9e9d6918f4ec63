// Drawings besides the bodies: forces, paths, set-points.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  ConeGeometry,
  CylinderGeometry,
  Group,
  Line,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  Vector3,
} from "three";

// A vector quantity as an arrow: forces and moments. Long ones saturate, so that a collision does not fill
// the picture.
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

// The recent path of a point, as a line of fixed size that is overwritten cyclically.
export class Trail extends Line<BufferGeometry, LineBasicMaterial> {
  private points = 0;
  private last = [NaN, NaN, NaN];

  constructor(private readonly capacity: number) {
    super(new BufferGeometry(), new LineBasicMaterial({ transparent: true, opacity: 0.75 }));
    this.geometry.setAttribute("position", new BufferAttribute(new Float32Array(3 * capacity), 3));
    this.geometry.setDrawRange(0, 0);
    this.frustumCulled = false;
  }

  paint(color: string): void {
    this.material.color = new Color(color);
  }

  /** Points closer than a millimeter to the last one are not kept: an arm at rest keeps its trail. */
  extend(point: readonly number[]): void {
    const [x, y, z] = point;
    if (x === undefined || y === undefined || z === undefined || !Number.isFinite(x)) return;
    const [lx = 0, ly = 0, lz = 0] = this.last;
    if (Math.hypot(x - lx, y - ly, z - lz) < 1e-3) return;
    this.last = [x, y, z];
    const positions = this.geometry.getAttribute("position") as BufferAttribute;
    if (this.points === this.capacity) {
      // Drops the older half at once, so that copying is rare.
      const half = Math.floor(this.capacity / 2);
      (positions.array as Float32Array).copyWithin(0, 3 * (this.capacity - half));
      this.points = half;
    }
    positions.setXYZ(this.points++, x, y, z);
    positions.needsUpdate = true;
    this.geometry.setDrawRange(0, this.points);
  }

  clearPoints(): void {
    this.points = 0;
    this.last = [NaN, NaN, NaN];
    this.geometry.setDrawRange(0, 0);
  }
}

// A set-point as three short axes and a ring in the color of its arm.
const kLength = 0.09;
const kAxes = ["#e5484d", "#30a46c", "#3e7fe0"];

export class TargetFrame extends Group {
  private readonly ring: Line<BufferGeometry, LineBasicMaterial>;

  constructor(readonly arm: number) {
    super();
    const ends = [new Vector3(kLength, 0, 0), new Vector3(0, kLength, 0), new Vector3(0, 0, kLength)];
    ends.forEach((end, k) => {
      const geometry = new BufferGeometry().setFromPoints([new Vector3(), end]);
      this.add(new LineSegments(geometry, new LineBasicMaterial({ color: kAxes[k]!, depthTest: false })));
    });
    const points = Array.from({ length: 41 }, (_, k) => {
      const angle = (k / 40) * 2 * Math.PI;
      return new Vector3(0.035 * Math.cos(angle), 0.035 * Math.sin(angle), 0);
    });
    this.ring = new Line(new BufferGeometry().setFromPoints(points), new LineBasicMaterial({ depthTest: false }));
    this.add(this.ring);
    this.renderOrder = 2;
  }

  paint(color: string): void {
    this.ring.material.color = new Color(color);
  }

  setPose(values: ArrayLike<number>): void {
    this.position.set(values[0]!, values[1]!, values[2]!);
    this.quaternion.set(values[4]!, values[5]!, values[6]!, values[3]!);
  }
}
