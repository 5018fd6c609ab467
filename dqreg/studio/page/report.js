// Step 5: the sheet, and the plan for the next five hundred.
import { h } from "./dom.js";
import { address } from "./api.js";

const NAMES = { "report.html": "Report (HTML)", "report.pdf": "Report (PDF)", "plan.toml": "Plan (TOML)", "result.json": "Pose (JSON)", "visit.json": "Visit (JSON)" };
export function enter() {}
async function make(app) {
  const found = await app.run("report", {}, "Writing the report");
  await app.refresh();
  app.results.report = found;
  app.stamp_report = Date.now();
  app.render();
}
export function panel(app) {
  const found = app.results.report;
  return [
    h("button", { id: "make-report", class: found ? "" : "main", disabled: Boolean(app.busy.task), onclick: () => make(app) }, found ? "Write it again" : "Write the report"),
    found && h("ul", { class: "downloads" }, [...found.files, "visit.json"].map(name => h("li", {}, h("a", { class: "button", download: name, href: address(`visits/${app.name}/files/${name}?keep`) }, NAMES[name] ?? name)))),
    found && h("iframe", { id: "sheet", title: "The report", sandbox: "allow-scripts allow-modals", src: address(`visits/${app.name}/files/report.html?${app.stamp_report ?? 0}`) }),
  ];
}
