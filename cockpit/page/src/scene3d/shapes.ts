// Arms, tools and objects are drawn from primitives, so a scene is a small text and no mesh is fetched.
import {
  BoxGeometry,
  CapsuleGeometry,
  Color,
  CylinderGeometry,
  Group,
  Mesh,
  MeshStandardMaterial,
  SphereGeometry,
  type BufferGeometry,
} from "three";
import type { Pose } from "../teleop/vectors.ts";

/** A primitive in the frame of its body. Capsules and cylinders lie along z, with their middle at the origin. */
export interface Shape {
  kind: "box" | "sphere" | "capsule" | "cylinder" | "plane";
  /** Box: edges; sphere: radius; capsule and cylinder: radius, length between the ends of the axis; plane: nothing. */
  size: readonly number[];
  pose: Pose;
  color: readonly number[];
}

/** Shared geometries and materials: four arms need no more of them than one. */
export class ShapeFactory {
  private readonly geometries = new Map<string, BufferGeometry>();
  private readonly materials = new Map<string, MeshStandardMaterial>();

  /** A group whose pose is that of the body. */
  body(shapes: readonly Shape[]): Group {
    const group = new Group();
    for (const shape of shapes) {
      if (shape.kind === "plane") continue; // drawn as the grid
      const mesh = new Mesh(this.geometry(shape), this.material(shape.color));
      place(mesh, shape.pose);
      group.add(mesh);
    }
    return group;
  }

  private geometry(shape: Shape): BufferGeometry {
    const key = `${shape.kind} ${shape.size.join(" ")}`;
    let made = this.geometries.get(key);
    if (!made) this.geometries.set(key, (made = make(shape)));
    return made;
  }

  private material(color: readonly number[]): MeshStandardMaterial {
    const key = color.join(" ");
    let made = this.materials.get(key);
    if (!made) {
      const [r = 0.8, g = 0.8, b = 0.8, a = 1] = color;
      made = new MeshStandardMaterial({ color: new Color().setRGB(r, g, b, "srgb"), roughness: 0.55, metalness: 0.1 });
      if (a < 1) Object.assign(made, { transparent: true, opacity: a });
      this.materials.set(key, made);
    }
    return made;
  }
}

function make({ kind, size }: Shape): BufferGeometry {
  const [a = 0.05, b = 0.05, c = 0.05] = size;
  switch (kind) {
    case "box":
      return new BoxGeometry(a, b, c);
    case "sphere":
      return new SphereGeometry(a, 24, 16);
    case "capsule":
      return new CapsuleGeometry(a, b, 8, 20).rotateX(Math.PI / 2); // three.js draws it along y
    default:
      return new CylinderGeometry(a, a, b, 28).rotateX(Math.PI / 2);
  }
}

export function place(object: Mesh | Group, { position, quaternion }: Pose): void {
  object.position.set(position[0], position[1], position[2]);
  object.quaternion.set(quaternion[1], quaternion[2], quaternion[3], quaternion[0]);
}
