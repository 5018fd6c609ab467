// Step 3: the scan is laid on the part; what came of it, and how sure it is.
import { h, number, percent } from "./dom.js";
import { STAND } from "./stage.js";

const LIGHTS = { accepted: ["Trusted", "The pose can be used."], suspect: ["Doubtful", "Look at it before you use it."], failed: ["Failed", "No pose was found that can be used."] };

export function enter(app, stage) {
  app.showJudged = false;
  app.draw().then(() => showPose(app, stage, app.results.align?.history?.length ?? 0));
}
function showPose(app, stage, at) {
  const found = app.results.align, last = found?.history?.length ?? 0;
  app.step_state.at = at;
  const before = app.results.compare?.poses?.beside ?? STAND;
  stage.layers.before = at < last || !found?.drawn;
  stage.move(!found ? before : at >= last ? found.drawn ?? before : at === 0 ? before : found.history[at].drawn);
}

async function run(app, stage) {
  app.say("");
  stage.layers.before = true;
  const found = await app.run("align", {}, "Looking for the pose");
  await app.refresh();
  app.results.align = found;
  showPose(app, stage, found.history.length);
  stage.fit();
  app.render();
}

export function panel(app, stage) {
  const found = app.results.align;
  return [
    h("p", {}, "Finds how the scan lies on the part. No first guess is needed."),
    h("button", { id: "align", class: found ? "" : "main", disabled: Boolean(app.busy.task), onclick: () => run(app, stage) }, found ? "Align again" : "Align"),
    found && verdict(app, found),
  ];
}

export function verdict(app, found) {
  const [word, advice] = LIGHTS[found.level], unit = app.unit();
  return h("section", { class: `light ${found.level}`, id: "verdict", "aria-label": "Verdict" },
    h("p", { class: "word" }, h("i", { "aria-hidden": "true" }), `Alignment: ${word.toLowerCase()}`),
    h("p", {}, advice), found.reasons.length ? h("ul", {}, found.reasons.map(r => h("li", {}, r))) : null,
    found.found && h("p", { class: "note" }, `Distance of the points on the part: ${number(found.rms)} ${unit} (root mean square); ${percent(found.inliers, 0)} of the scan lies on it; ${number(found.seconds, 2)} s.`));
}

export function under(app, stage) {
  const found = app.results.align;
  if (!found?.drawn) return null;
  const last = found.history.length;
  return h("div", { class: "slider" }, h("label", { for: "before-after" }, "Before"),
    h("input", { type: "range", id: "before-after", min: "0", max: String(last), value: String(app.step_state.at ?? last), "aria-label": "From before to after, iteration by iteration", oninput: e => showPose(app, stage, Number(e.target.value)) }),
    h("span", {}, "After"));
}
