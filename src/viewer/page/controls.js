// SPDX-License-Identifier: BSD-3-Clause
// The camera, and how mouse, touch and keyboard move it.

const FLY_KEYS = { w: [0, 0, 1], s: [0, 0, -1], a: [-1, 0, 0], d: [1, 0, 0], q: [0, 1, 0], e: [0, -1, 0],
  arrowup: [0, 0, 1], arrowdown: [0, 0, -1], arrowleft: [-1, 0, 0], arrowright: [1, 0, 0] };

class Camera {
  constructor() {
    this.mode = "orbit";
    this.q = [1, 0, 0, 0];
    this.p = [0, 0, 0];
    this.target = [0, 0, 1];
    this.look = [1, 0, 0, 0]; // against the vehicle's camera, in mode follow
    this.behind = 0; // distance from it [m]
    this.up = [0, 0, 1];
    this.radius = 1;
  }

  // Looks at the whole map from a side and above.
  reset(scene) {
    this.up = scene.up;
    this.radius = scene.radius_m;
    this.target = scene.center;
    this.look = [1, 0, 0, 0];
    this.behind = 0;
    const side = unit(cross(this.up, Math.abs(this.up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
    const back = unit(add(times(side, 0.8), times(this.up, 0.7)));
    this.p = add(this.target, times(back, 1.7 * this.radius));
    this.q = looking(times(back, -1), this.up);
  }

  set(pose, distance) {
    this.q = rotationOf(pose);
    this.p = placeOf(pose);
    this.target = add(this.p, rotate(this.q, [0, 0, distance]));
  }

  pose(vehicle) {
    if (this.mode !== "follow" || !vehicle) return poseOf(this.q, this.p);
    const q = normalized(multiply(rotationOf(vehicle), this.look));
    return poseOf(q, add(placeOf(vehicle), rotate(q, [0, 0, -this.behind])));
  }

  // Keeps what is seen when the mode changes.
  change(mode, vehicle) {
    const pose = this.pose(vehicle);
    const depth = clamp(norm(subtract(this.target, this.p)), 0.1 * this.radius, 3 * this.radius);
    if (this.mode === "follow" || mode === "orbit") this.set(pose, depth);
    this.mode = mode;
  }

  turn(dx, dy) {
    if (this.mode === "follow") {
      this.look = normalized(multiply(multiply(about([0, 1, 0], -dx), this.look), about([1, 0, 0], dy)));
      return;
    }
    const sign = this.mode === "orbit" ? 1 : -1;
    const yaw = about(this.up, -sign * dx);
    const right = rotate(this.q, [1, 0, 0]);
    const pitch = about(right, this.limited(-sign * dy));
    const turned = multiply(yaw, pitch);
    this.q = normalized(multiply(turned, this.q));
    if (this.mode === "orbit") this.p = add(this.target, rotate(turned, subtract(this.p, this.target)));
  }

  // An angle of pitch that does not turn the camera over.
  limited(angle) {
    const forward = rotate(this.q, [0, 0, 1]);
    const elevation = Math.asin(clamp(dot(forward, this.up), -1, 1));
    return clamp(elevation + angle, -1.5, 1.5) - elevation;
  }

  pan(dx, dy, focal_px) {
    if (this.mode === "follow") return;
    const distance = norm(subtract(this.target, this.p));
    const shift = rotate(this.q, [-dx * distance / focal_px, -dy * distance / focal_px, 0]);
    this.p = add(this.p, shift);
    this.target = add(this.target, shift);
  }

  zoom(factor) {
    if (this.mode === "follow") {
      this.behind = clamp((this.behind + 0.02 * this.radius) * factor - 0.02 * this.radius, 0, 3 * this.radius);
      return;
    }
    const arm = subtract(this.p, this.target);
    if (this.mode === "orbit") {
      this.p = add(this.target, times(arm, clamp(norm(arm) * factor, 0.02 * this.radius, 20 * this.radius) / norm(arm)));
      return;
    }
    this.move([0, 0, 1], (1 - factor) * 0.5 * this.radius);
  }

  move(direction, distance) {
    const shift = times(rotate(this.q, direction), distance);
    this.p = add(this.p, shift);
    this.target = add(this.target, shift);
  }
}

// Calls `moved()` after every change of the camera and `clicked(x, y, twice)` for clicks.
class Controls {
  constructor(stage, camera, moved, clicked) {
    Object.assign(this, { stage, camera, moved, clicked, pointers: new Map(), keys: new Set(), travel: 0 });
    stage.addEventListener("pointerdown", (e) => this.down(e));
    stage.addEventListener("pointermove", (e) => this.move(e));
    for (const type of ["pointerup", "pointercancel"]) stage.addEventListener(type, (e) => this.up(e));
    stage.addEventListener("wheel", (e) => this.wheel(e), { passive: false });
    stage.addEventListener("contextmenu", (e) => e.preventDefault());
    addEventListener("keydown", (e) => this.key(e, true));
    addEventListener("keyup", (e) => this.key(e, false));
    addEventListener("blur", () => this.keys.clear());
  }

  get dragging() { return this.pointers.size > 0; }

  down(event) {
    this.stage.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.travel = this.pointers.size > 1 ? Infinity : 0;
    this.stage.classList.add("dragging");
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    if (this.pointers.size === 1) this.drag(event, now[0] - before[0], now[1] - before[1]);
    else this.pinch(event.pointerId, before, now);
    this.pointers.set(event.pointerId, now);
    if (this.travel > 4) this.moved();
  }

  drag(event, dx, dy) {
    this.travel += Math.abs(dx) + Math.abs(dy);
    if (this.travel <= 4) return;
    const pans = event.shiftKey || (event.buttons & 6) !== 0;
    const scale = Math.PI / this.stage.clientHeight;
    if (pans) this.camera.pan(dx, dy, this.stage.clientHeight);
    else this.camera.turn(dx * scale, dy * scale);
  }

  // Two fingers: their distance zooms, their middle pans.
  pinch(id, before, now) {
    const other = [...this.pointers].find(([key]) => key !== id)[1];
    const length = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
    this.camera.zoom(length(before) / length(now));
    this.camera.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2, this.stage.clientHeight);
  }

  up(event) {
    if (!this.pointers.delete(event.pointerId)) return;
    if (this.pointers.size === 0) this.stage.classList.remove("dragging");
    if (event.type === "pointerup" && this.travel <= 4 && event.button === 0) this.click(event);
    else this.moved();
  }

  click(event) {
    const { time, x, y } = this.last || { time: -1e9, x: 0, y: 0 };
    const twice = event.timeStamp - time < 350 && Math.hypot(event.clientX - x, event.clientY - y) < 24;
    this.last = { time: twice ? -1e9 : event.timeStamp, x: event.clientX, y: event.clientY };
    this.clicked(event.clientX, event.clientY, twice);
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    this.camera.zoom(Math.exp(clamp(event.deltaY * lines, -200, 200) * 0.0015));
    this.moved();
  }

  key(event, pressed) {
    const name = event.key.toLowerCase();
    if (event.ctrlKey || event.metaKey || event.altKey || !(name in FLY_KEYS || name === "shift")) return;
    if (pressed && event.target instanceof HTMLInputElement && name.startsWith("arrow")) return;
    if (pressed) this.keys.add(name);
    else this.keys.delete(name);
  }

  // Flies for `dt` seconds; whether the camera moved.
  advance(dt) {
    const direction = [...this.keys].reduce((sum, name) => add(sum, FLY_KEYS[name] || [0, 0, 0]), [0, 0, 0]);
    if (norm(direction) === 0 || this.camera.mode === "follow") return false;
    const speed = (this.keys.has("shift") ? 1.2 : 0.35) * this.camera.radius;
    this.camera.move(unit(direction), speed * dt);
    return true;
  }
}
