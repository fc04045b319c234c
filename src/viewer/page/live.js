// SPDX-License-Identifier: BSD-3-Clause
// What a run sends while it is made, and what the page asks of it.

class LiveFeed {
  constructor(viewer) {
    this.viewer = viewer;
    const paused = () => byId("pause").getAttribute("aria-pressed") === "true";
    byId("pause").addEventListener("click", () => viewer.renderer.pause(!paused()));
    byId("save").addEventListener("click", () => this.save());
  }

  begin(scene) {
    byId("live").hidden = !scene.live;
    byId("pause").hidden = !scene.can_pause;
    byId("save").hidden = !scene.can_save;
    byId("save").disabled = false;
  }

  message(message) {
    const { scene } = this.viewer;
    const { type } = message;
    if (["loops", "beams", "sensors"].includes(type)) scene[type] = message[type];
    if (type === "pings") addPings(scene, message);
    if (["loops", "beams", "sensors", "pings"].includes(type)) {
      this.viewer.showTracks();
      this.viewer.redraw();
    }
    if (type === "poses") this.addPoses(message);
    if (type === "map") this.mapChanged(message);
    if (type === "saved") this.saved(message.error);
    if (type === "status") {
      showRates(message.figures);
      byId("pause").setAttribute("aria-pressed", String(message.paused));
    }
  }

  addPoses(message) {
    const { viewer } = this;
    const { scene } = viewer;
    const atEnd = viewer.time >= 0.999;
    const last = scene.stamps.length > 0 ? scene.stamps[scene.stamps.length - 1] : -Infinity;
    const from = message.stamps.findIndex((stamp) => stamp > last); // the scene may have the first ones
    if (from < 0) return;
    const began = scene.poses.length === 0;
    for (const name of ["stamps", "poses", "states"]) scene[name].push(...message[name].slice(from));
    if (atEnd || began) viewer.time = 1;
    viewer.showTrace();
    viewer.changed();
  }

  // The map has grown: its extent, and the keyframes as corrected.
  mapChanged(map) {
    const { viewer } = this;
    const first = viewer.scene.gaussians === 0;
    Object.assign(viewer.scene, { gaussians: map.gaussians, medium: map.medium, center: map.center,
      radius_m: map.radius_m, keyframes: map.keyframes });
    viewer.camera.radius = map.radius_m;
    viewer.showMedium();
    if (first) viewer.begin();
    viewer.notice();
    viewer.facts();
  }

  save() {
    byId("save").disabled = true;
    byId("saved").textContent = "The map is being saved.";
    this.viewer.renderer.save();
  }

  saved(error) {
    byId("save").disabled = false;
    const time = new Date().toTimeString().slice(0, 8);
    byId("saved").textContent = error ? `Not saved: ${error}.` : `Saved at ${time}: map.ply and checkpoint.pt.`;
  }

  cameraImage(blob) {
    const image = byId("camera");
    URL.revokeObjectURL(image.src);
    image.src = URL.createObjectURL(blob);
    image.hidden = false;
  }
}
