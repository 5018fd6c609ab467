// Step 1: two files, what they hold, and the one question about units where it is needed.
import { h, facts, number, count, long } from "./dom.js";
import { Trouble } from "./api.js";
import { STAND } from "./stage.js";

const UNITS = ["mm", "cm", "m", "inch", "ft", "um"];
const MESHES = /\.(stl|obj|off|glb|gltf|3mf|step|stp|iges|igs)$/i;

export function enter(app, stage) {
  app.showJudged = false;
  app.draw().then(() => {
    const poses = app.results.compare?.poses;
    stage.layers.before = true;
    stage.move(poses?.beside ?? STAND);
    stage.fit();
  });
}

// Dropped together: surfaces are the part, points the scan; dropped on a side: that side.
export async function take(app, files, side) {
  if (!files.length) return;
  if (files.length > 2) throw new Trouble("Drop one scan and one part; many scans at once are the work of dqreg batch.");
  app.say("");
  const order = files.map((file, k) => [side && files.length === 1 ? side : null, file, k]);
  const meshes = files.filter(f => MESHES.test(f.name));
  for (const [given, file] of order) {
    let goal = given;
    if (!goal && files.length === 2) goal = meshes.length === 1 ? (meshes[0] === file ? "part" : "scan") : file === files[0] ? "scan" : "part";
    goal ??= MESHES.test(file.name) ? "part" : app.visit.scan && !app.visit.part ? "part" : "scan";
    await app.upload(goal, file);
  }
  enter(app, app.stage);
}

function zone(app, side, words) {
  const chosen = app.visit[side], known = app.results[side];
  const input = h("input", { type: "file", id: `file-${side}`, class: "file", onchange: e => take(app, [...e.target.files], side) });
  return h("section", { class: "zone", "data-side": side },
    h("h3", {}, side === "scan" ? "Scan" : "Part"),
    chosen ? h("p", { class: "filename" }, chosen.name) : h("p", { class: "soft" }, words),
    h("label", { class: "button", for: `file-${side}` }, chosen ? "Another file…" : "Choose a file…"), input,
    known && table(app, side, known));
}

function table(app, side, known) {
  const own = app.visit[side].units ?? known.units, unit = own ?? "";
  const size = known.extents.map(x => number(x, 4)).join(" × ");
  const select = h("select", { id: `units-${side}`, "aria-label": `Unit of the ${side}`, onchange: e => name(app, { [side]: e.target.value || null }) },
    h("option", { value: "", selected: !app.visit[side].units }, known.units ? `${known.units} (from the file)` : "not named"),
    UNITS.map(each => h("option", { value: each, selected: app.visit[side].units === each }, each)));
  return facts([
    ["Size", `${size} ${unit}`],
    ["Unit", select],
    known.kind === "mesh" ? ["Surface", `${count(known.triangles)} triangles`] : ["Points", count(known.points) + (known.dropped ? ` (${count(known.dropped)} empty ones left out)` : "")],
    known.spacing ? ["Spacing", `${long(known.spacing, unit)}`] : null,
    known.noise ? ["Noise", `about ${number(known.noise, 2)} ${unit}`] : null,
    known.kind === "cloud" ? ["Normals", known.normals ? "in the file" : side === "scan" ? "none in the file; estimated where needed" : "none in the file"] : null,
    side === "part" && known.faces?.length ? ["Faces", faceWords(known.faces)] : null,
    side === "part" && known.unsigned ? ["Sides", `${known.unsigned}.`] : null,
  ]);
}
function faceWords(faces) {
  const holes = faces.filter(f => f.hole).length;
  return `${faces.length}${holes ? `, ${holes} of them holes` : ""}`;
}
async function name(app, units) {
  await app.change({ units });
  await app.read();
  enter(app, app.stage);
}

function questions(app) {
  return (app.results.compare?.questions ?? []).map(question => {
    if (question.code === "units") {
      const ratio = question.ratio > 1 ? `${number(question.ratio, 4)} times as large as` : `${number(1 / question.ratio, 4)} times smaller than`;
      return h("div", { class: "ask" }, h("p", {}, `The scan is ${ratio} the part, as if the scan were in ${question.scan_units} and the part in ${question.part_units}. Is that so?`),
        h("div", { class: "row" }, h("button", { id: "yes-units", class: "main", onclick: () => name(app, { scan: question.scan_units, part: question.part_units }) }, `Yes: ${question.scan_units} and ${question.part_units}`),
          h("span", { class: "note" }, "or choose the units below")));
    }
    if (question.code === "unnamed") {
      const size = app.results.part.extents.map(x => number(x, 4)).join(" × ");
      return h("div", { class: "ask", id: "unnamed" }, h("p", {}, `The part is ${size} large, and its file does not say in what. Which unit is it?`),
        h("div", { class: "row" }, UNITS.map(unit => h("button", { id: `unit-${unit}`, class: unit === question.likely ? "main" : "", onclick: () => name(app, { part: unit, ...(app.results.scan.units || app.visit.scan.units ? {} : { scan: unit }) }) }, unit))));
    }
    const why = question.why === "open" ? "The scan is a closed surface, as CAD is, and the part an open one, as scans are." : "The scan is a surface and the part is a cloud of points.";
    return h("div", { class: "ask", id: "swapped" }, h("p", {}, `${why} Are they the wrong way round?`),
      h("button", { id: "swap", class: "main", onclick: async () => { await app.change({ swap: true }); app.shown = {}; await app.read(); enter(app, app.stage); } }, "Exchange them"));
  });
}

// A scan from a left-handed frame fits its part in the mirror only: asked as soon as units are known, answered once.
export async function askMirror(app) {
  const { scan, part } = app.visit, { compare, mirror } = app.results, asked = JSON.stringify([scan, part, app.visit.mirrored]);
  if (!compare || mirror || app.mirrorAsked === asked || compare.questions.length) return;
  app.mirrorAsked = asked;
  const found = await app.quick("mirror");
  if (asked !== JSON.stringify([app.visit.scan, app.visit.part, app.visit.mirrored])) return;
  app.results.mirror = found;
  app.render();
}
export async function mirror(app, mirrored) {
  await app.change({ mirrored });
  app.shown = {};
  await app.read();
  enter(app, app.stage);
}
function mirrorQuestion(app) {
  if (app.visit.mirrored) return h("div", { class: "ask", id: "is-mirrored" }, h("p", {}, "The scan is mirrored: its x coordinates are reversed before all else. The file is not changed."), h("button", { id: "unmirror", onclick: () => mirror(app, false) }, "As in the file again"));
  if (!app.results.mirror?.mirrored || app.step_state.load?.kept) return null;
  return h("div", { class: "ask", id: "mirrored" }, h("p", {}, "The scan fits the part only as its mirror image: it comes from a left-handed frame, or it is of the other hand (left instead of right)."),
    h("div", { class: "row" }, h("button", { id: "mirror", class: "main", onclick: () => mirror(app, true) }, "Mirror the scan"),
      h("button", { id: "no-mirror", onclick: () => { app.step_state.load = { kept: true }; app.render(); } }, "Leave it as it is")));
}

export function panel(app) {
  const both = app.visit.scan && app.visit.part;
  return [
    !both && h("p", {}, "Drop a scan and its part here, both at once or one by one. They stay on this machine."),
    questions(app),
    both && mirrorQuestion(app),
    zone(app, "scan", "Points or a surface as they were measured: PLY, PCD, XYZ, CSV, STL, OBJ …"),
    zone(app, "part", "The CAD part as a surface: STL, OBJ, PLY, 3MF …"),
    app.others?.length ? h("details", { id: "others" }, h("summary", {}, "Earlier visits"), h("ul", {}, app.others.map(each => h("li", {}, h("a", { href: `#${each.visit}/load`, onclick: () => setTimeout(() => location.reload()) }, `${each.scan ?? "no scan"} on ${each.part ?? "no part"}${each.lost ? " (its results could not be read)" : ""}`))))) : null,
  ];
}
