// SPDX-License-Identifier: BSD-3-Clause
// Cuts through the map: what lies between two parallel planes, vertical or horizontal.

const REACH = 1.5; // of position and outline, in radii of the map

class SectionTool {
  // `changed()`: the section is another one; `look(pose)`: a camera in front of it is asked for.
  constructor(changed, look) {
    Object.assign(this, { changed, look, kind: "none", section: null, scene: null });
    this.kinds = new Choice(byId("section-kinds"), (kind) => this.choose(kind));
    this.kinds.set(this.kind);
    for (const name of ["position", "thickness", "direction"]) {
      byId(`section-${name}`).addEventListener("input", () => this.set());
    }
    byId("section-look").addEventListener("click", () => this.section && this.look(this.front()));
  }

  choose(kind) {
    this.kind = kind;
    this.kinds.set(kind);
    byId("section-rows").hidden = kind === "none";
    byId("section-direction-row").hidden = kind !== "vertical";
    this.set();
  }

  slider(name) { return Number(byId(`section-${name}`).value); }

  normal() {
    const { up } = this.scene;
    if (this.kind === "horizontal") return up;
    const side = unit(cross(up, Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
    return rotate(about(up, this.slider("direction") * Math.PI / 180), side);
  }

  // In meters from now on: a map that grows does not move it.
  set() {
    if (!this.scene) return;
    const { center, radius_m } = this.scene;
    const [position, thickness] = [this.slider("position") * REACH * radius_m, radius_m * 10 ** this.slider("thickness")];
    byId("section-position-value").textContent = `${position.toFixed(2)} m`;
    byId("section-thickness-value").textContent = distanceText(thickness);
    byId("section-direction-value").textContent = `${this.slider("direction")}°`;
    const normal = this.kind === "none" ? null : this.normal();
    this.section = normal && { normal, offset: dot(normal, center) + position, thickness };
    this.changed();
  }

  // A camera that sees the section from the side that is nearer to the top.
  front() {
    const { normal, offset } = this.section;
    const { center, radius_m, up } = this.scene;
    const middle = add(center, times(normal, offset - dot(normal, center)));
    return poseOf(looking(times(normal, -1), up), add(middle, times(normal, 2 * radius_m)));
  }

  // Corners of the two planes, each around.
  outline() {
    if (!this.section) return [];
    const { normal, offset, thickness } = this.section;
    const { center, radius_m, up } = this.scene;
    const x = unit(cross(normal, Math.abs(dot(normal, up)) < 0.9 ? up : [up[1], up[2], up[0]]));
    const y = cross(normal, x);
    return [-0.5, 0.5].map((side) => {
      const middle = add(center, times(normal, offset + side * thickness - dot(normal, center)));
      return [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([a, b]) => add(middle,
        times(add(times(x, a), times(y, b)), REACH * radius_m)));
    });
  }
}
