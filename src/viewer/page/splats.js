// SPDX-License-Identifier: BSD-3-Clause
// Draws the Gaussians of the page itself with WebGL2: sorted, instanced quads, blended from back to front
// (Zwicker et al., "EWA splatting", 2002; Kerbl et al., 2023). Colors are those of SH degree 0, and the
// medium acts on each Gaussian at its own range.

const SPLAT_BYTES = 36; // see export_page.hpp
const TEXELS = 4; // of a Gaussian
const ROW = 1024; // Gaussians in a row of the texture
const COLOR_RANGE = 4;
const LAYERS = ["seen", "restored", "depth", "alpha"];
const LOW_PASS_PX2 = 0.3;

const VERTEX = `#version 300 es
precision highp float;
precision highp int;
uniform highp sampler2D splats;
uniform mat3 rotation; // world to camera
uniform vec3 origin, beta_d, beta_b, b_inf, gains;
uniform vec4 section; // normal and offset
uniform float half_thickness; // negative: the whole map
uniform vec2 size, depths;
uniform float focal, water, antialiased;
uniform int layer;
in vec2 corner;
in uint index;
out vec2 place;
out vec4 color;

vec4 texel(int i) {
  int n = int(index);
  return texelFetch(splats, ivec2((n % ${ROW}) * ${TEXELS} + i, n / ${ROW}), 0);
}

// Polynomial of Google's color map Turbo (Mikhailov, 2019).
vec3 turbo(float x) {
  vec4 v = vec4(1.0, x, x * x, x * x * x);
  vec2 w = v.zw * v.z;
  return vec3(
    dot(v, vec4(0.13572138, 4.61539260, -42.66032258, 132.13108234)) + dot(w, vec2(-152.94239396, 59.28637943)),
    dot(v, vec4(0.09140261, 2.19418839, 4.84296658, -14.18503333)) + dot(w, vec2(4.27729857, 2.82956604)),
    dot(v, vec4(0.10667330, 12.64194608, -60.58204836, 110.36276771)) + dot(w, vec2(-89.90310912, 27.34824973)));
}

vec3 compressed(vec3 c) { return mix(c, 1.0 - 0.2 * exp(-(c - 0.8) / 0.2), step(0.8, c)); }

vec3 shown(vec3 c, vec3 p) {
  if (layer == 2) return turbo(clamp((p.z - depths.x) / (depths.y - depths.x), 0.0, 1.0));
  if (layer == 3) return vec3(1.0);
  float amount = layer == 1 ? 0.0 : water;
  float range = length(p);
  vec3 seen = c * exp(-amount * beta_d * range) + b_inf * (1.0 - exp(-amount * beta_b * range));
  if (amount >= 1.0) return seen;
  vec3 exposed = seen * pow(gains, vec3(1.0 - amount));
  return mix(compressed(exposed), exposed, amount);
}

void main() {
  vec4 a = texel(0), b = texel(1), c = texel(2), d = texel(3);
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0); // outside
  if (half_thickness >= 0.0 && abs(dot(section.xyz, a.xyz) - section.w) > half_thickness) return;
  vec3 p = rotation * (a.xyz - origin);
  if (p.z < 0.01) return;
  vec2 limit = 0.65 * size / focal;
  vec2 ray = clamp(p.xy / p.z, -limit, limit);
  mat3 J = mat3(focal / p.z, 0.0, 0.0, 0.0, focal / p.z, 0.0, -focal * ray.x / p.z, -focal * ray.y / p.z, 0.0);
  mat3 covariance = mat3(b.x, b.y, b.z, b.y, b.w, c.x, b.z, c.x, c.y);
  mat3 M = J * rotation;
  mat3 S = M * covariance * transpose(M);
  float before = S[0][0] * S[1][1] - S[0][1] * S[0][1];
  float xx = S[0][0] + ${LOW_PASS_PX2}, yy = S[1][1] + ${LOW_PASS_PX2}, xy = S[0][1];
  float det = xx * yy - xy * xy;
  float opacity = a.w * (antialiased > 0.5 ? sqrt(max(0.0, before / det)) : 1.0);
  float mean = 0.5 * (xx + yy);
  float spread = sqrt(max(1e-9, mean * mean - det));
  vec2 axis = abs(xy) < 1e-9 ? (xx >= yy ? vec2(1.0, 0.0) : vec2(0.0, 1.0)) : normalize(vec2(xy, mean + spread - xx));
  vec2 radii = sqrt(vec2(mean + spread, max(1e-4, mean - spread)));
  if (opacity < 1.0 / 255.0) return;
  float cutoff = sqrt(2.0 * log(255.0 * opacity));
  place = corner * cutoff;
  vec2 pixel = 0.5 * size + focal * p.xy / p.z + axis * place.x * radii.x + vec2(-axis.y, axis.x) * place.y * radii.y;
  color = vec4(shown(d.rgb, p), opacity);
  gl_Position = vec4(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y, 0.0, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
in vec4 color;
out vec4 result;
void main() {
  float alpha = min(0.99, color.a * exp(-0.5 * dot(place, place)));
  if (alpha < 1.0 / 255.0) discard;
  result = vec4(color.rgb * alpha, alpha);
}`;

function decoded(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
  return new DataView(bytes.buffer);
}

// Texels [x, y, z, opacity], [xx, xy, xz, yy], [yz, zz, -, -] of the covariance, [r, g, b, -].
function texture(bytes, count) {
  const rows = Math.max(1, Math.ceil(count / ROW));
  const out = new Float32Array(rows * ROW * TEXELS * 4);
  for (let i = 0; i < count; ++i) {
    const at = i * SPLAT_BYTES;
    const f = (k) => bytes.getFloat32(at + 4 * k, true);
    const q = normalized([0, 1, 2, 3].map((k) => (bytes.getUint8(at + 24 + k) - 128) / 127));
    const h = (k) => bytes.getUint16(at + 28 + 2 * k, true) / 65535;
    const axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((e, k) => times(rotate(q, e), f(3 + k)));
    const c = (r, s) => axes.reduce((sum, axis) => sum + axis[r] * axis[s], 0);
    out.set([f(0), f(1), f(2), h(3), c(0, 0), c(0, 1), c(0, 2), c(1, 1), c(1, 2), c(2, 2), 0, 0,
      COLOR_RANGE * h(0), COLOR_RANGE * h(1), COLOR_RANGE * h(2), 0], i * TEXELS * 4);
  }
  return { out, rows };
}

class Renderer {
  // Has the interface of link.js, without a server.
  constructor(events) {
    this.events = events;
    this.scene = JSON.parse(byId("scene-data").textContent);
    this.count = this.scene.gaussians;
    this.canvas = document.createElement("canvas");
    this.gl = this.canvas.getContext("webgl2", { antialias: false, alpha: false });
    if (!this.gl) return void setTimeout(() => notice("This browser has no WebGL2."));
    this.prepare();
    setTimeout(() => {
      document.body.classList.add("static");
      byId("layers").querySelector('[data-value="normals"]').hidden = true;
      events.scene(this.scene);
    });
  }

  prepare() {
    const gl = this.gl;
    const { out, rows } = texture(decoded(byId("splat-data").textContent), this.count);
    byId("splat-data").remove();
    this.data = out;
    this.program = this.linked();
    gl.useProgram(this.program);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, ROW * TEXELS, rows, 0, gl.RGBA, gl.FLOAT, out);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    this.attribute("corner", new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), 2, 0);
    this.order = new Uint32Array(this.count);
    this.attribute("index", this.order, 1, 1);
    this.keys = new Uint16Array(this.count);
    this.depths = new Float32Array(this.count);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  linked() {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  attribute(name, values, size, divisor) {
    const gl = this.gl;
    const place = gl.getAttribLocation(this.program, name);
    this.buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, divisor ? gl.DYNAMIC_DRAW : gl.STATIC_DRAW);
    gl.enableVertexAttribArray(place);
    if (divisor) gl.vertexAttribIPointer(place, size, gl.UNSIGNED_INT, 0, 0);
    else gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
    gl.vertexAttribDivisor(place, divisor);
  }

  // Back to front, by counting depths in 65536 steps between the nearest and the farthest.
  sort(axis, origin) {
    let [low, high] = [Infinity, -Infinity];
    const offset = dot(axis, origin);
    for (let i = 0, at = 0; i < this.count; ++i, at += 4 * TEXELS) {
      const z = this.data[at] * axis[0] + this.data[at + 1] * axis[1] + this.data[at + 2] * axis[2] - offset;
      this.depths[i] = z;
      if (z < low) low = z;
      if (z > high) high = z;
    }
    const scale = 65535 / Math.max(1e-9, high - low);
    const starts = new Uint32Array(65537);
    for (let i = 0; i < this.count; ++i) {
      this.keys[i] = (high - this.depths[i]) * scale;
      ++starts[this.keys[i] + 1];
    }
    for (let k = 0; k < 65536; ++k) starts[k + 1] += starts[k];
    for (let i = 0; i < this.count; ++i) this.order[starts[this.keys[i]]++] = i;
  }

  // Whether the center of a Gaussian is in the section of the view, if it has one.
  isIn(section, i) {
    if (!section) return true;
    const at = 4 * TEXELS * i;
    return Math.abs(dot(section.normal, this.data.subarray(at, at + 3)) - section.offset) <= section.thickness / 2;
  }

  // Depths between which 96 % of the Gaussians that are seen are.
  limits(section) {
    const ahead = this.order.filter((i) => this.depths[i] > 0.05 && this.isIn(section, i));
    if (ahead.length === 0) return [0, 1];
    const at = (part) => this.depths[ahead[Math.floor((1 - part) * (ahead.length - 1))]];
    return [at(0.02), Math.max(at(0.98), at(0.02) * 1.01)];
  }

  uniforms(view, depths) {
    const gl = this.gl;
    const place = (name) => gl.getUniformLocation(this.program, name);
    const water = this.scene.water || { beta_d: [0, 0, 0], beta_b: [0, 0, 0], b_inf: [0, 0, 0] };
    const columns = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((e) => rotate(conjugate(rotationOf(view.pose)), e));
    gl.uniformMatrix3fv(place("rotation"), false, columns.flat());
    gl.uniform3fv(place("origin"), placeOf(view.pose));
    for (const name of ["beta_d", "beta_b", "b_inf"]) gl.uniform3fv(place(name), water[name]);
    gl.uniform3fv(place("gains"), this.scene.gains);
    gl.uniform2f(place("size"), view.width, view.height);
    gl.uniform2fv(place("depths"), depths);
    gl.uniform1f(place("focal"), view.focal * view.height);
    gl.uniform1f(place("water"), this.scene.water ? view.water : 1);
    gl.uniform1f(place("antialiased"), this.scene.antialiased ? 1 : 0);
    const { normal, offset, thickness } = view.section || { normal: [0, 0, 0], offset: 0, thickness: -1 };
    gl.uniform4f(place("section"), ...normal, offset);
    gl.uniform1f(place("half_thickness"), thickness / 2);
    gl.uniform1i(place("layer"), LAYERS.indexOf(view.layer));
    const open = view.layer === "seen" && view.water > 0 ? water.b_inf : [0, 0, 0];
    gl.clearColor(...open, 1);
  }

  paint(view) {
    const gl = this.gl;
    Object.assign(this.canvas, { width: view.width, height: view.height });
    this.sort(rotate(rotationOf(view.pose), [0, 0, 1]), placeOf(view.pose));
    const depths = view.layer === "depth" ? this.limits(view.section) : [0, 1];
    this.uniforms(view, depths);
    gl.viewport(0, 0, view.width, view.height);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, this.order);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.count);
    return depths;
  }

  draw(view) {
    const [near, far] = this.paint(view);
    this.events.frame(this.canvas, { view: view.id, complete: true, width: view.width, height: view.height, near, far });
  }

  snapshot(view) {
    this.paint(view);
    return new Promise((resolve) => this.canvas.toBlob(resolve, "image/png"));
  }

  // Blends the depths of the Gaussians along the ray of a pixel, front to back.
  async measure(view, column, row) {
    const q = rotationOf(view.pose);
    const axis = rotate(q, [0, 0, 1]);
    this.sort(axis, placeOf(view.pose));
    const focal = view.focal * view.height;
    const ray = [(column + 0.5 - view.width / 2) / focal, (row + 0.5 - view.height / 2) / focal, 1];
    let [left, sum] = [1, 0];
    for (let k = this.count - 1; k >= 0 && left > 0.01; --k) {
      const alpha = this.alphaAt(this.order[k], view, q, ray);
      sum += left * alpha * this.depths[this.order[k]];
      left *= 1 - alpha;
    }
    if (left > 0.5) return { point: null };
    return { point: add(placeOf(view.pose), rotate(q, times(ray, sum / (1 - left)))) };
  }

  // Opacity of a Gaussian where the ray passes it nearest, in its own metric.
  alphaAt(i, view, q, ray) {
    const z = this.depths[i];
    if (z < 0.05 || !this.isIn(view.section, i)) return 0;
    const at = i * TEXELS * 4;
    const d = this.data;
    const offset = rotate(conjugate(q), subtract([d[at], d[at + 1], d[at + 2]], placeOf(view.pose)));
    const miss = Math.hypot(offset[0] - ray[0] * z, offset[1] - ray[1] * z);
    if (miss > 3.5 * Math.sqrt(d[at + 4] + d[at + 7] + d[at + 9])) return 0;
    const direction = rotate(q, ray);
    const inverse = inverseSymmetric(d.subarray(at + 4, at + 10));
    const away = subtract(placeOf(view.pose), [d[at], d[at + 1], d[at + 2]]);
    const [vv, va, aa] = [form(inverse, direction, direction), form(inverse, direction, away), form(inverse, away, away)];
    return Math.min(0.99, d[at + 3] * Math.exp(-0.5 * Math.max(0, aa - va * va / vv)));
  }

  pause() {}
  save() {}
}

// Of [xx, xy, xz, yy, yz, zz].
function inverseSymmetric([a, b, c, d, e, f]) {
  const det = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d) || 1e-30;
  return [d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b].map((x) => x / det);
}

const form = ([a, b, c, d, e, f], u, v) => dot(u, [a * v[0] + b * v[1] + c * v[2], b * v[0] + d * v[1] + e * v[2],
  c * v[0] + e * v[1] + f * v[2]]);
