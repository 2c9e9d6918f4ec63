// Small vectors and rotations as plain arrays. Quaternions are w x y z, as everywhere in the project.

export type Vector3 = readonly [number, number, number];
export type Quaternion = readonly [number, number, number, number];

export interface Pose {
  position: Vector3;
  quaternion: Quaternion;
}

export const kZero: Vector3 = [0, 0, 0];
export const kIdentity: Quaternion = [1, 0, 0, 0];

export const add = (a: Vector3, b: Vector3): Vector3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Vector3, b: Vector3): Vector3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Vector3, s: number): Vector3 => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a: Vector3, b: Vector3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const norm = (a: Vector3): number => Math.hypot(a[0], a[1], a[2]);

export const cross = (a: Vector3, b: Vector3): Vector3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

/** Shortened to `limit`, direction kept. */
export function limited(a: Vector3, limit: number): Vector3 {
  const length = norm(a);
  return length > limit ? scale(a, limit / length) : a;
}

export function multiply(a: Quaternion, b: Quaternion): Quaternion {
  return [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
    a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
  ];
}

export const conjugate = (q: Quaternion): Quaternion => [q[0], -q[1], -q[2], -q[3]];

export function normalized(q: Quaternion): Quaternion {
  const length = Math.hypot(...q);
  return length > 0 ? [q[0] / length, q[1] / length, q[2] / length, q[3] / length] : kIdentity;
}

export function rotate(q: Quaternion, v: Vector3): Vector3 {
  const u: Vector3 = [q[1], q[2], q[3]];
  const t = scale(cross(u, v), 2);
  return add(add(v, scale(t, q[0])), cross(u, t));
}

/** Rotation by the vector `r`: axis times angle [rad]. */
export function exponential(r: Vector3): Quaternion {
  const angle = norm(r);
  const s = angle > 1e-9 ? Math.sin(angle / 2) / angle : 0.5;
  return normalized([Math.cos(angle / 2), r[0] * s, r[1] * s, r[2] * s]);
}

/** Axis times angle of the shorter rotation [rad], at most pi. */
export function logarithm(q: Quaternion): Vector3 {
  const sign = q[0] < 0 ? -1 : 1;
  const u: Vector3 = [q[1] * sign, q[2] * sign, q[3] * sign];
  const s = norm(u);
  return scale(u, s > 1e-9 ? (2 * Math.atan2(s, q[0] * sign)) / s : 2);
}
