// A running odometry in the frame of the studio: map, frame and trajectory as they grow.
import { ask, fetchBytes } from "./api.js";
import { copyable, count, h, show } from "./dom.js";

const POLL = 500, LEVELS = { accepted: "trusted", suspect: "doubtful", failed: "failed" };
const $ = selector => document.querySelector(selector);

export async function begin(stage) {
  const state = { told: null, seen: 0, map: "", follow: true };
  $("header nav").hidden = $("#undo").hidden = true;
  stage.layers.before = true;
  stage.drawOver = () => trajectory(stage, state.told?.path ?? []);
  await step(stage, state);
}

async function step(stage, state) {
  try {
    const told = state.told = await ask("odometry");
    if (told.frames !== state.seen && told.frame) await draw(stage, state, told);
    panel(stage, state);
    if (told.over) return;
  } catch (error) { $("#said").replaceChildren(h("p", {}, error.message)); }
  setTimeout(() => step(stage, state), POLL);
}

async function draw(stage, state, told) {
  const first = !state.seen;
  stage.scene.size = told.size;
  // A drawing that was replaced meanwhile comes with the next question.
  const [frame, map] = await Promise.all([told.frame, told.map?.file !== state.map ? told.map : null].map(each => each && fetchBytes(`odometry/${each.file}`).catch(() => null)));
  if (map) { state.map = told.map.file; stage.setPart(told.map, map); }
  if (frame) stage.setScan(told.frame, frame);
  state.seen = told.frames;
  stage.move(told.T);
  if (first || state.follow) stage.fit();
}

function trajectory(stage, path) {
  const line = document.createElementNS("http://www.w3.org/2000/svg", "polyline");
  line.setAttribute("class", "path");
  line.setAttribute("points", path.map(place => stage.toScreen(place).map(x => x.toFixed(1)).join(",")).join(" "));
  stage.over.replaceChildren(line);
}

function panel(stage, state) {
  const { told } = state, counts = Object.keys(LEVELS).map(level => [level, told.levels.filter(each => each === level).length]).filter(([, n]) => n);
  const last = told.levels.at(-1);
  show($("#panel"), h("h2", {}, "Odometry"),
    h("p", { id: "odometry-said" }, told.error ?? (told.frames ? `Frame ${told.frames} of ${told.of} of ${told.name}${told.over ? ": done" : ""}.` : `Reading ${told.name}.`)),
    !told.over && h("progress", { max: String(told.of ?? 1), value: told.of ? String(told.frames) : null, "aria-label": "Frames" }),
    counts.length ? h("section", { class: `light ${last}` }, h("p", { class: "word" }, h("i", { "aria-hidden": "true" }), `Last frame: ${LEVELS[last]}`),
      told.reasons?.length ? h("ul", {}, told.reasons.map(each => h("li", {}, each))) : null,
      h("p", { class: "note" }, `So far ${counts.map(([level, n]) => `${count(n)} ${LEVELS[level]}`).join(", ")}. Map: ${count(told.map?.total ?? 0)} cells.`)) : null,
    h("label", { class: "check" }, h("input", { type: "checkbox", id: "follow", checked: state.follow, onchange: e => { state.follow = e.target.checked; if (state.follow) stage.fit(); } }), " Keep all of it in view"),
    h("details", { id: "same" }, h("summary", {}, "The same without this page"), copyable("In a terminal", told.command)));
}
