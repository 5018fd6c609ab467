// The page: one visit, five steps, one drawing.
import { address, ask, events, fetchBytes, send, Stopped, Trouble, upload } from "./api.js";
import { copyable, count, h, show } from "./dom.js";
import { Stage, colours } from "./stage.js";
import * as load from "./load.js";
import * as clean from "./clean.js";
import * as align from "./align.js";
import * as judge from "./judge.js";
import * as report from "./report.js";
import * as many from "./many.js";
import * as odometry from "./odometry.js";

const STEPS = { load, clean, align, judge, report };
const TITLES = { load: "Load", clean: "Clean", align: "Align", judge: "Judge", report: "Report" };
// Results of tasks that are shown under their own name.
const KEPT = ["align", "reach", "judge", "report"];
const $ = selector => document.querySelector(selector);

export const app = {
  step: "load", busy: {}, visit: null, results: {}, shown: {}, step_state: {},

  async change(values) {
    // At once here too: the next change must not start from the state before this one.
    const { units, swap, plan, ...fields } = values;
    app.visit = { ...app.visit, ...fields };
    const number = app.changes = (app.changes ?? 0) + 1;
    try {
      const told = await send(`visits/${app.name}/change`, values);
      // What an earlier change became is of yesterday where another one was made since.
      if (number === app.changes) accept(told);
    } catch (error) { await app.refresh(); throw error; }
  },
  async run(task, values = {}, words = "") {
    app.busy = { task, words }; render();
    try {
      const answer = await send(`visits/${app.name}/run/${task}`, values);
      // There before the bar goes: no moment without either.
      if (KEPT.includes(task)) app.results[task] = answer;
      return answer;
    }
    finally { app.busy = {}; render(); }
  },
  // A question that is answered at once: no bar for it.
  quick: (task, values) => send(`visits/${app.name}/run/${task}`, values),
  // A run that this page did not begin, or began before it was reloaded: its end is waited for.
  async resume(task) {
    app.busy = { task, words: "Still at it" }; render();
    while (app.busy.task === task) {
      await new Promise(done => setTimeout(done, 400));
      const told = await ask(`visits/${app.name}`);
      if (!told.running) { app.busy = {}; accept(told); }
    }
  },
  async refresh() { accept(await ask(`visits/${app.name}`)); },
  async upload(side, file) {
    app.busy = { task: "upload", words: `Taking in ${file.name}`, reached: 0 }; render();
    try {
      accept(await upload(`visits/${app.name}/${side}?name=${encodeURIComponent(file.name)}`, file, share => {
        app.busy = { ...app.busy, reached: share }; progress();
      }));
    } finally { app.busy = {}; }
    await app.read();
  },
  // What is known of both files, and their drawings.
  async read() {
    for (const side of ["scan", "part"]) if (app.visit[side] && !app.results[side])
      app.results[side] = await app.run(side, {}, `Reading ${app.visit[side].name}`);
    if (app.visit.scan && !app.results.draw_scan) app.results.draw_scan = await app.run("draw_scan", {}, "Drawing the scan");
    if (app.visit.scan && app.visit.part && !app.results.compare)
      app.results.compare = await app.run("compare", {}, "Comparing sizes");
    await app.draw();
    render();
    load.askMirror(app).catch(() => {});
  },
  async draw() {
    const { scan, part } = app.results;
    await drawSide("part", part?.drawing, (d, b) => stage.setPart(d, b));
    const name = app.showKinds && app.results.reach ? "reach" : app.showJudged && app.results.judge ? "judge" : "scan", judged = app.results[name]?.drawing;
    if (judged || app.results.draw_scan || !app.visit.scan) await drawSide("scan", name === "scan" ? app.results.draw_scan : judged, (d, b) => stage.setScan(d, b), name);
    const size = (part ?? scan)?.frame.size ?? 1;
    stage.scene.size = size;
    stage.scene.unit = app.unit();
    stage.scene.spacing = (scan?.spacing ?? 0) * app.scale() / size;
    stage.scene.origin = part?.frame.middle ?? [0, 0, 0];
  },
  unit() { return app.results.compare?.units?.[1] ?? app.visit?.part?.units ?? app.results.part?.units ?? ""; },
  scale() { return app.results.compare?.scale ?? 1; },
  go(step) { app.many = false; STEPS[app.step].leave?.(app, stage); app.step = step; location.hash = `${app.name}/${step}`; STEPS[step].enter?.(app, stage); render(); $("#panel").focus({ preventScroll: true }); },
  say(words, file) { $("#said").replaceChildren(words ? h("p", {}, words, file && h("a", { href: address(`visits/${app.name}/files/${file}?keep`), download: file }, `Save ${file}`), h("button", { onclick: () => app.say("") }, "Close")) : ""); },
  render, stop: () => send(`visits/${app.name}/cancel`).catch(() => {}),
};
globalThis.studio = app;

async function drawSide(side, drawing, place, name = side) {
  const mark = drawing ? `${name} ${JSON.stringify([drawing.file, drawing.count, drawing.on, app.visit.cuts, app.stamp?.[name] ?? 0])}` : "";
  if (app.shown[side] === mark) return;
  const bytes = drawing ? await fetchBytes(`visits/${app.name}/data/${drawing.file}`) : null;
  place(drawing, bytes);
  app.shown[side] = mark;
  if (name === "scan") app.scanBuffer = bytes;
  stage.fit();
}

// A drawing of the same name with other points in it.
app.renewed = name => { app.stamp = { ...app.stamp, [name]: (app.stamp?.[name] ?? 0) + 1 }; };

function accept(told) {
  Object.assign(app, { name: told.name, visit: told.visit, results: told.results, undo: told.undo, words: told.words });
  render();
}

function ready(step) {
  const both = app.results.scan && app.results.part;
  return { load: true, clean: both, align: both, judge: both && app.results.align?.found, report: both && app.results.align?.found }[step];
}

// A button must not be replaced between the press and the release that make a click.
let pressed = false, waiting = false;
addEventListener("pointerdown", () => { pressed = true; }, true);
for (const name of ["pointerup", "pointercancel", "blur"]) addEventListener(name, () => setTimeout(() => {
  pressed = false;
  if (waiting) { waiting = false; render(); }
}), true);

function render() {
  if (!app.visit) return;
  if (pressed) { waiting = true; return; }
  const steps = Object.keys(TITLES);
  show($("#steps"), steps.map(step => h("li", {}, h("button", {
    id: `step-${step}`, "aria-current": step === app.step ? "step" : null, disabled: !ready(step), onclick: () => app.go(step),
  }, TITLES[step]))));
  $("#undo").disabled = !app.undo || Boolean(app.busy.task);
  if (app.many) { many.open(app, $("#panel")); return; }
  const next = steps[steps.indexOf(app.step) + 1];
  show($("#panel"), h("h2", {}, TITLES[app.step]), STEPS[app.step].panel(app, stage), busyBox(),
    next && h("div", { class: "next" }, h("button", { id: "next", class: "main", disabled: !ready(next) || Boolean(app.busy.task), onclick: () => app.go(next) }, `Next: ${TITLES[next]}`)),
    app.words?.[app.step] && h("details", { id: "same" }, h("summary", {}, "The same without this page"),
      copyable("In a terminal", app.words[app.step].command), copyable("In Python", app.words[app.step].python)));
  show($("#under"), STEPS[app.step].under?.(app, stage) ?? "");
  said();
}
function busyBox() {
  if (!app.busy.task) return null;
  return h("div", { class: "busy", id: "busy" }, h("p", { id: "busy-words" }, app.busy.words || "Working"),
    h("progress", { id: "busy-bar", max: "1", "aria-label": "Progress" }),
    app.busy.task !== "upload" && h("button", { id: "stop", onclick: app.stop }, "Stop"));
}
function progress() {
  const bar = $("#busy-bar"), { reached, left, words } = app.busy;
  if (!bar) return;
  if (reached) bar.value = reached;
  const time = left === null || left === undefined ? "" : left < 1 ? ", a moment left" : `, about ${Math.round(left)} s left`;
  $("#busy-words").textContent = `${words}${time}`;
}
app.progress = progress;

function said() {
  const { scan, part } = app.results, on = stage.scene.on?.count ?? 0, parts = [], { drawn, pace } = stage;
  if (scan && on && on < scan.points) parts.push(`${count(on)} of ${count(scan.points)} points`);
  if (part?.drawing?.drawn < part?.triangles) parts.push(`${count(part.drawing.drawn)} of ${count(part.triangles)} triangles`);
  const full = (part?.drawing?.drawn ?? 0) + on, less = drawn && drawn.points + drawn.triangles < full;
  const moving = less ? ` While the view moves: ${count(drawn.points)} points and ${count(drawn.triangles)} triangles${pace.frames ? `, ${Math.round(pace.frames)} frames a second` : ""}.` : "";
  $("#drawn").textContent = `${parts.length ? `Drawn: ${parts.join(" and ")}. All of them are measured.` : ""}${moving}`.trim();
}

// Whatever goes wrong is a sentence; nothing that was chosen is lost.
addEventListener("unhandledrejection", e => {
  if (e.reason instanceof Stopped) app.say("Stopped. Nothing was changed.");
  else if (e.reason instanceof Trouble) app.say(e.reason.message, e.reason.file);
  else { app.say(`Something went wrong on this page: ${e.reason?.message ?? e.reason}. Reload it: your visit is kept.`); return; }
  e.preventDefault();
});

function theme() {
  const root = document.documentElement, dark = matchMedia("(prefers-color-scheme: dark)"), button = $("#theme");
  const isDark = () => (root.dataset.theme || (dark.matches ? "dark" : "light")) === "dark";
  const redraw = () => { colours.clear(); stage.drawNow(); app.second?.drawNow(); button.textContent = isDark() ? "Light" : "Dark"; };
  button.addEventListener("click", () => { root.dataset.theme = isDark() ? "light" : "dark"; redraw(); });
  dark.addEventListener("change", redraw);
  redraw();
}

function listen() {
  const source = events(`visits/${app.name}/events`);
  source.onmessage = e => {
    const told = JSON.parse(e.data);
    if (app.busy.task !== "align") return;
    app.busy = { ...app.busy, reached: told.reached, left: told.left, words: told.words || "Refining the pose" };
    progress();
    if (told.drawn && app.step === "align") { stage.move(told.drawn); stage.hurry(); }
  };
  addEventListener("pagehide", () => source.close());
}

function dropping() {
  addEventListener("dragover", e => { e.preventDefault(); document.body.classList.add("dropping"); });
  addEventListener("dragleave", e => { if (!e.relatedTarget) document.body.classList.remove("dropping"); });
  addEventListener("drop", async e => {
    e.preventDefault();
    document.body.classList.remove("dropping");
    const side = e.target.closest?.("[data-side]")?.dataset.side;
    await load.take(app, [...e.dataTransfer.files], side);
  });
}

let stage;
async function begin() {
  try { stage = new Stage($("#main3d")); } catch (error) {
    $("#said").textContent = `This browser draws no WebGL 2 (${error.message}). Switch on hardware acceleration, or use another browser.`;
    return;
  }
  app.stage = stage;
  theme();
  if (await ask("odometry")) { await odometry.begin(stage); document.body.dataset.ready = "yes"; return; }
  stage.told = said;
  $("#undo").addEventListener("click", async () => { accept(await send(`visits/${app.name}/undo`)); app.shown = {}; await app.read(); STEPS[app.step].enter?.(app, stage); });
  dropping();
  const [name, step] = location.hash.slice(1).split("/");
  const known = await ask("visits");
  const told = known.some(each => each.visit === name) ? await ask(`visits/${name}`) : await send("visits");
  app.others = known.filter(each => each.visit !== told.name && (each.scan || each.part));
  accept(told);
  if (told.lost) app.say(told.lost);
  location.hash = `${app.name}/${app.step}`;
  listen();
  if (told.running) await app.resume(told.running);
  if (await ask("many")) {
    $("#many-parts").hidden = false;
    $("#many-parts").addEventListener("click", () => { app.many = true; render(); });
    // Without files of its own the page is about the batch.
    if (!app.visit.scan && !app.visit.part) { app.many = true; render(); }
  }
  await app.read();
  if (step in STEPS && ready(step)) app.go(step); else STEPS.load.enter(app, stage);
  document.body.dataset.ready = "yes";
}
addEventListener("keydown", e => {
  if ((e.ctrlKey || e.metaKey) && e.key === "z" && !(e.target instanceof HTMLInputElement)) { e.preventDefault(); $("#undo").click(); }
});
begin();
