// SPDX-License-Identifier: BSD-3-Clause
// The page: what is shown, from where, and when.

const MAX_PIXELS = 1.6e6; // of an image
const VIEWS_KEPT = 200; // that images may still come for
const SHOWN = ["path", "keyframes", "vehicle", "loops", "beams"]; // boxes of the panel

class Viewer {
  constructor() {
    Object.assign(this, { scene: null, layer: "seen", water: 1, time: 0, playing: false, viewId: 0,
      views: new Map(), shownView: null, dirty: true, rates: [], last: 0, changes: [-1e9, -1e9] });
    this.stage = byId("stage");
    this.image = byId("image");
    this.camera = new Camera();
    this.overlay = new Overlay(byId("overlay"));
    this.controls = new Controls(this.stage, this.camera, () => this.changed(), (...at) => this.clicked(...at));
    this.measure = new MeasureTool(() => this.redraw(), () => this.measureAt(innerWidth / 2, innerHeight / 2));
    this.section = new SectionTool(() => this.changed(), (pose) => this.lookFrom(pose));
    this.live = new LiveFeed(this);
    this.bind();
    this.resize();
    this.renderer = new Renderer({
      scene: (scene) => this.start(scene), frame: (image, header) => this.show(image, header),
      message: (message) => this.live.message(message), camera: (blob) => this.live.cameraImage(blob),
      connected: (yes) => notice(yes ? "" : "No connection to apvi. Trying again."),
    });
    requestAnimationFrame((now) => this.tick(now));
  }

  bind() {
    this.layers = new Choice(byId("layers"), (layer) => this.setLayer(layer));
    this.modes = new Choice(byId("modes"), (mode) => this.setMode(mode));
    byId("water").addEventListener("input", (e) => this.setWater(Number(e.target.value)));
    for (const name of SHOWN) {
      byId(`show-${name}`).addEventListener("change", () => this.redraw());
    }
    byId("measure").addEventListener("click", () => this.roomToMeasure());
    byId("screenshot").addEventListener("click", () => this.screenshot());
    byId("save-view").addEventListener("click", () => this.saveView());
    byId("reset").addEventListener("click", () => this.reset());
    byId("play").addEventListener("click", () => this.play(!this.playing));
    byId("time").addEventListener("input", (e) => this.setTime(Number(e.target.value)));
    byId("panel-toggle").addEventListener("click", () => this.togglePanel());
    addEventListener("resize", () => this.resize());
    new ResizeObserver(() => this.footChanged()).observe(byId("timeline"));
    addEventListener("keydown", (e) => this.key(e));
    if (this.isSmall()) this.togglePanel();
  }

  isSmall() { return innerWidth <= 720; }

  key(event) {
    if (this.measureKey(event)) return event.preventDefault();
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
    const layers = ["seen", "restored", "depth", "alpha", "normals"];
    const actions = {
      o: () => this.setMode("orbit"), g: () => this.setMode("fly"), f: () => this.setMode("follow"),
      m: () => byId("measure").click(), p: () => this.screenshot(), r: () => this.reset(),
      h: () => this.togglePanel(), escape: () => this.measure.set(false),
    };
    const name = event.key.toLowerCase();
    if (name in actions) actions[name]();
    if (layers[Number(name) - 1]) this.setLayer(layers[Number(name) - 1]);
    if (name === " " && !(event.target instanceof HTMLButtonElement)) {
      event.preventDefault();
      this.play(!this.playing);
    }
  }

  // What lies above the timeline follows its height.
  footChanged() {
    const box = byId("timeline").getBoundingClientRect();
    const style = document.documentElement.style;
    if (box.height > 0) style.setProperty("--foot", `${innerHeight - box.top}px`);
    else style.removeProperty("--foot");
  }

  // Whether a key is for the measuring tool: a point in the middle, and back.
  measureKey(event) {
    if (!this.measure.active) return false;
    const undo = event.key === "Backspace" || (event.key === "z" && (event.ctrlKey || event.metaKey));
    const point = event.key === "Enter" && !event.repeat && !event.target.closest("button, input");
    if (undo) this.measure.undo();
    if (point) byId("measure-center").click();
    return undo || point;
  }

  togglePanel() {
    const bare = document.body.classList.toggle("bare");
    byId("panel-toggle").setAttribute("aria-expanded", String(!bare));
  }

  // --- the scene ---

  start(scene) {
    const first = !this.scene;
    this.scene = scene;
    this.measure.up = scene.up;
    this.section.scene = scene;
    byId("name").textContent = scene.name;
    document.title = `${scene.name} · APVI-SLAM`;
    this.live.begin(scene);
    this.showMedium();
    this.showTrace();
    if (first) this.begin();
    this.notice();
    this.changed();
  }

  showMedium() {
    byId("water-row").hidden = !this.scene.medium;
    this.layers.enable("restored", this.scene.medium);
  }

  begin() {
    this.camera.reset(this.scene);
    this.setLayer("seen");
    const follow = this.scene.poses.length > 0;
    this.setMode(follow ? "follow" : "orbit");
  }

  notice() {
    if (this.scene.gaussians === 0) notice(this.scene.live ? "The map begins with the first keyframes." : "The map is empty.");
    else notice("");
  }

  showTrace() {
    const any = this.scene.poses.length > 0;
    byId("timeline").hidden = this.scene.poses.length < 2;
    byId("shown").hidden = !any && this.scene.keyframes.length === 0;
    this.modes.enable("follow", any);
    showLegend(this.scene.states);
    this.showTracks();
    this.setTime(this.time, true);
  }

  // Loops, beams and sensors, if there are any.
  showTracks() {
    byId("show-loops").parentElement.hidden = this.scene.loops.length === 0;
    byId("show-beams").parentElement.hidden = !this.scene.beams || this.scene.beams.stamps.length === 0;
    if (this.scene.poses.length > 1) drawStates(this.scene);
    drawSensors(this.scene);
  }

  // --- what is shown ---

  setLayer(layer) {
    this.layer = layer;
    this.layers.set(layer);
    byId("scale").hidden = layer !== "depth";
    byId("water-row").classList.toggle("off", layer !== "seen");
    this.changed();
  }

  setWater(amount) {
    this.water = amount;
    byId("water-value").textContent = `${Math.round(100 * amount)} %`;
    if (this.layer === "restored") this.setLayer("seen");
    this.changed();
  }

  setMode(mode) {
    if (!this.scene || (mode === "follow" && this.scene.poses.length === 0)) return;
    this.camera.change(mode, this.vehicle());
    this.modes.set(mode);
    byId("hint").textContent = HINTS[mode];
    this.changed();
  }

  lookFrom(pose) {
    this.setMode("orbit");
    this.camera.set(pose, 2 * this.scene.radius_m);
    this.changed();
  }

  reset() {
    if (!this.scene) return;
    const mode = this.camera.mode;
    this.camera.reset(this.scene);
    this.camera.mode = mode;
    this.measure.clear();
    this.changed();
  }

  // --- time ---

  play(playing) {
    this.playing = playing && this.scene && this.scene.poses.length > 1;
    if (this.playing && this.time >= 1) this.setTime(0);
    byId("play").setAttribute("aria-pressed", String(this.playing));
    this.changed();
  }

  // `time` from 0 to 1 of the trajectory.
  setTime(time, quiet) {
    this.time = clamp(time, 0, 1);
    byId("time").value = this.time;
    byId("timeline").style.setProperty("--time", this.time);
    const stamps = this.scene ? this.scene.stamps : [];
    const span = stamps.length > 1 ? stamps[stamps.length - 1] - stamps[0] : 0;
    byId("clock").textContent = `${clockText(this.time * span)} / ${clockText(span)}`;
    if (!quiet) this.changed();
  }

  // Pose of the vehicle's camera at the time, or null.
  vehicle() {
    const body = this.scene && bodyAt(this.scene, stampAt(this.scene, this.time));
    return body ? compose(body, this.scene.body_camera) : null;
  }

  advance(dt) {
    if (!this.playing) return false;
    const { stamps } = this.scene;
    this.setTime(this.time + dt / Math.max(1e-9, stamps[stamps.length - 1] - stamps[0]), true);
    if (this.time >= 1) this.play(false);
    return true;
  }

  // --- drawing ---

  resize() {
    const [width, height] = [innerWidth, innerHeight];
    this.ratio = Math.min(devicePixelRatio, Math.sqrt(MAX_PIXELS / (width * height)));
    this.footChanged();
    if (this.scene) this.showTracks();
    this.width = Math.max(1, Math.round(width * this.ratio));
    this.height = Math.max(1, Math.round(height * this.ratio));
    this.overlay.resize(width, height, devicePixelRatio);
    if (this.scene && this.scene.poses.length > 1) drawStates(this.scene);
    this.changed();
  }

  // The vertical angle of the vehicle's camera; more of it on a screen that is higher than wide.
  focal() { return this.scene.focal * Math.min(1, Math.sqrt(this.width / this.height)); }

  view() {
    return { id: this.viewId, width: this.width, height: this.height, focal: this.focal(), layer: this.layer,
      water: this.water, section: this.section.section, pose: this.camera.pose(this.vehicle()) };
  }

  changed() {
    this.dirty = true;
    this.changes = [this.changes[1], performance.now()];
  }

  tick(now) {
    const dt = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    const flies = this.controls.advance(dt);
    const plays = this.advance(dt);
    const often = this.changes[1] - this.changes[0] < 200; // as while a slider is dragged
    const moving = flies || plays || often || this.controls.dragging;
    if (this.scene && (this.dirty || flies || plays)) this.request(moving);
    requestAnimationFrame((next) => this.tick(next));
  }

  request(moving) {
    this.dirty = false;
    this.viewId += 1;
    const view = this.view();
    this.views.set(view.id, view);
    if (this.views.size > VIEWS_KEPT) this.views.delete(this.views.keys().next().value);
    this.renderer.draw(view, moving);
    if (this.scene.gaussians === 0) this.redraw(view);
  }

  show(image, header) {
    if (this.image.width !== this.width || this.image.height !== this.height) {
      Object.assign(this.image, { width: this.width, height: this.height });
    }
    const context = this.image.getContext("2d");
    context.imageSmoothingQuality = "high";
    context.drawImage(image, 0, 0, this.width, this.height);
    this.redraw(this.views.get(header.view));
    byId("scale-near").textContent = distanceText(header.near);
    byId("scale-far").textContent = distanceText(header.far);
    this.count(header);
    if (header.complete) document.body.dataset.complete = header.view;
  }

  // The overlay belongs to the view of the image, not to the newest one.
  redraw(view) {
    this.shownView = view || this.shownView;
    if (!this.scene) return;
    const shown = {};
    for (const name of SHOWN) shown[name] = byId(`show-${name}`).checked;
    const inside = this.camera.mode === "follow" && this.camera.behind === 0;
    this.overlay.draw(this.shownView, this.scene, shown, {
      vehicle: inside ? null : this.vehicle(), measure: this.measure, outline: inside ? [] : this.section.outline(),
      loops: loopLines(this.scene), beams: beamLines(this.scene, this.time),
    });
  }

  count(header) {
    const now = performance.now();
    this.rates = this.rates.filter((t) => now - t < 1000);
    this.rates.push(now);
    this.drawnSize = header ? `${header.width} × ${header.height}` : this.drawnSize;
    this.facts();
    document.body.dataset.frames = Number(document.body.dataset.frames || 0) + 1;
  }

  facts() {
    const rate = this.rates.length > 2 ? ` · ${this.rates.length} frames/s` : "";
    byId("facts").textContent = `${countText(this.scene.gaussians)} Gaussians · ${this.drawnSize || ""}${rate}`;
  }

  // --- tools ---

  // The point of the map at a place of the window, or null.
  async pointAt(x, y) {
    const view = this.shownView;
    if (!view) return null;
    const column = clamp(Math.floor(x * view.width / innerWidth), 0, view.width - 1);
    const row = clamp(Math.floor(y * view.height / innerHeight), 0, view.height - 1);
    return (await this.renderer.measure(view, column, row)).point;
  }

  async clicked(x, y, twice) {
    if (this.measure.active) {
      if (!twice) await this.measureAt(x, y);
    } else if (twice && this.camera.mode === "orbit") {
      const point = await this.pointAt(x, y);
      if (point) this.turnAbout(point);
    }
  }

  async measureAt(x, y) { this.measure.add(await this.pointAt(x, y)); }

  // On a phone the panel would cover the surface.
  roomToMeasure() {
    if (this.measure.active && this.isSmall() && !document.body.classList.contains("bare")) this.togglePanel();
  }

  turnAbout(point) {
    const distance = norm(subtract(point, this.camera.p));
    this.camera.q = looking(subtract(point, this.camera.p), this.camera.up);
    this.camera.target = add(this.camera.p, rotate(this.camera.q, [0, 0, distance]));
    this.changed();
  }

  async screenshot() {
    if (this.scene) download(await this.renderer.snapshot(this.view()), `${this.scene.name}.png`);
  }

  saveView() {
    if (!this.scene) return;
    download(new Blob([cameraFile(this.view(), this.scene.origin)], { type: "application/json" }), "camera.json");
  }
}

const viewer = new Viewer();
