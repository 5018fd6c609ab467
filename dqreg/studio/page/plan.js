// An inspection plan in the step Judge: what it asks beside deviations, and a file to have one from.
import { h, number } from "./dom.js";

const SHORT = { pass: "pass", fail: "fail", undecided: "undecided" };
const MOST = 262144;

async function take(app, input, choose) {
  const [file] = input.files;
  if (!file) return;
  input.value = "";
  if (file.size > MOST) { app.say(`${file.name} is too large for a plan.`); return; }
  app.say("");
  await choose({ plan: await file.text() });
}

export function panel(app, found) {
  const rows = found.characteristics ?? [], unit = app.unit(), degrees = ["angle"];
  const limits = row => row.low === null || row.high === null ? "" : row.low === 0 && row.nominal === 0 ? `≤ ${number(row.high, 4)}` : `${number(row.low, 6)} … ${number(row.high, 6)}`;
  const value = row => row.remark ? row.remark : `${number(row.value, 5)} ± ${number(row.uncertainty, 2)}${degrees.includes(row.kind) ? "°" : unit ? ` ${unit}` : ""}`;
  if (!rows.length) return null;
  const conditional = found.outcome === "pass" && !found.alignment_trusted;
  return h("section", { id: "characteristics" }, !found.decision && h("div", { class: `light ${conditional ? "suspect" : found.outcome}` }, h("p", { class: "word" }, h("i", { "aria-hidden": "true" }), `Part: ${SHORT[found.outcome]}${conditional ? ", if the alignment holds" : ""}`)),
    h("h3", {}, "Characteristics of the plan"),
    h("div", { class: "scroll" }, h("table", { class: "faces" }, h("thead", {}, h("tr", {}, ["Characteristic", "Allowed", "Measured", ""].map(t => h("th", { scope: "col" }, t)))),
      h("tbody", {}, rows.map(row => h("tr", {}, h("td", {}, row.name), h("td", {}, limits(row)), h("td", {}, value(row)), h("td", { class: `outcome ${row.outcome}` }, SHORT[row.outcome])))))));
}

export function file(app, choose) {
  return h("div", { class: "row" }, h("label", { class: "button", for: "plan-file" }, "Use a plan…"), h("input", { type: "file", id: "plan-file", class: "file", accept: ".toml", onchange: e => take(app, e.target, choose) }),
    h("span", { class: "note" }, "an inspection plan (TOML) in place of what is chosen here"));
}
