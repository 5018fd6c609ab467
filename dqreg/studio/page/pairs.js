// The same places pointed at on part and scan: three pairs or more give the pose in closed form.
import { h, number, long } from "./dom.js";
import { Stage, STAND, inDrawing } from "./stage.js";

const now = app => app.step_state.pairs ??= { part: null, scan: null, left: [], rms: null };

export async function enter(app, stage) {
  const box = document.querySelector("#scan3d");
  box.hidden = false;
  stage.figure("Part");
  stage.layers.scan = stage.layers.off = false;
  app.second ??= new Stage(box);
  const second = app.second, { scan } = app.results;
  second.layers.part = second.layers.off = false;
  second.layers.before = true;
  Object.assign(second.scene, { size: scan.frame.size, unit: app.visit.scan.units ?? scan.units ?? "", spacing: scan.spacing / scan.frame.size });
  second.setScan(app.results.draw_scan, app.scanBuffer);
  second.move(STAND);
  for (const [each, side] of [[stage, "part"], [second, "scan"]]) {
    each.box.classList.add("aim");
    each.picked = e => pick(app, each, side, e);
    each.enterPicks = true;
  }
  requestAnimationFrame(() => { stage.fit(); second.fit(); });
  badges(app, stage);
  await closedForm(app);
}
export function leave(app, stage) {
  document.querySelector("#scan3d").hidden = true;
  stage.figure("");
  stage.layers.scan = stage.layers.off = true;
  for (const each of [stage, app.second]) if (each) { each.box.classList.remove("aim"); each.picked = null; each.enterPicks = false; each.clearLabels("pair"); }
  stage.draw();
}

async function pick(app, stage, side, e) {
  const { point } = await app.quick(`pick_${side}`, { ...stage.lookAt(e), motion: STAND });
  if (!point) { app.say(`There is nothing of the ${side} there.`); return; }
  app.say("");
  const state = now(app);
  state[side] = point;
  if (state.part && state.scan) {
    const made = { part: state.part, scan: state.scan, weight: 1 };
    state.part = state.scan = null;
    await change(app, [...app.visit.pairs, made]);
  }
  badges(app, app.stage);
  app.render();
}
async function change(app, pairs) {
  await app.change({ pairs });
  await closedForm(app);
  badges(app, app.stage);
  app.render();
}
async function closedForm(app) {
  const state = now(app);
  state.left = []; state.rms = null;
  if (app.visit.pairs.length < 3) return;
  const found = await app.quick("pairs");
  Object.assign(state, { left: found.pairs, rms: found.rms, drawn: found.drawn });
  app.render();
}

function badges(app, stage) {
  const state = now(app), { part, scan } = app.results;
  for (const [each, side, frame] of [[stage, "part", part.frame], [app.second, "scan", scan.frame]]) {
    if (!each) continue;
    each.clearLabels("pair");
    const places = app.visit.pairs.map((pair, k) => [String(k + 1), pair[side]]);
    if (state[side]) places.push([String(app.visit.pairs.length + 1), state[side]]);
    for (const [text, point] of places) { const at = inDrawing(point, frame); each.label(text, () => at, `Place ${text}`, "pair"); }
    each.draw();
  }
}

export function panel(app, stage, run) {
  const { pairs } = app.visit, state = now(app), busy = Boolean(app.busy.task), unit = app.unit();
  const wanted = state.part ? "Now click the same place on the scan." : state.scan ? "Now click the same place on the part." : `Click a place on the part, then the same place on the scan.${pairs.length ? "" : " Corners and holes are easiest to find again."}`;
  return [
    h("p", { id: "pairs-said" }, wanted),
    h("p", { class: "note" }, "With the keyboard: Tab to a view, turn it with the arrow keys, Enter takes the place at the cross."),
    pairs.length ? h("table", { class: "pairs" }, h("thead", {}, h("tr", {}, ["Pair", `Left (${unit || "part's unit"})`, "Weight", ""].map(t => h("th", { scope: "col" }, t)))),
      h("tbody", {}, pairs.map((pair, k) => h("tr", {}, h("td", {}, String(k + 1)), h("td", { class: "n" }, number(state.left[k])),
        h("td", {}, h("input", { id: `weight-${k}`, class: "short", inputmode: "decimal", "aria-label": `Weight of pair ${k + 1}`, value: String(pair.weight), onchange: e => { const w = Number(e.target.value); if (w > 0) change(app, pairs.map((p, i) => i === k ? { ...p, weight: w } : p)); else app.say("A weight is a number above 0."); } })),
        h("td", {}, h("button", { id: `unpair-${k}`, "aria-label": `Remove pair ${k + 1}`, onclick: () => change(app, pairs.filter((_, i) => i !== k)) }, "Remove")))))) : null,
    state.rms !== null && h("p", { id: "pairs-rms" }, `Root mean square of the pairs: ${long(state.rms, unit)}.`),
    h("div", { class: "row" }, h("button", { id: "align-pairs", class: "main", disabled: busy || pairs.length < 3, onclick: () => run({ start: "pairs", T_start: null }) }, "Align from these pairs"),
      pairs.length < 3 && h("span", { class: "note" }, `${3 - pairs.length} more needed`)),
  ];
}
