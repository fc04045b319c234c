// SPDX-License-Identifier: BSD-3-Clause
// Vectors [x, y, z], unit quaternions [w, x, y, z], poses [w, x, y, z, x, y, z] that map a frame to the world.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const norm = (a) => Math.sqrt(dot(a, a));
const unit = (a) => times(a, 1 / (norm(a) || 1));
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const clamp = (x, low, high) => Math.min(high, Math.max(low, x));

function multiply(a, b) {
  return [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
    a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
  ];
}

function rotate(q, v) {
  const u = [q[1], q[2], q[3]];
  const t = times(cross(u, v), 2);
  return add(add(v, times(t, q[0])), cross(u, t));
}

const conjugate = (q) => [q[0], -q[1], -q[2], -q[3]];
const normalized = (q) => q.map((x) => x / (Math.hypot(...q) || 1));
const about = (axis, angle) => [Math.cos(angle / 2), ...times(unit(axis), Math.sin(angle / 2))];

const rotationOf = (pose) => pose.slice(0, 4);
const placeOf = (pose) => pose.slice(4, 7);
const poseOf = (q, p) => [...q, ...p];
const compose = (a, b) => poseOf(normalized(multiply(rotationOf(a), rotationOf(b))),
  add(placeOf(a), rotate(rotationOf(a), placeOf(b))));

// Spherical interpolation of the rotation (its linear approximation, renormalized), linear of the position.
function between(a, b, u) {
  const sign = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0 ? -1 : 1;
  const mixed = a.map((x, i) => x + u * ((i < 4 ? sign : 1) * b[i] - x));
  return poseOf(normalized(mixed.slice(0, 4)), mixed.slice(4));
}

// Rotation of a camera (x right, y down, z forward) that looks along `forward` with `up` toward the top.
function looking(forward, up) {
  const z = unit(forward);
  let x = cross(z, up);
  if (norm(x) < 1e-6) x = cross(z, Math.abs(z[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]);
  x = unit(x);
  return fromAxes(x, cross(z, x), z);
}

// Quaternion of the rotation matrix with these columns.
function fromAxes(x, y, z) {
  const trace = x[0] + y[1] + z[2];
  if (trace > 0) {
    const s = Math.sqrt(trace + 1) * 2;
    return normalized([s / 4, (y[2] - z[1]) / s, (z[0] - x[2]) / s, (x[1] - y[0]) / s]);
  }
  if (x[0] > y[1] && x[0] > z[2]) {
    const s = Math.sqrt(1 + x[0] - y[1] - z[2]) * 2;
    return normalized([(y[2] - z[1]) / s, s / 4, (y[0] + x[1]) / s, (z[0] + x[2]) / s]);
  }
  if (y[1] > z[2]) {
    const s = Math.sqrt(1 + y[1] - x[0] - z[2]) * 2;
    return normalized([(z[0] - x[2]) / s, (y[0] + x[1]) / s, s / 4, (z[1] + y[2]) / s]);
  }
  const s = Math.sqrt(1 + z[2] - x[0] - y[1]) * 2;
  return normalized([(x[1] - y[0]) / s, (z[0] + x[2]) / s, (z[1] + y[2]) / s, s / 4]);
}

// A point of the world as [u, v, depth] in pixels of a view of this size.
function project(view, width, height, point) {
  const p = rotate(conjugate(rotationOf(view.pose)), subtract(point, placeOf(view.pose)));
  const focal = view.focal * height;
  return [width / 2 + focal * p[0] / p[2], height / 2 + focal * p[1] / p[2], p[2]];
}
