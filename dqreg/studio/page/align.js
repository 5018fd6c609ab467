// Step 3: the scan is laid on the part; what came of it, and how sure it is.
import { h, number, percent, long } from "./dom.js";
import { STAND, inDrawing } from "./stage.js";
import * as pairs from "./pairs.js";
import * as hand from "./hand.js";
import { mirror } from "./load.js";

const LIGHTS = { accepted: ["trusted", "The pose can be used."], suspect: ["doubtful", "Look at it before you use it."], failed: ["failed", "No pose was found that can be used."] };
const WAYS = { find: "Find it", pairs: "Point at pairs", hand: "Move by hand" };
const DOF = { tx: "along x", ty: "along y", tz: "along z", rx: "about x", ry: "about y", rz: "about z" };

const state = app => app.step_state.align ??= { way: app.visit.start === "pairs" ? "pairs" : app.visit.start === "hand" ? "hand" : "find" };

export function enter(app, stage) {
  app.showJudged = false;
  app.draw().then(() => {
    showPose(app, stage, app.results.align?.history?.length ?? 0);
    choose(app, stage, state(app).way);
    stage.fit();
    if (app.results.align?.rivals?.length && !app.thumbs) thumbnails(app, stage);
    // A row of a batch brings its pose along: it is shown without a click.
    if (app.visit.start === "rival" && !app.results.align && !app.busy.task) run(app, stage, {});
  });
}
export function leave(app, stage) { stage.picked = null; pairs.leave(app, stage); hand.leave(app, stage); stage.mark({}); stage.clearLabels(); stage.layers.scan = stage.layers.off = true; }

function showPose(app, stage, at) {
  const found = app.results.align, last = found?.history?.length ?? 0;
  app.step_state.at = at;
  const before = app.results.compare?.poses?.beside ?? STAND;
  stage.layers.before = at < last || !found?.drawn;
  stage.move(!found ? before : at >= last ? found.drawn ?? before : at === 0 ? before : found.history[at].drawn);
}

function choose(app, stage, way) {
  state(app).way = way;
  pairs.leave(app, stage); hand.leave(app, stage);
  if (way === "pairs") pairs.enter(app, stage);
  if (way === "hand") hand.enter(app, stage);
  stage.picked = way === "find" ? e => picked(app, stage, e) : stage.picked;
  if (way === "find") { showPose(app, stage, app.results.align?.history?.length ?? 0); if (app.results.align?.found) markDatums(app, stage); }
  app.render();
}

export async function run(app, stage, values) {
  app.say("");
  pairs.leave(app, stage); hand.leave(app, stage);
  await app.change(values);
  stage.layers.before = true;
  const found = await app.run("align", {}, values.start === "none" ? "Looking for the pose" : "Refining the pose");
  await app.refresh();
  app.results.align = found;
  app.thumbs = null;
  state(app).way = "find";
  stage.picked = e => picked(app, stage, e);
  // What was scanned is turned to the eye.
  if (found.look) [stage.yaw, stage.pitch] = found.look;
  showPose(app, stage, found.history.length);
  stage.fit();
  thumbnails(app, stage);
  app.render();
}

// Small pictures of the other poses that fit about as well.
function thumbnails(app, stage) {
  const found = app.results.align, kept = stage.T, before = stage.layers.before, small = document.createElement("canvas");
  small.width = 220; small.height = 150;
  const pen = small.getContext("2d");
  app.thumbs = (found?.rivals ?? []).map(rival => {
    stage.T = rival.drawn; stage.layers.before = true; stage.drawNow();
    const { width, height } = stage.canvas, share = Math.max(small.width / width, small.height / height);
    pen.drawImage(stage.canvas, (small.width - width * share) / 2, (small.height - height * share) / 2, width * share, height * share);
    return small.toDataURL("image/png");
  });
  stage.T = kept; stage.layers.before = before; stage.drawNow();
  app.render();
}

export function panel(app, stage) {
  const found = app.results.align, { way } = state(app), busy = Boolean(app.busy.task);
  return [
    h("div", { class: "row", role: "radiogroup", "aria-label": "How the scan is laid on the part" }, Object.entries(WAYS).map(([key, words]) =>
      h("label", { class: "choice" }, h("input", { type: "radio", name: "way", id: `way-${key}`, value: key, checked: way === key, disabled: busy, onchange: () => choose(app, stage, key) }), h("span", {}, words)))),
    way === "find" && [
      h("p", {}, "Finds how the scan lies on the part. No first guess is needed."),
      h("button", { id: "align", class: found ? "" : "main", disabled: busy, onclick: () => run(app, stage, { start: "none", T_start: null }) }, found ? "Find it again" : "Find it")],
    way === "pairs" && pairs.panel(app, stage, values => run(app, stage, values)),
    way === "hand" && hand.panel(app, stage, values => run(app, stage, values)),
    way !== "find" && locks(app),
    found && verdict(app, found),
    found?.rivals?.length ? rivals(app, stage, found, busy) : null,
    found?.found && datums(app, stage),
  ];
}

function locks(app) {
  const allowed = app.visit.dof ? app.visit.dof.split(" ") : Object.keys(DOF);
  const change = (key, on) => {
    const before = app.visit.dof ? app.visit.dof.split(" ") : Object.keys(DOF), now = Object.keys(DOF).filter(each => each === key ? on : before.includes(each));
    return app.change({ dof: now.length === 6 ? "" : now.join(" ") });
  };
  return h("details", { id: "locks" }, h("summary", {}, "Locked motions"),
    h("p", { class: "note" }, "The scan may still move and turn in these ways while the pose is refined; what is not ticked stays exactly as it is now."),
    h("div", { class: "grid3" }, Object.entries(DOF).map(([key, words]) => h("label", { class: "check" }, h("input", { type: "checkbox", id: `dof-${key}`, checked: allowed.includes(key), onchange: e => change(key, e.target.checked) }), ` ${words}`))));
}

function verdict(app, found) {
  const [word, advice] = LIGHTS[found.level], unit = app.unit();
  return h("section", { class: `light ${found.level}`, id: "verdict", "aria-label": "Verdict" },
    h("p", { class: "word" }, h("i", { "aria-hidden": "true" }), `Alignment: ${word}`),
    h("p", {}, advice), found.reasons.length ? h("ul", {}, found.reasons.map(r => h("li", {}, r))) : null,
    found.codes?.includes("mirrored") && h("div", { class: "row" }, h("button", { id: "mirror-scan", onclick: () => { app.go("load"); return mirror(app, !app.visit.mirrored); } }, app.visit.mirrored ? "Take the mirror back" : "Mirror the scan"), h("span", { class: "note" }, "if its frame is left-handed")),
    found.found && h("p", { class: "note" }, `Root mean square distance of the points on the part: ${long(found.rms, unit)}. ${percent(found.inliers, 0)} of the scan lies on the part. ${number(found.seconds, 2)} s.`));
}

function rivals(app, stage, found, busy) {
  return h("section", { id: "rivals" }, h("h3", {}, "Other poses that fit about as well"),
    h("p", { class: "note" }, "If the scan belongs there, choose it. The figure is how far the points are off; smaller is better."),
    h("div", { class: "thumbs" }, found.rivals.map((rival, k) => h("figure", {},
      h("button", { class: "thumb", id: `rival-${k}`, "aria-label": `Look at pose ${k + 1}`, onclick: () => { stage.layers.before = true; stage.move(rival.drawn); } },
        app.thumbs?.[k] ? h("img", { src: app.thumbs[k], alt: `The scan under pose ${k + 1}` }) : `Pose ${k + 1}`),
      h("figcaption", {}, `${number(rival.score)} ${app.unit()} `, h("button", { id: `choose-${k}`, disabled: busy, onclick: () => run(app, stage, { start: "rival", T_start: rival.T }) }, "Use it"))))));
}

const RESTS = { "best-fit": "Best fit on the whole part", faces: "Best fit on chosen faces", datums: "Datums A, B, C (3-2-1)", points: "Reference points (RPS)" };
const GOALS = { "best-fit": "least squares", tolerance: "most points within tolerance", minimax: "smallest largest deviation" };

function datums(app, stage) {
  const { visit, results } = app, faces = results.part.faces ?? [];
  if (!faces.length) return null;
  const set = values => app.change(values).then(() => markDatums(app, stage));
  const first = async key => {
    if (visit.alignment === "plan") state.planned = true;
    if (key === "datums" && visit.datums.length < 3) return { alignment: key, datums: (await app.run("suggest_datums", {}, "Looking for three faces that were scanned")).datums };
    return { alignment: key };
  };
  const state = app.step_state, weightOf = n => visit.weights[visit.chosen.indexOf(n)] ?? 1;
  const weigh = (n, text) => {
    const weight = Number(text.replace(",", "."));
    if (weight > 0) set({ weights: visit.chosen.map(each => each === n ? weight : weightOf(each)) }); else app.say("A weight is a number above 0.");
  };
  if (visit.alignment === "datums") state.aim ??= 0;
  return h("details", { id: "datums" }, h("summary", {}, "What the judgement rests on"),
    Object.entries({ ...RESTS, ...(visit.alignment === "plan" || state.planned ? { plan: "As the plan says" } : {}) }).map(([key, words]) => h("label", { class: "check" }, h("input", { type: "radio", name: "alignment", id: `by-${key}`, checked: visit.alignment === key, onchange: async () => set(await first(key)) }), ` ${words}`)),
    visit.alignment === "datums" && [
      h("p", { class: "note" }, "Three faces; the first holds most. Choose them here, or press a letter and click a face."),
      [0, 1, 2].map(k => h("div", { class: "row datum" }, h("button", { id: `aim-${k}`, "aria-pressed": String(state.aim === k), "aria-label": `Click a face for datum ${"ABC"[k]}`, onclick: () => { state.aim = k; app.render(); } }, "ABC"[k]),
        h("select", { id: `datum-${k}`, "aria-label": `Datum ${"ABC"[k]}`, onchange: e => set({ datums: withDatum(visit.datums, k, Number(e.target.value)) }) }, options(app, faces, visit.datums[k]))))],
    visit.alignment === "faces" && [
      h("p", { class: "note" }, "Click the faces that the scan is laid on; click again to leave one out. A face with twice the weight counts twice."),
      h("div", { class: "row" }, h("label", { for: "goal" }, "Make least"), h("select", { id: "goal", onchange: e => set({ goal: e.target.value }) }, Object.entries(GOALS).map(([key, words]) => h("option", { value: key, selected: visit.goal === key }, words)))),
      h("div", { class: "row" }, h("select", { id: "add-face", "aria-label": "Add a face", onchange: e => { if (e.target.value) set(withFace(visit, Number(e.target.value))); } }, h("option", { value: "" }, "Add a face…"), options(app, faces.filter(f => !visit.chosen.includes(f.number)), null))),
      visit.chosen.length ? h("ul", { class: "list" }, visit.chosen.map(n => h("li", {}, h("span", {}, faceName(faces.find(f => f.number === n), app.unit())), h("input", { id: `face-weight-${n}`, class: "short", inputmode: "decimal", autocomplete: "off", "aria-label": `Weight of face ${n}`, value: String(weightOf(n)), onchange: e => weigh(n, e.target.value) }), " ", h("button", { id: `unface-${n}`, onclick: () => set(withFace(visit, n)) }, "Leave out")))) : null],
    visit.alignment === "points" && [
      h("p", { class: "note" }, `Click the part where a point holds it along its normal: six or more, not all on one side. ${visit.references.length} so far.`),
      visit.references.length ? h("button", { id: "no-points", onclick: () => set({ references: visit.references.slice(0, -1) }) }, "Take the last one back") : null]);
}
const options = (app, faces, chosen) => faces.filter(f => f.kind === "plane" || f.kind === "cylinder" || chosen === null).sort((a, b) => b.area - a.area)
  .map(f => h("option", { value: String(f.number), selected: chosen === f.number }, faceName(f, app.unit())));
// A face more or less, each with its weight.
function withFace({ chosen, weights }, face) {
  const each = chosen.map((n, k) => [n, weights[k] ?? 1]), next = chosen.includes(face) ? each.filter(([n]) => n !== face) : [...each, [face, 1]];
  return { chosen: next.map(([n]) => n), weights: next.map(([, w]) => w) };
}

// A face that is a datum already changes places with the one that it replaces.
function withDatum(datums, k, face) {
  const now = [...datums], other = now.indexOf(face);
  if (other >= 0 && now[k] !== undefined) now[other] = now[k]; else if (other >= 0) return now;
  now[k] = face;
  return now.slice(0, 3);
}

function markDatums(app, stage) {
  const { visit } = app;
  stage.mark(visit.alignment === "datums" ? Object.fromEntries(visit.datums.map((face, k) => [face, ["--free", "--held", "--accent"][k]])) : visit.alignment === "faces" ? Object.fromEntries(visit.chosen.map(face => [face, "--accent"])) : {});
  stage.clearLabels();
  if (visit.alignment === "points") visit.references.forEach((each, k) => { const at = inDrawing(each.point, app.results.part.frame); stage.label(String(k + 1), () => at, `Reference point ${k + 1}`, "pair"); });
  if (visit.alignment === "datums") visit.datums.forEach((n, k) => { const face = app.results.part.faces.find(f => f.number === n), at = inDrawing(face.centre, app.results.part.frame); stage.label("ABC"[k], () => at, `Datum ${"ABC"[k]}`, "pair"); });
  // The faces are under the scan: it steps back while they are chosen.
  stage.layers.scan = stage.layers.off = visit.alignment === "best-fit" || app.step !== "align";
  stage.draw();
  app.render();
}
export function faceName(face, unit) {
  const at = face.centre.map(x => number(x, 3)).join(", ");
  const size = face.diameter ? ` ⌀ ${number(face.diameter, 4)} ${unit}` : face.radii ? ` radii ${face.radii.map(r => number(r, 4)).join(" and ")} ${unit}` : "";
  return `${face.number}: ${face.hole ? "hole" : face.kind === "free" ? "free shape" : face.kind}${size} at (${at})`;
}
export async function picked(app, stage, e) {
  const { visit } = app;
  if (visit.alignment === "best-fit") return;
  const hit = await app.quick("pick_part", stage.lookAt(e));
  if (hit.face === undefined) return;
  if (visit.alignment === "points") await app.change({ references: [...visit.references, { point: hit.point, normal: hit.normal }] });
  else if (visit.alignment === "faces") await app.change(withFace(visit, hit.face));
  else {
    const k = Math.min(app.step_state.aim ?? 0, visit.datums.length);
    app.step_state.aim = (k + 1) % 3;
    await app.change({ datums: withDatum(visit.datums, k, hit.face) });
  }
  markDatums(app, stage);
}

export function under(app, stage) {
  const found = app.results.align;
  if (!found?.drawn || state(app).way !== "find") return null;
  const last = found.history.length;
  return h("div", { class: "slider" }, h("label", { for: "before-after" }, "Before"),
    h("input", { type: "range", id: "before-after", min: "0", max: String(last), value: String(app.step_state.at ?? last), "aria-label": "From before to after, iteration by iteration", oninput: e => showPose(app, stage, Number(e.target.value)) }),
    h("span", {}, "After"));
}
