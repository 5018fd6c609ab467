// The scan moved by hand: dragged in the view, or by the buttons.
import { h } from "./dom.js";
import { STAND } from "./stage.js";

const { dot, cross, add, moved } = View3d;

export function enter(app, stage) {
  const state = app.step_state.hand ??= { mode: "turn" };
  state.T ??= app.results.align?.drawn ?? app.results.compare?.poses?.as_scanned ?? STAND;
  stage.layers.before = true;
  stage.over.style.pointerEvents = "auto";
  stage.box.classList.add("aim");
  stage.over.onpointerdown = e => drag(app, stage, e);
  stage.move(state.T);
  stage.fit();
}
export function leave(app, stage) {
  stage.over.style.pointerEvents = "none";
  stage.over.onpointerdown = null;
  stage.box.classList.remove("aim");
}

function turned(T, axis, angle, about) {
  const turn = v => {
    const c = Math.cos(angle), s = Math.sin(angle), along = (1 - c) * dot(axis, v), side = cross(axis, v);
    return [0, 1, 2].map(k => c * v[k] + s * side[k] + along * axis[k]);
  };
  const columns = [0, 1, 2].map(k => turn([T[k], T[4 + k], T[8 + k]])), t = add(turn(add([T[3], T[7], T[11]], about, -1)), about);
  return [0, 1, 2].flatMap(r => [columns[0][r], columns[1][r], columns[2][r], t[r]]);
}
const shifted = (T, d) => T.map((x, k) => k % 4 === 3 ? x + d[(k - 3) / 4] : x);
function middle(stage, T) {
  const { low, extent } = stage.scene.on;
  return moved(T, low.map((l, k) => l + extent[k] / 2));
}

function set(app, stage, T) { app.step_state.hand.T = T; stage.move(T); stage.hurry(); }
function drag(app, stage, e) {
  e.preventDefault();
  stage.over.setPointerCapture(e.pointerId);
  let last = [e.clientX, e.clientY];
  stage.over.onpointermove = ev => {
    const dx = ev.clientX - last[0], dy = ev.clientY - last[1], state = app.step_state.hand, [right, up] = stage.axes;
    last = [ev.clientX, ev.clientY];
    if (state.mode === "turn") {
      const about = middle(stage, state.T);
      set(app, stage, turned(turned(state.T, up, dx * 0.01, about), right, dy * 0.01, about));
    } else set(app, stage, shifted(state.T, add(right.map(x => x * dx / stage.perSize), up, -dy / stage.perSize)));
  };
  stage.over.onpointerup = () => { stage.over.onpointermove = stage.over.onpointerup = null; };
}

const TURNS = { "◀": [1, -1], "▶": [1, 1], "▲": [0, -1], "▼": [0, 1], "↺": [2, 1], "↻": [2, -1] };
const NAMES = { "◀": "Turn left", "▶": "Turn right", "▲": "Turn up", "▼": "Turn down", "↺": "Turn anticlockwise", "↻": "Turn clockwise" };
const SHIFTS = { "←": [0, -1], "→": [0, 1], "↑": [1, 1], "↓": [1, -1] };
const WAYS = { "←": "Shift left", "→": "Shift right", "↑": "Shift up", "↓": "Shift down" };
export function panel(app, stage, run) {
  const state = app.step_state.hand ??= { mode: "turn" }, busy = Boolean(app.busy.task);
  const turn = ([k, sign]) => set(app, stage, turned(state.T, stage.axes[k], sign * Math.PI / 12, middle(stage, state.T)));
  const shift = ([k, sign]) => set(app, stage, shifted(state.T, stage.axes[k].map(x => 0.05 * sign * x)));
  return [
    h("p", {}, "Drag the scan near to where it belongs; a tenth of the part's size and fifteen degrees are near enough."),
    h("div", { class: "row" }, ["turn", "shift"].map(mode => h("label", { class: "choice" }, h("input", { type: "radio", name: "hand", id: `hand-${mode}`, checked: state.mode === mode, onchange: () => { state.mode = mode; app.render(); } }), h("span", {}, mode === "turn" ? "Dragging turns" : "Dragging shifts")))),
    h("div", { class: "row" }, Object.entries(TURNS).map(([sign, way]) => h("button", { id: `turn-${NAMES[sign].slice(5)}`, "aria-label": `${NAMES[sign]} by 15 degrees`, onclick: () => turn(way) }, sign))),
    h("div", { class: "row" }, Object.entries(SHIFTS).map(([sign, way]) => h("button", { id: `shift-${WAYS[sign].slice(6)}`, "aria-label": WAYS[sign], onclick: () => shift(way) }, sign))),
    h("button", { id: "align-hand", class: "main", disabled: busy, onclick: async () => { const { T } = await app.quick("hand", { drawn: state.T }); await run({ start: "hand", T_start: T }); state.T = null; } }, "Align from here"),
  ];
}
