// Step 2: what is not the part is left out. The file itself is never changed, and every cut can be undone.
import { h, number, count, percent } from "./dom.js";
import * as reach from "./reach.js";
import { STAND, inDrawing } from "./stage.js";

export function enter(app, stage) {
  app.showJudged = false;
  const box = app.results.scan;
  app.step_state.clean ??= { tool: "", low: [...box.low], high: [...box.high] };
  alone(app, stage).then(() => stage.fit());
  if (!app.step_state.clean.asked) question(app);
}
export function leave(app, stage) {
  app.showKinds = false;
  stage.layers.off = true;
  stage.layers.part = true;
  aim(app, stage, "");
  stage.drawOver = null;
  stage.over.replaceChildren();
}

async function alone(app, stage) {
  app.showKinds = false;
  stage.layers.off = true;
  await app.draw();
  stage.layers.part = false;
  stage.layers.before = true;
  stage.scene.size = app.results.scan.frame.size;
  stage.scene.unit = app.visit.scan.units ?? app.results.scan.units ?? "";
  stage.scene.spacing = app.results.scan.spacing / app.results.scan.frame.size;
  stage.drawOver = () => outline(app, stage);
  stage.move(STAND);
}

// A plane that leaves the part is worth a question, once.
async function question(app) {
  const state = app.step_state.clean;
  state.asked = true;
  if (app.visit.cuts.some(cut => cut.kind === "plane")) return;
  state.plane = await app.quick("plane");
  app.render();
}

async function cut(app, stage, made) {
  await app.change({ cuts: [...app.visit.cuts, made] });
  await redraw(app, stage);
}
export async function redraw(app, stage) {
  await app.read();
  await alone(app, stage);
  app.render();
}

async function aim(app, stage, tool) {
  if (tool && app.showKinds) { await alone(app, stage); stage.fit(); }
  const state = app.step_state.clean;
  if (state) state.tool = tool;
  stage.box.classList.toggle("aim", tool === "lasso");
  stage.over.style.pointerEvents = tool === "lasso" ? "auto" : "none";
  stage.over.onpointerdown = tool === "lasso" ? e => lasso(app, stage, e) : null;
  stage.draw();
  app.render();
}

function lasso(app, stage, e) {
  e.preventDefault();
  const line = document.createElementNS("http://www.w3.org/2000/svg", "polyline"), rect = stage.canvas.getBoundingClientRect();
  const points = [];
  stage.over.replaceChildren(line);
  stage.over.setPointerCapture(e.pointerId);
  const add = ev => {
    points.push([ev.clientX, ev.clientY]);
    line.setAttribute("points", points.map(([x, y]) => `${x - rect.left},${y - rect.top}`).join(" "));
  };
  add(e);
  stage.over.onpointermove = add;
  stage.over.onpointerup = async () => {
    stage.over.onpointermove = stage.over.onpointerup = null;
    if (points.length < 3) { stage.over.replaceChildren(); return; }
    const few = points.filter((_, k) => k % Math.ceil(points.length / 500) === 0);
    const made = await app.quick("lasso", { axes: stage.axes, motion: stage.T, polygon: stage.across(few), keep: Boolean(app.step_state.clean.keep) });
    stage.over.replaceChildren();
    await cut(app, stage, made);
    aim(app, stage, "");
  };
}

// The twelve edges of the box, over the drawing.
function outline(app, stage) {
  const state = app.step_state.clean;
  if (state?.tool !== "box") { if (state?.tool !== "lasso") stage.over.replaceChildren(); return; }
  const frame = app.results.scan.frame, corner = bits => stage.toScreen(inDrawing([0, 1, 2].map(k => (bits >> k & 1 ? state.high : state.low)[k]), frame));
  const lines = [];
  for (let bits = 0; bits < 8; bits++) for (const k of [1, 2, 4]) if (!(bits & k)) {
    const [a, b] = [corner(bits), corner(bits | k)], line = document.createElementNS("http://www.w3.org/2000/svg", "line");
    line.setAttribute("x1", a[0]); line.setAttribute("y1", a[1]); line.setAttribute("x2", b[0]); line.setAttribute("y2", b[1]);
    lines.push(line);
  }
  stage.over.replaceChildren(...lines);
}

function boxFields(app, stage) {
  const state = app.step_state.clean, { low, high } = app.results.scan;
  const range = (side, k) => h("input", {
    type: "range", id: `box-${side}-${k}`, min: "0", max: "1000", "aria-label": `${"xyz"[k]} ${side === "low" ? "from" : "to"}`,
    value: String(Math.round(1000 * (state[side][k] - low[k]) / Math.max(high[k] - low[k], 1e-12))),
    oninput: e => { state[side][k] = low[k] + (high[k] - low[k]) * Number(e.target.value) / 1000; said(); stage.draw(); },
  });
  const words = [0, 1, 2].map(() => h("output", {}));
  const said = () => words.forEach((each, k) => { each.textContent = `${number(state.low[k], 4)} … ${number(state.high[k], 4)}`; });
  said();
  const made = keep => cut(app, stage, { kind: "box", keep, low: state.low, high: state.high }).then(() => aim(app, stage, ""));
  return h("div", { class: "card" }, [0, 1, 2].map(k => h("div", { class: "range" }, h("b", {}, "xyz"[k]), range("low", k), range("high", k), words[k])),
    h("div", { class: "row" }, h("button", { id: "box-out", onclick: () => made(false) }, "Leave the inside out"), h("button", { id: "box-keep", onclick: () => made(true) }, "Keep only the inside")));
}

// Before there is a pose no point is near to the part or far from it.
function reachOf(app, stage, busy) {
  if (!app.results.align?.found) return h("p", { class: "note", id: "reach-later" }, "What is farther off the part than its reach is left out when deviations are measured. Once the scan lies on the part, in the next step, the reach can be seen and set here.");
  const turn = () => app.showKinds ? alone(app, stage).then(() => { stage.fit(); app.render(); }) : reach.show(app, stage).then(() => { stage.drawOver = null; stage.over.replaceChildren(); stage.fit(); });
  return [h("div", { class: "row" }, h("button", { id: "reach-shown", "aria-pressed": String(Boolean(app.showKinds)), disabled: busy, onclick: () => { app.step_state.clean.tool = ""; return turn(); } }, "Reach on the part")),
    app.showKinds && reach.panel(app, stage)];
}

const KINDS = { box: "Box", lasso: "Lasso", plane: "Plane" };
export function panel(app, stage) {
  const state = app.step_state.clean ?? {}, { visit, results } = app, left = results.draw_scan?.left, all = results.draw_scan?.total;
  const plane = state.plane?.plane, busy = Boolean(app.busy.task);
  return [
    h("p", {}, "Leave out what is not the part: a table, a clamp, the next part. Your file is not changed. If there is nothing to leave out, go on."),
    plane && !visit.cuts.some(each => each.kind === "plane") && h("div", { class: "ask", id: "plane" },
      h("p", {}, `A flat surface with ${percent(state.plane.points / results.scan.points, 0)} of the points extends beyond the part, as a table does. Leave it out?`),
      h("div", { class: "row" }, h("button", { class: "main", id: "plane-out", disabled: busy, onclick: () => cut(app, stage, plane).then(() => { state.plane = null; app.render(); }) }, "Leave it out"),
        h("button", { id: "plane-keep", onclick: () => { state.plane = null; app.render(); } }, "Keep it"))),
    h("div", { class: "row", role: "group", "aria-label": "Tools" },
      h("button", { id: "tool-lasso", "aria-pressed": String(state.tool === "lasso"), disabled: busy, onclick: () => aim(app, stage, state.tool === "lasso" ? "" : "lasso") }, "Lasso"),
      h("button", { id: "tool-box", "aria-pressed": String(state.tool === "box"), disabled: busy, onclick: () => aim(app, stage, state.tool === "box" ? "" : "box") }, "Box")),
    reachOf(app, stage, busy),
    state.tool === "lasso" && h("div", { class: "card" }, h("p", {}, "Draw a line around the points on the view. It cuts through the whole scan, so turn the view first."),
      h("label", { class: "check" }, h("input", { type: "checkbox", id: "lasso-keep", checked: Boolean(state.keep), onchange: e => { state.keep = e.target.checked; } }), " Keep only what is inside")),
    state.tool === "box" && boxFields(app, stage),
    all && h("p", { id: "left" }, `${count(left)} of ${count(all)} points are used.`),
    visit.cuts.length ? h("ol", { class: "list" }, visit.cuts.map((each, k) => h("li", {}, h("span", {}, `${KINDS[each.kind]}: ${each.keep ? "only the inside is kept" : "left out"}`),
      h("button", { id: `uncut-${k}`, disabled: busy, "aria-label": `Take back cut ${k + 1}`, onclick: async () => { await app.change({ cuts: visit.cuts.filter((_, i) => i !== k) }); await redraw(app, stage); } }, "Take back")))) : null,
  ];
}
