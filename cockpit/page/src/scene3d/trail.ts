// The way that a point has gone lately, as a line of fixed size that is written round.
import { BufferAttribute, BufferGeometry, Color, Line, LineBasicMaterial } from "three";

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
      // The older half is dropped at once, so that copying is rare.
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
