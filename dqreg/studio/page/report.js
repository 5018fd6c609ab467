// Step 5: the sheet, and the plan for the next five hundred.
import { h } from "./dom.js";
import { address } from "./api.js";

const NAMES = { "report.html": "Report (HTML)", "report.pdf": "Report (PDF)", "plan.toml": "Plan (TOML)", "result.json": "Pose (JSON)", "visit.json": "Visit (JSON)", "start.txt": "Initial pose" };
const HEAD = { part: "Part", drawing: "Drawing", serial: "Serial number", order: "Order", operator: "Operator", device: "Device", note: "Note" };
export function enter(app, stage) { stage.picked = null; app.showJudged = true; app.draw(); }

async function make(app, task, words) {
  const found = await app.run(task, {}, words);
  await app.refresh();
  app.results.report = found;
  app.stamp_report = Date.now();
  app.render();
}
function views(app, stage) {
  const { views } = app.visit, round = x => Math.round(10 * x) / 10;
  const here = () => app.change({ views: [...views, [round(((stage.yaw % 360) + 360) % 360), round(stage.pitch)]] });
  return h("section", {}, h("h3", {}, "Pictures in print"), h("p", { class: "note" }, views.length ? "The deviations as they are seen from:" : "Before, and the deviations from three sides. Turn the view and add others, if you like."),
    views.length ? h("ul", { class: "list" }, views.map(([yaw, pitch], k) => h("li", {}, h("button", { id: `view-${k}`, onclick: () => { stage.yaw = yaw; stage.pitch = pitch; stage.fit(); } }, `View ${k + 1}`), " ",
      h("button", { id: `unview-${k}`, "aria-label": `Remove view ${k + 1}`, onclick: () => app.change({ views: views.filter((_, i) => i !== k) }) }, "Remove")))) : null,
    h("button", { id: "add-view", disabled: views.length >= 8, onclick: here }, "Add the view as it is now"));
}

export function panel(app, stage) {
  const found = app.results.report, head = Object.fromEntries(app.visit.head), busy = Boolean(app.busy.task);
  const set = (key, value) => {
    const now = { ...Object.fromEntries(app.visit.head), [key]: value };
    return app.change({ head: Object.keys(HEAD).map(each => [each, now[each] ?? ""]).filter(([, words]) => words) });
  };
  return [
    h("div", { class: "head" }, Object.entries(HEAD).map(([key, words]) => [h("label", { for: `head-${key}` }, words), h("input", { id: `head-${key}`, maxlength: "400", value: head[key] ?? "", autocomplete: "off", onchange: e => set(key, e.target.value.trim()) })])),
    views(app, stage),
    h("div", { class: "row" }, h("button", { id: "make-report", class: found ? "" : "main", disabled: busy, onclick: () => make(app, "report", "Writing the report") }, found ? "Write it again" : "Write the report"),
      found && !found.files.includes("report.pdf") && h("button", { id: "make-pdf", disabled: busy, onclick: () => make(app, "pdf", "Printing the report") }, "As PDF too")),
    found && h("ul", { class: "downloads" }, [...found.files, "visit.json"].map(name => h("li", {}, h("a", { class: "button", id: `file-${name}`, download: name, href: address(`visits/${app.name}/files/${name}?keep`) }, NAMES[name] ?? (name.endsWith("_cleaned.ply") ? "Cleaned scan" : name))))),
    found?.files.includes("plan.toml") && h("p", { class: "note" }, "The plan does the same for the next scans: dqreg inspect runs it on one, dqreg batch on many."),
    found && h("iframe", { id: "sheet", title: "The report", sandbox: "allow-scripts allow-modals", src: address(`visits/${app.name}/files/report.html?${app.stamp_report ?? 0}`) }),
  ];
}
