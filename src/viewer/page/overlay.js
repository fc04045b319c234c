// SPDX-License-Identifier: BSD-3-Clause
// What is drawn over the image: trajectory, keyframes, vehicle, loop closures, beams, measured points.

const STATES = {
  fused: ["fused", "#2fc0a2"],
  vio_only: ["vision alone", "#a6dccf"],
  up_to_scale: ["vision alone, up to scale", "#c9b6e4"],
  dipo_only: ["DVL alone", "#eab85f"],
  frozen: ["frozen", "#5f9ff0"],
  dropped: ["dropped", "#f0606b"],
  waiting: ["waiting", "#8a97a3"],
  "": ["trajectory", "#dbe2e8"],
};
const stateStyle = (state) => STATES[state] || [state.replace(/_/g, " "), "#dbe2e8"];
const NEAR = 0.05;
const LOOP_COLOR = "#ff8ad8";
const BEAM_COLOR = "#7cc7ff";

class Overlay {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
  }

  resize(width, height, ratio) {
    this.width = width;
    this.height = height;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
  }

  // `shown`: of each kind, whether; `vehicle`: pose of its camera or null; `measure`: a MeasureTool; `outline`:
  // polygons of the section; `loops`, `beams`: see dive.js.
  draw(view, scene, shown, { vehicle, measure, outline, loops, beams }) {
    this.context.clearRect(0, 0, this.width, this.height);
    if (!view || !scene) return;
    this.inverse = conjugate(rotationOf(view.pose));
    this.origin = placeOf(view.pose);
    this.focal = view.focal * this.height;
    for (const polygon of outline) this.polygon(polygon);
    if (shown.path) this.path(scene);
    if (shown.keyframes) this.keyframes(scene);
    if (shown.loops) this.loops(loops);
    if (shown.beams) this.beams(beams);
    if (shown.vehicle && vehicle) this.frustum(vehicle, scene, 0.03 * scene.radius_m, "#ffffff", 1.6);
    if (measure.active) this.measurement(measure);
  }

  toCamera(p) { return rotate(this.inverse, subtract(p, this.origin)); }
  toScreen(p) {
    return [this.width / 2 + this.focal * p[0] / p[2], this.height / 2 + this.focal * p[1] / p[2]];
  }

  // Part of a segment in front of the camera, in its frame.
  segment(a, b) {
    if (a[2] < NEAR && b[2] < NEAR) return;
    const cut = (p, q) => add(p, times(subtract(q, p), (NEAR - p[2]) / (q[2] - p[2])));
    const from = this.toScreen(a[2] < NEAR ? cut(a, b) : a);
    const to = this.toScreen(b[2] < NEAR ? cut(b, a) : b);
    this.context.moveTo(from[0], from[1]);
    this.context.lineTo(to[0], to[1]);
  }

  path(scene) {
    const seen = scene.poses.map((pose) => this.toCamera(placeOf(pose)));
    for (const state of new Set(scene.states)) {
      this.context.beginPath();
      for (let i = 1; i < seen.length; ++i) if (scene.states[i] === state) this.segment(seen[i - 1], seen[i]);
      this.line("rgba(0, 0, 0, .45)", 3.5);
      this.line(stateStyle(state)[1], 1.7);
    }
  }

  keyframes(scene) {
    const few = scene.keyframes.length <= 300;
    const size = 0.012 * scene.radius_m;
    this.context.fillStyle = "rgba(219, 226, 232, .85)";
    for (const pose of scene.keyframes) {
      const camera = compose(pose, scene.body_camera);
      if (few) this.frustum(camera, scene, size, "rgba(219, 226, 232, .7)", 1);
      else this.dot(placeOf(camera), 1.6);
    }
  }

  loops(lines) {
    this.context.beginPath();
    for (const ends of lines) this.segment(...ends.map((p) => this.toCamera(p)));
    this.line("rgba(0, 0, 0, .45)", 3);
    this.line(LOOP_COLOR, 1.3);
    this.context.fillStyle = LOOP_COLOR;
    for (const ends of lines) ends.forEach((p) => this.dot(p, 2));
  }

  // Dashed where the length is not measured, gray where the beam is invalid; a dot where one meets the bottom.
  beams(lines) {
    for (const { from, to, valid, measured } of lines) {
      const color = valid ? BEAM_COLOR : "#a9b3bc";
      this.context.beginPath();
      this.segment(this.toCamera(from), this.toCamera(to));
      this.context.setLineDash(measured ? [] : [6, 5]);
      this.line("rgba(0, 0, 0, .45)", 3.5);
      this.line(color, 1.7);
      this.context.setLineDash([]);
      this.context.fillStyle = color;
      if (measured && valid) this.dot(to, 3.5);
    }
  }

  polygon(points) {
    const seen = points.map((p) => this.toCamera(p));
    this.context.beginPath();
    seen.forEach((p, i) => this.segment(p, seen[(i + 1) % seen.length]));
    this.line("rgba(255, 255, 255, .28)", 1);
  }

  dot(point, radius) {
    const p = this.toCamera(point);
    if (p[2] < NEAR) return;
    this.context.beginPath();
    this.context.arc(...this.toScreen(p), radius, 0, 2 * Math.PI);
    this.context.fill();
  }

  frustum(pose, scene, size, color, width) {
    const y = size / (2 * scene.focal);
    const x = y * scene.aspect;
    const corners = [[-x, -y, size], [x, -y, size], [x, y, size], [-x, y, size]].map(
      (c) => this.toCamera(add(placeOf(pose), rotate(rotationOf(pose), c))));
    const tip = this.toCamera(placeOf(pose));
    this.context.beginPath();
    corners.forEach((corner, i) => {
      this.segment(tip, corner);
      this.segment(corner, corners[(i + 1) % 4]);
    });
    this.line(color, width);
  }

  line(color, width) {
    this.context.strokeStyle = color;
    this.context.lineWidth = width;
    this.context.lineJoin = "round";
    this.context.stroke();
  }

  measurement(measure) {
    const closed = measure.kind === "area" && measure.points.length > 2;
    const seen = measure.points.map((p) => this.toCamera(p));
    if (closed) this.surface(seen);
    this.context.beginPath();
    for (let i = 1; i < seen.length; ++i) this.segment(seen[i - 1], seen[i]);
    if (closed) this.segment(seen[seen.length - 1], seen[0]);
    this.line("rgba(0, 0, 0, .6)", 4);
    this.line("#ffd479", 1.8);
    this.context.fillStyle = "#ffd479";
    measure.points.forEach((p) => this.dot(p, 4));
    this.cross();
    const place = closed ? centroid(seen) : centroid(seen.slice(-2));
    if (measure.figure()) this.label(place, measure.figure());
  }

  // The polygon, unless a part of it is behind the camera.
  surface(seen) {
    if (seen.some((p) => p[2] < NEAR)) return;
    this.context.beginPath();
    for (const p of seen) this.context.lineTo(...this.toScreen(p));
    this.context.fillStyle = "rgba(255, 212, 121, .22)";
    this.context.fill();
  }

  // The middle of the image, where a point is put without a pointer.
  cross() {
    const [x, y] = [this.width / 2, this.height / 2];
    this.context.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      this.context.moveTo(x + 4 * dx, y + 4 * dy);
      this.context.lineTo(x + 11 * dx, y + 11 * dy);
    }
    this.line("rgba(0, 0, 0, .6)", 3.5);
    this.line("#ffd479", 1.5);
  }

  // `place`: in the camera frame.
  label(place, text) {
    if (place[2] < NEAR) return;
    const [u, v] = this.toScreen(place);
    this.context.font = "600 14px system-ui, sans-serif";
    const width = this.context.measureText(text).width;
    this.context.fillStyle = "rgba(10, 15, 19, .85)";
    this.context.fillRect(u - width / 2 - 7, v - 30, width + 14, 22);
    this.context.fillStyle = "#ffd479";
    this.context.fillText(text, u - width / 2, v - 14);
  }
}

const distanceText = (m) => (m < 0.1 ? `${(1000 * m).toFixed(1)} mm` : m < 10 ? `${m.toFixed(3)} m` : `${m.toFixed(2)} m`);
