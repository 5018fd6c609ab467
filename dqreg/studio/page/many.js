// Many parts: the table of a batch, as it fills; a row opens its part.
import { ask, send } from "./api.js";
import { h, long, percent, show } from "./dom.js";

const SIGNS = { accepted: "trusted", suspect: "doubtful", failed: "failed", "not run": "not run", error: "error", crashed: "ended", timeout: "took too long", memory: "too large" };
const LIGHT = { accepted: "pass", suspect: "undecided" };
// A pass on an alignment that is not trusted.
const conditional = row => row.outcome === "pass" && row.level !== "accepted";
let timer;

export async function open(app, home) {
  clearTimeout(timer);
  const found = await ask("many");
  if (!found) return;
  const levels = {};
  for (const row of found.rows) levels[row.level] = (levels[row.level] ?? 0) + 1;
  show(home, h("h2", {}, "Many parts"),
    h("p", { id: "many-said" }, `${found.rows.length}${found.total && !found.over ? ` of ${found.total}` : ""} done${found.over ? "" : " so far"}: ${Object.entries(levels).map(([level, n]) => `${n} ${SIGNS[level] ?? level}`).join(", ") || "none yet"}.`),
    h("div", { class: "scroll" }, h("table", { class: "faces", id: "many" }, h("thead", {}, h("tr", {}, ["Scan", "Alignment", "Distance (rms)", "On the part", "Part", ""].map(t => h("th", { scope: "col" }, t)))),
      h("tbody", {}, found.rows.map(row => h("tr", { title: row.why ?? "" }, h("td", {}, row.name), h("td", { class: `outcome ${LIGHT[row.level] ?? "fail"}` }, SIGNS[row.level] ?? row.level),
        h("td", { class: "n" }, row.rms ? long(row.rms, row.unit) : ""), h("td", { class: "n" }, row.inliers ? percent(row.inliers, 0) : ""), h("td", { class: `outcome ${conditional(row) ? "undecided" : row.outcome ?? ""}` }, conditional(row) ? "pass, if the alignment holds" : row.outcome ?? ""),
        h("td", {}, row.opens && h("button", { id: `row-${row.name}`, onclick: async () => { const told = await send(`many/${encodeURIComponent(row.name)}`); location.hash = `${told.name}/align`; location.reload(); } }, "Open"))))))),
    h("button", { id: "many-back", onclick: () => { clearTimeout(timer); app.many = false; app.render(); } }, "Back to the part"));
  if (!found.over) timer = setTimeout(() => app.many && open(app, home), 2000);
}
