// The engine of the interactive views: plain WebGL 2, nothing fetched. The report's page and the studio draw with it.
const View3d = (() => {
"use strict";
const $ = (selector, root = document) => root.querySelector(selector);
const all = (selector, root = document) => [...root.querySelectorAll(selector)];
const still = matchMedia("(prefers-reduced-motion: reduce)");

// ---- data ------------------------------------------------------------------------------------------------------
function bytes(text) {
  const raw = atob(text), out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out.buffer;
}
function readCloud(cloud) {
  if (!cloud) return null;
  const read = { ...cloud, steps: new Uint16Array(bytes(cloud.points)) };
  if (cloud.codes) read.codeBytes = new Uint8Array(bytes(cloud.codes));
  if (cloud.values) read.valueSteps = new Int16Array(bytes(cloud.values));
  return read;
}
function length(value, unit, digits = 3) {
  return `${Number(value.toPrecision(digits))} ${unit}`;
}
function nice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [5, 2, 1].find(f => f * power <= value * 1.0001) * power;
}

// ---- little linear algebra: 3x3 as rows, 3x4 motions row by row ------------------------------------------------
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const unitOf = a => scaled(a, 1 / Math.hypot(...a));
const moved = (T, p) => [0, 4, 8].map(r => T[r] * p[0] + T[r + 1] * p[1] + T[r + 2] * p[2] + T[r + 3]);
const STAND = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

function cameraAxes(yaw, pitch) {
  const y = yaw * Math.PI / 180, p = pitch * Math.PI / 180;
  const right = [Math.cos(y), Math.sin(y), 0];
  const towards = [Math.cos(p) * Math.sin(y), -Math.cos(p) * Math.cos(y), Math.sin(p)];
  return [right, cross(towards, right), towards];
}

// ---- shaders ---------------------------------------------------------------------------------------------------
const HEAD = `#version 300 es
precision highp float;
uniform mat3 motion; uniform vec3 shift; uniform mat3 turn; uniform vec3 middle; uniform vec2 zoom; uniform float lift;
vec3 toEye(vec3 p) { return turn * (motion * p + shift - middle); }
vec4 toClip(vec3 e) { return vec4(e.xy * zoom, -e.z / 64.0 - lift, 1.0); }
`;
const SHADERS = {
  solid: [HEAD + `
in vec3 place; uniform vec3 low, extent; out vec3 eye;
void main() { eye = toEye(low + extent * place); gl_Position = toClip(eye); }`, `#version 300 es
precision highp float;
in vec3 eye; uniform vec4 colour; out vec4 pixel;
void main() {
  vec3 n = normalize(cross(dFdx(eye), dFdy(eye)));
  if (n.z < 0.0) n = -n;
  float light = 0.34 + 0.5 * max(dot(n, normalize(vec3(-0.35, 0.55, 0.75))), 0.0) + 0.2 * max(dot(n, normalize(vec3(0.6, -0.1, 0.8))), 0.0);
  pixel = vec4(colour.rgb * light * 1.06, colour.a);
}`],
  line: [HEAD + `
in vec3 place; uniform vec3 low, extent;
void main() { gl_Position = toClip(toEye(low + extent * place)); }`, `#version 300 es
precision highp float;
uniform vec4 colour; out vec4 pixel;
void main() { pixel = colour; }`],
  dots: [HEAD + `
in vec3 place; in float code; uniform vec3 low, extent; uniform float size; out float shade;
void main() { gl_Position = toClip(toEye(low + extent * place)); gl_PointSize = size; shade = code; }`, `#version 300 es
precision highp float;
in float shade; uniform vec4 colour; uniform sampler2D table; uniform bool coded; out vec4 pixel;
void main() {
  vec2 r = gl_PointCoord - 0.5;
  if (dot(r, r) > 0.25) discard;
  vec3 c = coded ? texture(table, vec2((shade * 255.0 + 0.5) / 256.0, 0.5)).rgb : colour.rgb;
  pixel = vec4(c, 1.0);
}`],
};

function program(gl, [vertex, fragment]) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.bindAttribLocation(made, 0, "place");
  gl.bindAttribLocation(made, 1, "code");
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error("shader: " + gl.getProgramInfoLog(made));
  const places = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const name = gl.getActiveUniform(made, i).name;
    places[name] = gl.getUniformLocation(made, name);
  }
  return { made, places };
}

// ---- one canvas ------------------------------------------------------------------------------------------------
class View {
  constructor(box, scene, layers) {
    this.box = box; this.scene = scene; this.layers = layers;
    this.canvas = $("canvas", box);
    this.gl = this.canvas.getContext("webgl2", { alpha: false, antialias: true, preserveDrawingBuffer: true, ...this.constructor.context });
    if (!this.gl) throw new Error("no WebGL 2");
    this.T = STAND;
    this.labels = [];
    this.waiting = true;  // nothing is drawn before all is there
    this.home();
    this.upload();
    this.waiting = false;
    this.listen();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    this.canvas.addEventListener("webglcontextlost", e => e.preventDefault());
    this.canvas.addEventListener("webglcontextrestored", () => { this.upload(); this.draw(); });
  }

  home() { this.look(this.scene.view); this.fit(); }
  look(name) { [this.yaw, this.pitch] = this.scene.views[name]; }

  // The part fills the view as it is now turned, together with the scan where that lies farther off.
  fit() {
    const corners = (cloud, T) => [0, 1, 2, 3, 4, 5, 6, 7].map(bits =>
      moved(T, cloud.low.map((l, k) => l + (bits >> k & 1) * cloud.extent[k])));
    const points = corners(this.scene.target, STAND), scan = this.scene.on;
    const away = this.layers.scan && scan.count ? corners(scan, this.T) : [];
    if (away.some(p => Math.max(...p.map(Math.abs)) > 0.7)) points.push(...away);
    if (this.layers.motions) points.push(...[0, 1, 2].flatMap(k => [0.62, -0.62].map(s => [0, 1, 2].map(i => i === k ? s : 0))));
    const axes = cameraAxes(this.yaw, this.pitch), seen = points.map(p => axes.map(a => dot(a, p)));
    const low = [0, 1, 2].map(k => Math.min(...seen.map(p => p[k]))), high = [0, 1, 2].map(k => Math.max(...seen.map(p => p[k])));
    const w = this.canvas.clientWidth || 800, h = this.canvas.clientHeight || 500;
    this.middle = [0, 1, 2].map(i => axes.reduce((sum, a, k) => sum + a[i] * (low[k] + high[k]) / 2, 0));
    // Room for the buttons above and the scale bar below.
    this.zoom = 0.9 * Math.min(w / h / Math.max(high[0] - low[0], 1e-6), 0.86 / Math.max(high[1] - low[1], 1e-6));
    this.draw();
  }

  upload() {
    const gl = this.gl, scene = this.scene;
    this.programs = Object.fromEntries(Object.entries(SHADERS).map(([name, pair]) => [name, program(gl, pair)]));
    const cloudBuffers = cloud => cloud && cloud.count ? { cloud, place: this.buffer(cloud.steps), code: cloud.codeBytes && this.buffer(cloud.codeBytes) } : null;
    this.on = cloudBuffers(scene.on);
    this.off = cloudBuffers(scene.off);
    const target = scene.target;
    this.part = { cloud: target, place: this.buffer(target.steps) };
    if (target.kind === "mesh") {
      this.part.faces = this.buffer(target.faceNumbers, gl.ELEMENT_ARRAY_BUFFER);
      this.part.edges = this.buffer(target.edgeEnds);
    }
    if (this.layers.motions) this.solids = buildSolids(scene).map(s => ({ ...s, place: this.buffer(s.triangles) }));
    this.altCodes = (scene.alternatives || []).map(a => this.buffer(a));
    this.texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, scene.table || new Uint8Array(768));
    for (const [key, value] of [["MIN_FILTER", "NEAREST"], ["MAG_FILTER", "NEAREST"], ["WRAP_S", "CLAMP_TO_EDGE"], ["WRAP_T", "CLAMP_TO_EDGE"]])
      gl.texParameteri(gl.TEXTURE_2D, gl["TEXTURE_" + key], gl[value]);
  }
  buffer(data, kind = this.gl.ARRAY_BUFFER) {
    const made = this.gl.createBuffer();
    this.gl.bindBuffer(kind, made);
    this.gl.bufferData(kind, data, this.gl.STATIC_DRAW);
    return made;
  }

  begin(name, T, cloud, lift = 0) {
    const gl = this.gl, { made, places } = this.programs[name];
    gl.useProgram(made);
    gl.uniformMatrix3fv(places.motion, false, [T[0], T[4], T[8], T[1], T[5], T[9], T[2], T[6], T[10]]);
    gl.uniform3f(places.shift, T[3], T[7], T[11]);
    const R = this.axes;
    gl.uniformMatrix3fv(places.turn, false, [R[0][0], R[1][0], R[2][0], R[0][1], R[1][1], R[2][1], R[0][2], R[1][2], R[2][2]]);
    gl.uniform3fv(places.middle, this.middle);
    gl.uniform2fv(places.zoom, this.scale);
    gl.uniform1f(places.lift, lift);
    gl.uniform3fv(places.low, cloud ? cloud.low : [0, 0, 0]);
    gl.uniform3fv(places.extent, cloud ? cloud.extent : [1, 1, 1]);
    return places;
  }
  floats(buffer) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.disableVertexAttribArray(1);
  }
  steps(buffer, codes) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.UNSIGNED_SHORT, true, 0, 0);
    if (!codes) { gl.disableVertexAttribArray(1); return; }
    gl.bindBuffer(gl.ARRAY_BUFFER, codes);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 1, gl.UNSIGNED_BYTE, true, 0, 0);
  }
  dots(item, T, colour, size, codes, lift) {
    const gl = this.gl, places = this.begin("dots", T, item.cloud, lift);
    this.steps(item.place, codes);
    gl.uniform4fv(places.colour, colour);
    gl.uniform1f(places.size, size);
    gl.uniform1i(places.coded, codes ? 1 : 0);
    gl.drawArrays(gl.POINTS, 0, Math.min(item.cloud.count, this.pointLimit ?? Infinity));
  }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.drawNow(); });
  }
  drawNow() {
    const gl = this.gl, dpr = Math.min(devicePixelRatio || 1, 2) * (this.sharpness ?? 1);
    const w = Math.round(this.canvas.clientWidth * dpr), h = Math.round(this.canvas.clientHeight * dpr);
    const s = 2 * this.zoom;
    this.perSize = s * (h || 1) / 2 / dpr;  // CSS pixels of one size of the part
    this.axes = cameraAxes(this.yaw, this.pitch);
    if (!w || !h) return;  // in a frame that is not laid out yet
    if (this.canvas.width !== w || this.canvas.height !== h) { this.canvas.width = w; this.canvas.height = h; }
    this.scale = [s * h / w, s];
    const paper = cssColour("--paper");
    gl.viewport(0, 0, w, h);
    gl.clearColor(...paper);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    const L = this.layers, ghost = L.motions;
    if (L.part && !ghost) this.drawPart(dpr, [...cssColour("--part").slice(0, 3), 1]);
    // Points lie on the surface to the noise; a small lift keeps those just below it from sinking in.
    const size = Math.max(1.7, Math.min(9, this.scene.spacing * this.thin * this.perSize * 1.3)) * dpr;
    if (L.off && this.off) this.dots(this.off, this.T, cssColour("--off"), Math.max(1.6 * dpr, size * 0.6), null, 0);
    if (L.scan && this.on) {
      const codes = L.coded && (this.alternative === undefined ? this.on.code : this.altCodes[this.alternative]);
      this.dots(this.on, this.T, cssColour(L.before ? "--source" : "--aligned"), size, codes || null, 0.00006);
    }
    if (ghost) {
      for (const solid of this.solids) {
        const places = this.begin("solid", STAND, null);
        this.floats(solid.place);
        gl.uniform4fv(places.colour, [...cssColour(solid.colour).slice(0, 3), 1]);
        gl.drawArrays(gl.TRIANGLES, 0, solid.triangles.length / 3);
      }
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
      gl.depthMask(false);
      this.drawPart(dpr, [...cssColour("--part").slice(0, 3), 0.28]);
      gl.depthMask(true);
      gl.disable(gl.BLEND);
    }
    this.place();
  }
  drawPart(dpr, colour) {
    const gl = this.gl, part = this.part;
    if (part.cloud.kind !== "mesh") {
      const size = Math.max(1.3, Math.min(6, 0.55 * this.perSize / Math.sqrt(part.cloud.count))) * dpr;
      this.dots(part, STAND, colour, size, null, 0);
      return;
    }
    let places = this.begin("solid", STAND, part.cloud);
    this.steps(part.place);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, part.faces);
    gl.uniform4fv(places.colour, colour);
    gl.drawElements(gl.TRIANGLES, part.cloud.faceNumbers.length, gl.UNSIGNED_INT, 0);
    for (const { start, count, colour: own } of this.marked ?? []) {
      gl.uniform4fv(places.colour, [...cssColour(own).slice(0, 3), colour[3]]);
      gl.uniform1f(places.lift, 0.00001);
      gl.drawElements(gl.TRIANGLES, 3 * count, gl.UNSIGNED_INT, 12 * start);
    }
    if (!this.layers.edges) return;
    places = this.begin("line", STAND, null, 0.00003);
    this.floats(part.edges);
    gl.uniform4fv(places.colour, [...cssColour("--edge").slice(0, 3), 1]);
    gl.drawArrays(gl.LINES, 0, part.cloud.edgeEnds.length / 3);
  }

  toScreen(p) {
    const q = add(p, this.middle, -1);
    return [this.canvas.clientWidth / 2 + dot(this.axes[0], q) * this.perSize, this.canvas.clientHeight / 2 - dot(this.axes[1], q) * this.perSize];
  }
  // Where a place of the canvas lies in the plane through the middle, in sizes of the part.
  fromScreen(clientX, clientY) {
    const rect = this.canvas.getBoundingClientRect();
    const x = (clientX - rect.left - rect.width / 2) / this.perSize, y = (rect.top + rect.height / 2 - clientY) / this.perSize;
    return add(add(this.middle, this.axes[0], x), this.axes[1], y);
  }
  place() {
    for (const { element, at } of this.labels) {
      const [x, y] = this.toScreen(at());
      element.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
    }
    const bar = $(".scalebar", this.box);
    if (bar) {
      const goal = nice(110 / this.perSize * this.scene.size), words = length(goal, this.scene.unit), wide = `${goal / this.scene.size * this.perSize}px`;
      // While the view turns it stays the same: nothing is laid out anew then.
      if (this.bar !== words + wide) { this.bar = words + wide; $("i", bar).style.width = wide; $("span", bar).textContent = words; }
    }
    const axes = $(".axes", this.box);
    if (axes) "xyz".split("").forEach((name, k) => {
      const x = 22 * this.axes[0][k], y = -22 * this.axes[1][k];
      const line = $(`.a${name}`, axes), text = $(`.t${name}`, axes);
      line.setAttribute("x2", x); line.setAttribute("y2", y);
      text.setAttribute("x", x * 1.35); text.setAttribute("y", y * 1.35 + 4);
    });
  }
  label(text, at, title, kind) {
    const element = document.createElement("b");
    element.textContent = text; element.title = title; element.className = `badge ${kind}`;
    $(".labels", this.box).append(element);
    this.labels.push({ element, at });
    return element;
  }

  listen() {
    const canvas = this.canvas, fingers = new Map();
    let pinch = 0, pressed = [0, 0];
    const pan = (dx, dy) => {
      this.middle = add(add(this.middle, this.axes[0], -dx / this.perSize), this.axes[1], dy / this.perSize);
    };
    canvas.addEventListener("pointerdown", e => {
      canvas.focus({ preventScroll: true });
      canvas.setPointerCapture(e.pointerId);
      fingers.set(e.pointerId, [e.clientX, e.clientY]);
      pinch = 0;
      pressed = [e.clientX, e.clientY];
    });
    canvas.addEventListener("pointermove", e => {
      const last = fingers.get(e.pointerId);
      if (!last) { this.hover?.(e); return; }
      const dx = e.clientX - last[0], dy = e.clientY - last[1];
      fingers.set(e.pointerId, [e.clientX, e.clientY]);
      if (fingers.size === 2) {
        const [a, b] = [...fingers.values()], apart = Math.hypot(a[0] - b[0], a[1] - b[1]);
        if (pinch) this.magnify(apart / pinch);
        pinch = apart;
        pan(dx / 2, dy / 2);
      } else if (e.shiftKey || e.buttons & 6) pan(dx, dy);
      else { this.yaw -= dx * 0.4; this.pitch = Math.max(-90, Math.min(90, this.pitch + dy * 0.4)); }
      this.draw();
    });
    const release = e => { fingers.delete(e.pointerId); pinch = 0; };
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, release);
    canvas.addEventListener("click", e => {
      this.hover?.(e);
      if (Math.hypot(e.clientX - pressed[0], e.clientY - pressed[1]) < 4) this.picked?.(e);
    });
    canvas.addEventListener("pointerleave", () => this.leave?.());
    canvas.addEventListener("contextmenu", e => e.preventDefault());
    // Until the view is clicked the wheel scrolls the page.
    canvas.addEventListener("wheel", e => {
      if (document.activeElement !== canvas && !e.ctrlKey) return;
      e.preventDefault();
      this.magnify(Math.exp(-e.deltaY * 0.0015));
    }, { passive: false });
    canvas.addEventListener("keydown", e => {
      const keys = { ArrowLeft: [8, 0], ArrowRight: [-8, 0], ArrowUp: [0, 8], ArrowDown: [0, -8] };
      if (keys[e.key]) { this.yaw += keys[e.key][0]; this.pitch = Math.max(-90, Math.min(90, this.pitch + keys[e.key][1])); }
      else if (e.key === "+" || e.key === "=") this.zoom *= 1.15;
      else if (e.key === "-") this.zoom /= 1.15;
      else if (e.key === "0" || e.key === "Home") this.home();
      else return;
      e.preventDefault();
      this.draw();
    });
    for (const button of all("[data-look]", this.box)) button.addEventListener("click", () => {
      const name = button.dataset.look;
      if (name === "in" || name === "out") { this.magnify(name === "in" ? 1.3 : 1 / 1.3); return; }
      if (name === "fit") this.look(this.scene.view); else this.look(name);
      this.fit();
    });
  }
  magnify(factor) { this.zoom = Math.max(0.02, Math.min(400, this.zoom * factor)); this.draw(); }
}

const colours = new Map();
function cssColour(name) {
  if (!colours.has(name)) {
    const text = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    colours.set(name, [1, 3, 5].map(k => parseInt(text.slice(k, k + 2), 16) / 255).concat(1));
  }
  return colours.get(name);
}

// ---- arrows and ellipsoid --------------------------------------------------------------------------------------
function frameOf(axis) {
  const side = unitOf(cross(axis, Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
  return [side, cross(axis, side), axis];
}
function ring(at, frame, radius, count = 12) {
  return Array.from({ length: count }, (_, k) => {
    const a = 2 * Math.PI * k / count;
    return add(add(at, frame[0], radius * Math.cos(a)), frame[1], radius * Math.sin(a));
  });
}
function stitched(rings) {
  const out = [];
  for (let r = 0; r + 1 < rings.length; r++) for (let k = 0; k < rings[r].length; k++) {
    const n = (k + 1) % rings[r].length, [a, b, c, d] = [rings[r][k], rings[r][n], rings[r + 1][k], rings[r + 1][n]];
    out.push(...a, ...b, ...c, ...b, ...d, ...c);
  }
  return out;
}
function arrow(path, width) {
  const rings = [], last = path.length - 1;
  path.forEach((p, k) => {
    const ahead = unitOf(add(path[Math.min(k + 1, last)], path[Math.max(k - 1, 0)], -1));
    const frame = frameOf(ahead);
    if (k < last) rings.push(ring(p, frame, width));
    else { rings.push(ring(p, frame, width), ring(p, frame, 2.6 * width), ring(add(p, ahead, 6 * width), frame, 1e-5)); }
  });
  return stitched(rings);
}
function buildSolids(scene) {
  const solids = [];
  for (const m of scene.motions) {
    const colour = m.free ? "--free" : m.strength < 0.05 ? "--weak" : "--held";
    // An axis far outside the part is drawn at its place nearest to the middle of the part.
    const along = dot(m.axis, m.through), foot = add(m.through, m.axis, -along), far = Math.hypot(...foot);
    const at = far > 0.62 ? scaled(foot, 0.62 / far) : foot;
    const frame = frameOf(m.axis), reach = 0.56 - 0.02 * m.number;
    let triangles, tip;
    if (m.kind === "translation") {
      triangles = [1, -1].flatMap(sign => arrow([0.34, 0.42, 0.5].map(r => scaled(m.axis, sign * r * reach / 0.5)), 0.007));
      tip = scaled(m.axis, reach + 0.07);
    } else {
      const radius = 0.1, top = add(at, m.axis, reach);
      const arc = Array.from({ length: 28 }, (_, k) => {
        const a = (k / 27) * 1.55 * Math.PI;
        return add(add(top, frame[0], radius * Math.cos(a)), frame[1], radius * Math.sin(a));
      });
      const bar = [ring(add(at, m.axis, -reach), frame, 0.0025), ring(add(at, m.axis, reach), frame, 0.0025)];
      triangles = [...arrow(arc, 0.007), ...stitched(bar)];
      tip = add(top, m.axis, 0.07);
    }
    solids.push({ triangles: new Float32Array(triangles), colour, motion: m, tip });
  }
  if (scene.ellipsoid) {
    const [a, b, c] = scene.ellipsoid, rings = [];
    const least = 0.004, sized = v => Math.hypot(...v) < least ? scaled(v, least / Math.max(Math.hypot(...v), 1e-12)) : v;
    const [A, B, C] = [a, b, c].map(sized);
    for (let i = 0; i <= 16; i++) {
      const t = Math.PI * i / 16;
      rings.push(Array.from({ length: 28 }, (_, k) => {
        const f = 2 * Math.PI * k / 28;
        return add(add(scaled(C, Math.cos(t)), A, Math.sin(t) * Math.cos(f)), B, Math.sin(t) * Math.sin(f));
      }));
    }
    solids.push({ triangles: new Float32Array(stitched(rings)), colour: "--aligned" });
  }
  return solids;
}

return { $, all, still, bytes, readCloud, length, dot, cross, add, scaled, unitOf, moved, STAND, cameraAxes, cssColour, colours, View };
})();
