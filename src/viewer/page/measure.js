// SPDX-License-Identifier: BSD-3-Clause
// The measuring tool: points that are clicked on the surface, and the lengths and areas between them.

const areaText = (m2) => (m2 < 0.01 ? `${(1e4 * m2).toFixed(1)} cm²` : m2 < 10 ? `${m2.toFixed(3)} m²` : `${m2.toFixed(2)} m²`);

// Length of the way along the points; `closed`: back to the first one.
function pathLength(points, closed) {
  let sum = 0;
  for (let i = 1; i < points.length; ++i) sum += norm(subtract(points[i], points[i - 1]));
  return closed && points.length > 2 ? sum + norm(subtract(points[0], points[points.length - 1])) : sum;
}

const centroid = (points) => times(points.reduce(add, [0, 0, 0]), 1 / points.length);

// Area of the triangles between the edges and the centroid. Those that turn the other way than most count
// against them, so that the area of a plane polygon is right even where it is not convex.
function polygonArea(points) {
  if (points.length < 3) return 0;
  const center = centroid(points);
  const halves = points.map((p, i) => times(
    cross(subtract(p, center), subtract(points[(i + 1) % points.length], center)), 0.5));
  const normal = unit(halves.reduce(add, [0, 0, 0]));
  return Math.abs(halves.reduce((sum, half) => sum + (dot(half, normal) < 0 ? -norm(half) : norm(half)), 0));
}

class MeasureTool {
  // `changed()`: the points are to be drawn anew; `center()`: adds the point in the middle of the image.
  constructor(changed, center) {
    Object.assign(this, { changed, active: false, kind: "distance", points: [], up: [0, 0, 1] });
    this.kinds = new Choice(byId("measure-kinds"), (kind) => this.choose(kind));
    this.kinds.set(this.kind);
    byId("measure").addEventListener("click", () => this.set(!this.active));
    byId("measure-center").addEventListener("click", center);
    byId("measure-undo").addEventListener("click", () => this.undo());
    byId("measure-clear").addEventListener("click", () => this.clear());
    byId("measure-end").addEventListener("click", () => this.set(false));
  }

  set(active) {
    if (active === this.active) return;
    this.active = active;
    byId("measure").setAttribute("aria-pressed", String(active));
    byId("stage").classList.toggle("measuring", active);
    byId("measure-bar").hidden = !active;
    this.clear();
  }

  choose(kind) {
    this.kind = kind;
    this.kinds.set(kind);
    this.show();
  }

  // `point`: of the world, or null where no surface is.
  add(point) {
    if (!this.active) return;
    if (point) this.points.push(point);
    this.show(point ? "" : "No surface there.");
  }

  undo() {
    this.points.pop();
    this.show();
  }

  clear() {
    this.points = [];
    this.show();
  }

  // The figure of these points, or nothing while there are too few.
  figure() {
    if (this.kind === "area") return this.points.length > 2 ? areaText(polygonArea(this.points)) : "";
    return this.points.length > 1 ? distanceText(pathLength(this.points)) : "";
  }

  details() {
    if (this.kind === "area") return `perimeter ${distanceText(pathLength(this.points, true))}`;
    const ends = subtract(this.points[this.points.length - 1], this.points[0]);
    const height = `height ${distanceText(Math.abs(dot(ends, this.up)))}`;
    return this.points.length > 2 ? `along ${this.points.length} points · straight ${distanceText(norm(ends))} · ${height}` : height;
  }

  hint() {
    const verb = touch ? "Tap" : "Click";
    const left = (this.kind === "area" ? 3 : 2) - this.points.length;
    const what = ["", "another point", "two points", "three points or more around a surface"][left];
    return `${verb} ${what}${this.points.length > 0 && left > 1 ? " more" : ""}.`;
  }

  show(problem) {
    const box = byId("measured");
    const figure = this.figure();
    box.replaceChildren();
    if (figure) {
      const bold = document.createElement("b");
      bold.textContent = figure;
      box.append(bold, ` ${this.details()}`);
    } else if (!problem) {
      box.append(this.hint());
    }
    if (problem) box.append(figure ? ` · ${problem}` : problem);
    byId("measure-undo").disabled = byId("measure-clear").disabled = this.points.length === 0;
    this.changed();
  }
}
