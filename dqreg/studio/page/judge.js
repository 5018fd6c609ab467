// Step 4: is the part within its tolerance? Every face may have its own.
import { h, number, percent, signed, count, off, long, sides, sidesText } from "./dom.js";
import * as reach from "./reach.js";
import * as plan from "./plan.js";
import * as sections from "./sections.js";
import { STAND, inDrawing } from "./stage.js";
import { faceName } from "./align.js";

const WORDS = { pass: "within tolerance", fail: "out of tolerance", undecided: "undecided: the limit lies within the uncertainty" };
const SIDES = "0.1 for both sides, or +0.1/-0.05 outside and inside", NEITHER = `This is no tolerance: write ${SIDES}.`;
const SHORT = { pass: "pass", fail: "fail", undecided: "undecided" };

export function enter(app, stage) {
  app.showJudged = true;
  stage.picked = e => picked(app, stage, e);
  stage.layers.off = true;
  if (app.results.judge) place(app, stage).then(() => stage.fit()); else measure(app, stage).then(() => stage.fit());
}
export function leave(app, stage) { app.showKinds = false; stage.picked = null; stage.layers.scan = true; stage.box.classList.remove("aim"); stage.clearLabels(); stage.mark({}); }

async function place(app, stage) {
  app.showKinds = false;
  stage.layers.off = true;
  await app.draw();
  stage.layers.before = false;
  stage.layers.scan = true;
  stage.move(STAND);
  badges(app, stage);
  app.render();
}
async function measure(app, stage) {
  const found = await app.run("judge", {}, "Measuring deviations");
  await app.refresh();
  app.results.judge = found;
  app.renewed("judge");
  await place(app, stage);
}
async function choose(app, stage, values) { await app.change(values); await measure(app, stage); }

function badges(app, stage) {
  stage.clearLabels();
  const found = app.results.judge, frame = app.results.part.frame, unit = app.unit();
  found?.worst.forEach((each, k) => { const at = inDrawing(each.at, frame); stage.label(String(k + 1), () => at, `${off(each.value, unit)}`, "worst"); });
  found?.labels?.forEach(each => { const at = inDrawing(each.at, frame); stage.label(each.value === null ? "not measured" : `${signed(each.value)}`, () => at, unit, "tag"); });
  colourFaces(app, stage);
  stage.draw();
}
function colourFaces(app, stage) {
  const state = app.step_state.judge ??= {}, colour = { pass: "--accepted", fail: "--failed", undecided: "--suspect" };
  const marks = {};
  if (state.colour === "faces") for (const row of rows(app)) if (row.outcome) marks[row.face.number] = colour[row.outcome];
  if (state.face !== undefined) marks[state.face] = "--accent";
  stage.layers.scan = state.colour !== "faces";
  stage.mark(marks);
}

async function picked(app, stage, e) {
  const hit = await app.quick("pick_part", stage.lookAt(e, 6)), state = app.step_state.judge ??= {};
  if (!hit.point) return;
  if (state.labelling) { await choose(app, stage, { labels: [...app.visit.labels, hit.point] }); return; }
  if (state.cutting !== undefined) { await choose(app, stage, sections.through(app, hit.point)); return; }
  if (hit.face === undefined) return;
  state.face = hit.face;
  colourFaces(app, stage);
  app.render();
  document.querySelector(`#face-${hit.face}`)?.focus();
}

// One row a face: what was measured on it, and its own tolerance.
function rows(app) {
  const found = app.results.judge, regions = new Map((found?.faces ?? []).map(f => [f.number, f])), own = new Map(app.visit.faces.map(f => [f.face, f]));
  return (app.results.part.faces ?? []).map(face => {
    const region = regions.get(face.number);
    return { face, region, own: own.get(face.number), outcome: region?.outcome ?? null };
  });
}

export function panel(app, stage) {
  const found = app.results.judge, unit = app.unit(), { visit } = app, busy = Boolean(app.busy.task), state = app.step_state.judge ??= {};
  const read = input => { const value = Number(input.value.replace(",", ".")); return value > 0 ? value : null; };
  const judge = f => {
    const both = sides(f.tolerance.value);
    if (both === undefined) { app.say(NEITHER); return; }
    app.say("");
    choose(app, stage, { tolerance: both?.plus ?? null, minus: both?.minus ?? null, required: read(f.required) ?? 95, reach: read(f.reach) });
  };
  return [
    h("form", { class: "fields", onsubmit: e => { e.preventDefault(); judge(e.target.elements); } },
      h("label", { for: "tolerance" }, "Tolerance"), h("input", { id: "tolerance", name: "tolerance", value: sidesText(visit.tolerance, visit.minus), autocomplete: "off", placeholder: "none", title: SIDES }), h("span", {}, unit),
      h("label", { for: "required" }, "Points within"), h("input", { id: "required", name: "required", inputmode: "decimal", value: String(visit.required), autocomplete: "off" }), h("span", {}, "%"),
      h("label", { for: "reach" }, "Belongs to the part up to"), h("input", { id: "reach", name: "reach", inputmode: "decimal", value: visit.reach ?? "", placeholder: found ? number(found.reach) : "from the data", autocomplete: "off" }), h("span", {}, unit),
      h("span"), h("button", { id: "judge", class: "main" }, "Judge")),
    found?.decision && decision(app, found),
    found && plan.panel(app, found),
    found && figures(app, found, unit),
    found && legend(found, unit),
    found && h("div", { class: "row", role: "group", "aria-label": "Show" },
      h("button", { id: "colour-faces", "aria-pressed": String(state.colour === "faces"), disabled: !found.decision, onclick: async () => { state.colour = state.colour === "faces" ? "" : "faces"; if (app.showKinds) await place(app, stage); colourFaces(app, stage); app.render(); } }, "Faces pass / fail"),
      h("button", { id: "kinds", "aria-pressed": String(Boolean(app.showKinds)), disabled: busy, onclick: () => app.showKinds ? place(app, stage) : reach.show(app, stage) }, "What belongs to the part"),
      h("button", { id: "labelling", "aria-pressed": String(Boolean(state.labelling)), onclick: () => { state.labelling = !state.labelling; state.cutting = undefined; stage.box.classList.toggle("aim", state.labelling); app.render(); } }, "Add a label"),
      sections.tools(app, stage, state),
      visit.labels.length ? h("button", { id: "no-labels", disabled: busy, onclick: () => choose(app, stage, { labels: [] }) }, "Remove labels") : null),
    app.showKinds && reach.panel(app, stage),
    state.labelling && h("p", { class: "note" }, "Click the part where its deviation should be written."),
    found && sections.panel(app, found, state, values => choose(app, stage, values)),
    found?.worst.length ? worst(app, stage, found, unit) : null,
    found && app.results.part.faces?.length ? faces(app, stage) : null,
    found && plan.file(app, values => choose(app, stage, values)),
    found?.bands && bands(found, unit),
  ];
}
function decision(app, found) {
  const { outcome, share_within, required_share, own } = found.decision, { visit } = app, unit = app.unit();
  const band = visit.tolerance === null ? "the tolerances of their faces" : visit.minus === null ? `±${long(visit.tolerance, unit)}` : `${sidesText(visit.tolerance, visit.minus).replace("-", "−")} ${unit}`;
  const conditional = outcome === "pass" && !found.alignment_trusted;
  return h("section", { class: `light ${conditional ? "suspect" : outcome}`, id: "decision", "aria-label": "Decision" }, h("p", { class: "word" }, h("i", { "aria-hidden": "true" }), `Part: ${WORDS[outcome]}${conditional ? ", if the alignment holds" : ""}`),
    h("p", {}, `${percent(share_within, 2)} of the points are within ${band}${own && visit.tolerance !== null ? `, or within that of their face on ${own === 1 ? "one face" : `${own} faces`}` : ""}; ${percent(required_share, 6)} are asked for, on the whole and on each face, and no place may be out.`),
    found.decision.places.length ? h("p", {}, `${found.decision.places.length} ${found.decision.places.length === 1 ? "place is" : "places are"} not proven to be within; the worst deviates by ${off(found.decision.places[0].value, unit)}.`) : null);
}
function figures(app, found, unit) {
  const { counts, summary } = found, others = [["other_surfaces", "on surfaces that leave the part"], ["outliers", "single outliers"], ["beyond_reach", `farther off than ${long(found.reach, unit)}`], ["excluded", "excluded"]].filter(([key]) => counts[key]);
  return h("p", { class: "note" }, `${count(counts.on_part)} points on the part${others.length ? `; left out: ${others.map(([key, words]) => `${count(counts[key])} ${words}`).join(", ")}` : ""}. 95 % of them deviate by ${long(summary.p95, unit)} or less; mean ${off(Math.abs(summary.mean) < 1e-3 * summary.p95 ? 0 : summary.mean, unit, 2)}. ${found.signed ? "Plus is outside the part." : found.sides}`);
}
function legend(found, unit) {
  const { table, low, high } = found.drawing.scale, canvas = h("canvas", { width: "254", height: "1", class: "ramp", "aria-hidden": "true" }), pen = canvas.getContext("2d"), image = pen.createImageData(254, 1);
  for (let k = 0; k < 254; k++) { for (let c = 0; c < 3; c++) image.data[4 * k + c] = table[3 * (k + 1) + c]; image.data[4 * k + 3] = 255; }
  pen.putImageData(image, 0, 0);
  return h("figure", { class: "legend" }, canvas, h("div", { class: "marks" }, h("span", {}, `${off(low, unit)}`), low < 0 && h("span", {}, "0"), h("span", {}, `${off(high, unit)}`)));
}
function worst(app, stage, found, unit) {
  return h("section", {}, h("h3", {}, "Worst places"), h("ol", { class: "places" }, found.worst.map((each, k) => h("li", {}, h("button", { id: `worst-${k}`, onclick: () => {
    stage.middle = inDrawing(each.at, app.results.part.frame); stage.zoom = 3.2; stage.draw();
  } }, `${off(each.value, unit)}`)))));
}
function faces(app, stage) {
  const unit = app.unit(), state = app.step_state.judge;
  const set = (face, input) => {
    const both = sides(input.value), others = app.visit.faces.filter(f => f.face !== face);
    if (both === undefined) { app.say(NEITHER); return null; }
    app.say("");
    return choose(app, stage, { faces: both ? [...others, { face, tolerance: both.plus, minus: both.minus }].sort((a, b) => a.face - b.face) : others });
  };
  return h("section", { id: "faces" }, h("h3", {}, "Faces"), h("p", { class: "note" }, `Click a face on the part, or write its own tolerance here: ${SIDES}.`),
    h("div", { class: "scroll" }, h("table", { class: "faces" }, h("thead", {}, h("tr", {}, ["Face", "Within", `Tolerance (${unit || "part's unit"})`, ""].map(t => h("th", { scope: "col" }, t)))),
      h("tbody", {}, rows(app).filter(r => r.region || r.own).map(row => h("tr", { class: row.face.number === state.face ? "chosen" : "" },
        h("td", {}, faceName(row.face, unit)), h("td", { class: "n" }, row.region?.share_within != null ? percent(row.region.share_within) : row.region ? `${number(row.region.within)} (95 %)` : "not scanned"),
        h("td", {}, h("input", { id: `face-${row.face.number}`, class: "short", autocomplete: "off", "aria-label": `Tolerance of face ${row.face.number}`, value: sidesText(row.own?.tolerance, row.own?.minus), placeholder: sidesText(app.visit.tolerance, app.visit.minus) || "none", onfocus: () => { if (state.face !== row.face.number) { state.face = row.face.number; colourFaces(app, stage); } }, onchange: e => set(row.face.number, e.target) })),
        h("td", { class: `outcome ${row.outcome ?? ""}` }, row.outcome ? SHORT[row.outcome] : "")))))));
}
function bands(found, unit) {
  const edge = x => x === null ? "" : signed(x);
  return h("details", { id: "bands" }, h("summary", {}, "Bands"), h("table", {}, h("tbody", {}, found.bands.map(band => h("tr", {}, h("td", {}, band.low === null ? `below ${edge(band.high)}` : band.high === null ? `above ${edge(band.low)}` : `${edge(band.low)} … ${edge(band.high)} ${unit}`), h("td", { class: "n" }, count(band.count)), h("td", { class: "n" }, percent(band.share)))))));
}
