// Step 4: is the part within its tolerance?
import { h, number, percent, signed } from "./dom.js";
import { STAND } from "./stage.js";

export function enter(app, stage) {
  app.showJudged = true;
  if (app.results.judge) place(app, stage); else measure(app, stage);
}
async function place(app, stage) {
  app.renewed("judged");
  await app.draw();
  stage.layers.before = false;
  stage.move(STAND);
  app.render();
}
export async function measure(app, stage) {
  const found = await app.run("judge", {}, "Measuring deviations");
  await app.refresh();
  app.results.judge = found;
  await place(app, stage);
}
async function choose(app, stage, values) { await app.change(values); await measure(app, stage); }

export function panel(app, stage) {
  const found = app.results.judge, unit = app.unit();
  return [
    h("form", { class: "fields", onsubmit: e => { e.preventDefault(); const value = Number(e.target.elements.tolerance.value.replace(",", ".")); choose(app, stage, { tolerance: value > 0 ? value : null }); } },
      h("label", { for: "tolerance" }, `Tolerance ± ${unit}`), h("input", { id: "tolerance", name: "tolerance", inputmode: "decimal", value: app.visit.tolerance ?? "", autocomplete: "off" }),
      h("button", { id: "set-tolerance" }, "Apply")),
    found?.decision && decision(app, found),
    found && figures(found, unit),
  ];
}
const WORDS = { pass: "within tolerance", fail: "out of tolerance", undecided: "undecided" };
function decision(app, found) {
  const { outcome, share_within, tolerance } = found.decision, unit = app.unit();
  return h("section", { class: `light ${outcome}`, id: "decision" }, h("p", { class: "word" }, h("i"), `Part: ${WORDS[outcome]}`),
    h("p", {}, `${percent(share_within, 2)} of the points are within ±${number(tolerance)} ${unit}.`));
}
function figures(found, unit) {
  return h("p", { class: "note" }, `95 % of the points deviate by ${number(found.summary.p95)} ${unit} or less; mean ${signed(found.summary.mean)} ${unit}.`);
}
