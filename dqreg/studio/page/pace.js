// How much is drawn while the view moves: as much as the machine draws in time, and all of it again at rest.

// Milliseconds of a frame that are aimed at, and what is left as it is; longer gaps are pauses of the hand.
const GOAL = 40, SLOW = 45, FAST = 30, PAUSE = 500;
// Points and triangles together: the least that still shows a shape, and what a processor without a graphics card begins with.
const LEAST = 3000, BEGIN = 8000, ALL = 1e9;
// After that many milliseconds without a motion all is drawn, or after so many frames where they take longer.
const REST = 220, FRAMES = 4;

// Without a graphics card the processor draws: no smoothing of edges then, and half the resolution while the view moves.
export const drawsInSoftware = (() => {
  const gl = document.createElement("canvas").getContext("webgl2"), known = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = known ? String(gl.getParameter(known.UNMASKED_RENDERER_WEBGL)) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
})();

export class Pace {
  constructor(rested) {
    this.budget = drawsInSoftware ? BEGIN : ALL;
    this.moving = false;
    this.rested = rested;
    this.took = 0;
  }
  // The view is moved now; `rested` is called once it has stopped.
  hurry() {
    this.moving = true;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => { this.moving = false; this.last = undefined; this.rested(); }, Math.max(REST, FRAMES * this.took));
  }
  // A frame was drawn, of so many points and triangles: the next one is of as many as fit in its time.
  drew(items) {
    const now = performance.now(), took = now - this.last;
    this.last = now;
    // The browser asks for a frame once it has room for one: the gaps are what a frame costs, all of its parts together.
    if (!(took < PAUSE)) return;
    this.took = this.took ? 0.7 * this.took + 0.3 * took : took;
    if (this.took > SLOW) this.budget = Math.max(LEAST, Math.min(this.budget, items) * Math.max(0.6, GOAL / this.took));
    else if (this.took < FAST && items >= 0.9 * this.budget) this.budget = Math.min(ALL, this.budget * 1.1);
  }
  get frames() { return this.took ? 1000 / this.took : 0; }
}
