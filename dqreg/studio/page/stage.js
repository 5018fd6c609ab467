// The drawing: the report's engine with a scan that moves, faces that are marked, and an outline on top.
import { Pace, drawsInSoftware } from "./pace.js";

const { View, dot, add, STAND, cameraAxes, colours, cssColour } = View3d;

const EMPTY = { low: [0, 0, 0], extent: [1e-9, 1e-9, 1e-9], count: 0, steps: new Uint16Array(0), kind: "cloud" };
// Of points by what they belong to, in the order of the server's numbers.
export const KIND_COLOURS = ["--aligned", "--off", "--weak", "--stray", "--edge"];
const VIEWS = { front: [0, 0], right: [90, 0], back: [180, 0], left: [-90, 0], top: [0, 90], bottom: [0, -90], iso: [35, 30] };
// Points that are drawn even where the part takes all that there is time for; milliseconds between two tellings of it.
const LEAST_POINTS = 1500, TELL = 500;

export class Stage extends View {
  static context = drawsInSoftware ? { antialias: false } : {};
  constructor(box) {
    const scene = { on: EMPTY, off: null, target: EMPTY, views: VIEWS, view: "iso", size: 1, unit: "", spacing: 0, worst: [], motions: [] };
    super(box, scene, { part: true, edges: true, scan: true, off: true, coded: false, before: true });
    this.thin = 1;
    this.over = box.querySelector(".overlay");
    this.pace = new Pace(() => { this.canvas.classList.remove("moving"); this.sharpness = 1; this.draw(); this.told?.(); });
    for (const name of ["pointerdown", "wheel", "keydown"]) this.canvas.addEventListener(name, () => this.hurry(), { passive: true });
    // With the keyboard, the place at the middle of the view is the one that is pointed at.
    this.canvas.addEventListener("keydown", e => {
      if (e.key !== "Enter" || !this.picked) return;
      e.preventDefault();
      const rect = this.canvas.getBoundingClientRect();
      this.picked({ clientX: rect.left + rect.width / 2, clientY: rect.top + rect.height / 2 });
    });
    this.canvas.addEventListener("pointermove", e => { if (e.buttons) this.hurry(); });
  }

  // Draw less for a while, then all again.
  hurry() {
    this.pace.hurry();
    if (drawsInSoftware) { this.sharpness = 0.5; this.canvas.classList.add("moving"); }
  }
  drawNow() {
    this.light?.();
    const { part, marked } = this, moving = this.pace?.moving;
    if (moving) this.lighten();
    super.drawNow();
    this.part = part; this.marked = marked;
    this.pointLimit = undefined;
    if (!moving) return;
    this.pace.drew(this.drawn.points + this.drawn.triangles);
    if (performance.now() - (this.toldAt ?? 0) > TELL) { this.toldAt = performance.now(); this.told?.(); }
  }
  // While the view moves: the finest surface that takes half of the budget at most, and points for the rest.
  lighten() {
    const { pace, layers, scene } = this, levels = this.levels ?? [], full = scene.target.faceNumbers?.length / 3 || 0;
    let triangles = 0;
    if (layers.part && full) {
      const light = full > pace.budget / 2 ? levels.find(each => each.drawn <= pace.budget / 2) ?? levels.at(-1) : null;
      triangles = light ? light.drawn : full;
      if (light) { this.part = light; this.marked = light.marked; }
    }
    const clouds = [layers.scan && scene.on, layers.off && scene.off, layers.part && scene.target.kind !== "mesh" && scene.target].filter(each => each?.count);
    this.pointLimit = Math.round(Math.max(LEAST_POINTS, pace.budget - triangles) / Math.max(1, clouds.length));
    this.drawn = { points: clouds.reduce((sum, each) => sum + Math.min(each.count, this.pointLimit), 0), triangles };
  }

  // Without the part in view the scan alone fills it.
  fit() {
    const { target, on } = this.scene;
    if (!this.layers?.part && on?.count) this.scene.target = { ...EMPTY, low: on.low, extent: on.extent };
    // Where deviations are shown, the part does: a table around it is none of it.
    const scan = this.layers?.scan;
    if (on?.valueSteps) this.layers.scan = false;
    super.fit();
    if (this.layers) this.layers.scan = scan;
    this.scene.target = target;
  }
  place() { super.place(); this.drawOver?.(); }
  figure(words) { const caption = this.box.querySelector("figcaption"); caption.hidden = !words; caption.textContent = words; }

  upload() {
    super.upload();
    const gl = this.gl;
    this.levels = (this.scene.target.levels ?? []).map(level => ({ drawn: level.drawn, cloud: level, place: this.buffer(level.steps), faces: this.buffer(level.faceNumbers, gl.ELEMENT_ARRAY_BUFFER), edges: this.buffer(level.edgeEnds) }));
  }

  setPart(drawing, buffer) {
    this.scene.target = drawing ? readPart(drawing, buffer) : EMPTY;
    this.marked = [];
    this.renew();
  }
  setScan(drawing, buffer) {
    [this.scene.on, this.scene.off] = drawing ? readScan(drawing, buffer) : [null, null];
    this.scene.on ??= { ...EMPTY };
    this.thin = drawing ? Math.sqrt(Math.max(1, (drawing.left ?? drawing.total) / Math.max(1, drawing.on))) : 1;
    if (drawing?.kinds) {
      // A colour for each kind of point: codes count from 1.
      this.scene.table = new Uint8Array(768);
      KIND_COLOURS.forEach((name, k) => this.scene.table.set(cssColour(name).slice(0, 3).map(c => Math.round(255 * c)), 3 * (k + 1)));
      this.lit = false;
    } else if (drawing?.scale) {
      this.scene.table = new Uint8Array(drawing.scale.table);
      this.lit = false;
    } else { this.lit = true; this.scene.table = ramp(this.layers.before ? "--source" : "--aligned"); }
    this.layers.coded = true;
    this.renew();
  }
  renew() {
    // Buffers of the last scene would stay in the memory of the graphics card.
    const gl = this.gl, old = [this.on, this.off, this.part, ...(this.levels ?? [])].flatMap(item => item ? [item.place, item.code, item.faces, item.edges] : []);
    for (const buffer of old) if (buffer) gl.deleteBuffer(buffer);
    for (const each of Object.values(this.programs ?? {})) gl.deleteProgram(each.made);
    if (this.texture) gl.deleteTexture(this.texture);
    this.upload();
    this.draw();
  }
  // Light and shade in the colour of the scan as it is now: before or after.
  light() {
    if (!this.lit || !this.texture) return;
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, ramp(this.layers.before ? "--source" : "--aligned"));
  }
  move(T) { this.T = T ?? STAND; this.draw(); }

  // Faces of the part by their numbers, each in a colour.
  mark(colourOf) {
    const chosen = faces => (faces ?? []).filter(([face]) => colourOf[face]).map(([face, start, number]) => ({ start, count: number, colour: colourOf[face] }));
    this.marked = chosen(this.scene.target.faces);
    for (const level of this.levels ?? []) level.marked = chosen(level.cloud.faces);
    this.draw();
  }

  // What the server is told of a place of the canvas.
  lookAt(e, pixels = 9) {
    return { at: this.fromScreen(e.clientX, e.clientY), axes: this.axes, radius: pixels / this.perSize, motion: this.T };
  }
  // Corners of an outline on the canvas along the view's axes.
  across(points) {
    return points.map(([x, y]) => { const p = this.fromScreen(x, y); return [dot(this.axes[0], p), dot(this.axes[1], p)]; });
  }
  picture() { this.pace.moving = false; this.sharpness = 1; this.drawNow(); return this.canvas.toDataURL("image/png"); }
  clearLabels(kind) {
    for (const label of this.labels.filter(l => !kind || l.element.classList.contains(kind))) label.element.remove();
    this.labels = this.labels.filter(l => l.element.isConnected);
  }
}

function ramp(name) {
  const colour = cssColour(name), table = new Uint8Array(768);
  for (let k = 0; k < 256; k++) {
    const s = k / 255, bright = 0.42 + 0.62 * s;
    for (let c = 0; c < 3; c++) table[3 * k + c] = Math.min(255, Math.round(255 * (Math.min(1, colour[c] * bright) + 0.12 * s * s)));
  }
  return table;
}

function readScan(drawing, buffer) {
  const steps = new Uint16Array(buffer, 0, 3 * drawing.count);
  const cut = 3 * drawing.on, common = { low: drawing.low, extent: drawing.extent };
  const on = { ...common, count: drawing.on, steps: steps.subarray(0, cut) };
  const off = { ...common, count: drawing.off, steps: steps.subarray(cut) };
  if (drawing.scale) {
    let at = (6 * drawing.count + 3) & ~3;
    on.valueSteps = new Int16Array(buffer, at, drawing.on);
    on.step = drawing.step;
    at = (at + 2 * drawing.on + 3) & ~3;
    on.codeBytes = new Uint8Array(buffer, at, drawing.on);
  } else on.codeBytes = new Uint8Array(buffer, 6 * drawing.count, drawing.on);
  return [on, drawing.off ? off : null];
}

function readPart(drawing, buffer) {
  const part = { ...drawing, steps: new Uint16Array(buffer, 0, 3 * drawing.count) };
  if (drawing.kind !== "mesh") return part;
  let at = (6 * drawing.count + 3) & ~3;
  part.faceNumbers = new Uint32Array(buffer, at, 3 * drawing.drawn);
  at += 12 * drawing.drawn;
  part.edgeEnds = new Float32Array(buffer, at, 6 * drawing.edges);
  at += 24 * drawing.edges;
  part.levels = drawing.levels.map(level => {
    const { drawn, count } = level, from = at, steps = new Uint16Array(buffer, from, 3 * count);
    at = (from + 6 * count + 3) & ~3;
    const faceNumbers = new Uint32Array(buffer, at, 3 * drawn);
    at += 12 * drawn;
    return { ...level, kind: "mesh", faceNumbers, edgeEnds: new Float32Array(0), steps };
  });
  return part;
}

// A place of a side in its drawing.
export const inDrawing = (point, frame) => point.map((x, k) => (x - frame.middle[k]) / frame.size);
export { STAND, cameraAxes, colours, add };
