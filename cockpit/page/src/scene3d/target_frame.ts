// A set-point as three short axes and a ring in the color of its arm.
import { BufferGeometry, Color, Group, Line, LineBasicMaterial, LineSegments, Vector3 } from "three";

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
