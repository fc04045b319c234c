// SPDX-License-Identifier: BSD-3-Clause
// The server, which draws. Its messages are described in docs/viewer.md.

const KINDS = { 1: "frame", 2: "snapshot", 3: "camera" };
const HEADER_BYTES = 24;

class Renderer {
  // `events`: scene(scene), message(json), frame(image, header), camera(blob), connected(bool).
  constructor(events) {
    Object.assign(this, { events, replies: new Map(), nextId: 1, wait: 500, latest: null });
    this.connect();
  }

  connect() {
    const url = new URL("socket" + location.search, location.href);
    url.protocol = url.protocol.replace("http", "ws");
    this.socket = new WebSocket(url);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.wait = 500;
      this.events.connected(true);
      if (this.latest) this.send(this.latest);
    };
    this.socket.onclose = () => {
      this.events.connected(false);
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(5000, 2 * this.wait);
    };
    this.socket.onmessage = (event) => {
      if (typeof event.data === "string") this.text(JSON.parse(event.data));
      else this.image(event.data);
    };
  }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  text(message) {
    if (message.type === "scene") this.events.scene(message);
    else if (message.type === "point") this.reply(message.id, message);
    else this.events.message(message);
  }

  async image(data) {
    const bytes = new DataView(data);
    const header = {
      kind: KINDS[bytes.getUint8(0)], complete: bytes.getUint8(2) === 1,
      id: bytes.getUint32(4, true), view: bytes.getUint32(8, true),
      width: bytes.getUint16(12, true), height: bytes.getUint16(14, true),
      near: bytes.getFloat32(16, true), far: bytes.getFloat32(20, true),
    };
    const type = header.kind === "snapshot" ? "image/png" : "image/jpeg";
    const blob = new Blob([new Uint8Array(data, HEADER_BYTES)], { type });
    if (header.kind === "snapshot") return this.reply(header.id, blob);
    if (header.kind === "camera") return this.events.camera(blob);
    const image = await createImageBitmap(blob);
    this.events.frame(image, header);
    image.close();
    return this.send({ type: "drawn", frame: header.id });
  }

  reply(id, value) {
    const resolve = this.replies.get(id);
    this.replies.delete(id);
    if (resolve) resolve(value);
  }

  ask(message) {
    const id = this.nextId++;
    this.send({ ...message, id });
    return new Promise((resolve) => this.replies.set(id, resolve));
  }

  draw(view, moving) {
    this.latest = { type: "view", moving: false, ...view };
    this.send({ ...this.latest, moving });
  }

  snapshot(view) { return this.ask({ type: "snapshot", ...view }); }
  measure(view, column, row) { return this.ask({ type: "measure", ...view, column, row }); }
  save() { this.send({ type: "save" }); }
  pause(paused) { this.send({ type: "pause", paused }); }
}
