// The page of a report: one scene, two canvases, drawn by view3d.js.
(() => {
"use strict";
const { $, all, still, bytes, readCloud, length, moved, STAND, colours, View } = View3d;

// ---- the page --------------------------------------------------------------------------------------------------
function readScene() {
  const holder = $("#scene");
  if (!holder) return null;
  const scene = JSON.parse(holder.textContent);
  scene.on = readCloud(scene.on);
  scene.off = readCloud(scene.off);
  scene.target = readCloud(scene.target);
  if (scene.target.kind === "mesh") {
    scene.target.faceNumbers = new Uint32Array(bytes(scene.target.faces));
    if (scene.target.faceOf) scene.target.faceOf = new Uint16Array(bytes(scene.target.faceOf));
    scene.target.edgeEnds = new Float32Array(bytes(scene.target.edges));
  }
  scene.alternatives = (scene.alternatives || []).map(a => new Uint8Array(bytes(a.codes)));
  if (scene.scale) scene.table = new Uint8Array(bytes(scene.scale.table));
  return scene;
}

function mainView(scene) {
  const box = $("#view3d");
  if (!box) return null;
  const layers = { part: true, edges: true, scan: true, off: true, coded: Boolean(scene.scale), labels: true };
  const view = new View(box, scene, layers);
  view.thin = Math.sqrt(Math.max(1, (scene.onTotal || 1) / Math.max(1, scene.on.count)));
  const kinds = scene.poses, iterations = kinds.filter(p => p.kind === "iteration");
  const slider = $("#iteration"), said = $("#pose-said");
  let colouring = $("input[name=colour]:checked")?.value ?? "plain";

  function show(pose) {
    view.T = pose.T;
    layers.before = pose.kind === "before" || pose.kind === "iteration";
    view.alternative = pose.kind === "alternative" ? kinds.filter(p => p.kind === "alternative").indexOf(pose) : undefined;
    layers.coded = colouring === "deviation" && Boolean(scene.scale) && !layers.before;
    let text = pose.kind === "before" ? pose.name : pose.kind === "after" ? "After registration" : pose.name;
    if (pose.kind === "iteration" && pose.rms) text += `: rms ${length(pose.rms, scene.unit)}`;
    if (pose.kind === "alternative") text += `: score ${length(pose.score, scene.unit)}`;
    said.textContent = text;
    for (const { element } of view.labels) element.hidden = !(layers.labels && pose.kind === "after");
    $("#legend")?.classList.toggle("faded", !layers.coded);
    current = pose;
    view.draw();
  }
  let current = kinds.find(p => p.kind === "after") || kinds.find(p => p.kind === "before") || { T: STAND, kind: "before", name: "As scanned" };

  for (const { at, text, title, kind } of scene.labels) view.label(text, () => at, title, `flag ${kind}`);
  for (const input of all("input[name=pose]")) input.addEventListener("change", () => {
    show(kinds[Number(input.value)]);
    if (slider) slider.value = current.kind === "before" ? 0 : slider.max;
    view.fit();
  });
  for (const input of all("input[name=colour]")) input.addEventListener("change", () => { colouring = input.value; show(current); });
  for (const input of all("input[data-layer]")) input.addEventListener("change", () => {
    layers[input.dataset.layer] = input.checked;
    show(current);
  });
  const byNumber = k => k < iterations.length ? (k === 0 && kinds[0].kind === "before" ? kinds[0] : iterations[k]) : kinds.find(p => p.kind === "after") || kinds[0];
  slider?.addEventListener("input", () => {
    const pose = byNumber(Number(slider.value));
    for (const input of all("input[name=pose]")) input.checked = kinds[Number(input.value)] === pose;
    show(pose);
  });
  $("#play")?.addEventListener("click", () => {
    let k = 0;
    clearInterval(view.timer);
    const step = () => {
      slider.value = k; slider.dispatchEvent(new Event("input"));
      if (k++ >= iterations.length) clearInterval(view.timer);
    };
    if (still.matches) { slider.value = 0; slider.dispatchEvent(new Event("input")); return; }
    view.timer = setInterval(step, Math.max(40, 3000 / iterations.length));
    step();
  });
  for (const button of all("[data-goto]")) button.addEventListener("click", () => {
    view.middle = JSON.parse(button.dataset.goto); view.zoom = 3.2;
    all("input[name=pose]").forEach(i => { i.checked = kinds[Number(i.value)].kind === "after"; });
    show(kinds.find(p => p.kind === "after"));
    pin(view.middle, button.dataset.name);
    box.scrollIntoView({ block: "nearest", behavior: still.matches ? "auto" : "smooth" });
  });
  let pinned;
  function pin(at, name) {
    pinned?.element.remove();
    view.labels = view.labels.filter(l => l !== pinned);
    view.label("", () => at, name, "pin");
    pinned = view.labels.at(-1);
  }

  // The value under the pointer: the nearest drawn point, the one in front if several are.
  const tip = $(".tip", box), cloud = scene.on;
  view.hover = e => {
    if (!cloud.valueSteps || !layers.scan || view.alternative !== undefined || layers.before) { tip.hidden = true; return; }
    const rect = view.canvas.getBoundingClientRect(), x = e.clientX - rect.left, y = e.clientY - rect.top;
    const R = view.axes, m = view.middle, s = view.perSize, cx = rect.width / 2, cy = rect.height / 2;
    const { steps, low, extent, count } = cloud;
    let best = -1, front = -1e9;
    for (let i = 0; i < count; i++) {
      const a = low[0] + extent[0] * steps[3 * i] / 65535 - m[0], b = low[1] + extent[1] * steps[3 * i + 1] / 65535 - m[1], c = low[2] + extent[2] * steps[3 * i + 2] / 65535 - m[2];
      const dx = cx + (R[0][0] * a + R[0][1] * b + R[0][2] * c) * s - x;
      if (dx > 6 || dx < -6) continue;
      const dy = cy - (R[1][0] * a + R[1][1] * b + R[1][2] * c) * s - y;
      const near = dx * dx + dy * dy;
      if (near > 36) continue;
      const depth = R[2][0] * a + R[2][1] * b + R[2][2] * c - 0.002 * near / 36;
      if (depth > front) { front = depth; best = i; }
    }
    tip.hidden = best < 0;
    if (best < 0) return;
    const at = [0, 1, 2].map(k => (low[k] + extent[k] * steps[3 * best + k] / 65535) * scene.size + scene.origin[k]);
    const value = cloud.valueSteps[best] * cloud.step;
    tip.textContent = `${scene.scale.signed && value > 0 ? "+" : ""}${length(value, scene.unit)} at (${at.map(v => Number(v.toPrecision(6))).join(", ")})`;
    tip.style.transform = `translate(${Math.min(x + 12, rect.width - tip.offsetWidth - 4)}px, ${Math.max(y - 30, 2)}px)`;
  };
  view.leave = () => { tip.hidden = true; };
  view.canvas.addEventListener("wheel", view.leave, { passive: true });
  // A click says which face of the part it is on: the number of dqreg faces, as a plan names it.
  view.picked = e => {
    const target = scene.target, rect = view.canvas.getBoundingClientRect();
    if (!target.faceOf || !layers.part) return;
    const R = view.axes, m = view.middle, s = view.perSize;
    const x = (e.clientX - rect.left - rect.width / 2) / s, y = (rect.height / 2 - e.clientY + rect.top) / s;
    const corner = i => {
      const p = [0, 1, 2].map(k => target.low[k] + target.extent[k] * target.steps[3 * i + k] / 65535 - m[k]);
      return R.map(row => row[0] * p[0] + row[1] * p[1] + row[2] * p[2]);
    };
    let face = -1, front = -1e9;
    for (let t = 0; t < target.faceOf.length; t++) {
      const [a, b, c] = [0, 1, 2].map(k => corner(target.faceNumbers[3 * t + k]));
      const whole = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
      const u = ((b[0] - x) * (c[1] - y) - (c[0] - x) * (b[1] - y)) / whole;
      const v = ((c[0] - x) * (a[1] - y) - (a[0] - x) * (c[1] - y)) / whole;
      if (!(u >= 0 && v >= 0 && u + v <= 1)) continue;
      const depth = u * a[2] + v * b[2] + (1 - u - v) * c[2];
      if (depth > front) { front = depth; face = target.faceOf[t]; }
    }
    if (face < 0) return;
    tip.textContent = `face ${face}${tip.hidden ? "" : `: ${tip.textContent}`}`;
    tip.hidden = false;
    tip.style.transform = `translate(${Math.min(e.clientX - rect.left + 12, rect.width - tip.offsetWidth - 4)}px, ${Math.max(e.clientY - rect.top - 30, 2)}px)`;
  };
  show(current);
  view.fit();
  return view;
}

function sureView(scene) {
  const box = $("#sure3d");
  if (!box) return null;
  const view = new View(box, scene, { part: true, edges: true, motions: true });
  view.thin = 1;
  for (const solid of view.solids) if (solid.motion)
    view.label(String(solid.motion.number), () => solid.tip, `motion ${solid.motion.number}`, "motion");
  view.drawNow();
  keepPicture(view);
  return view;
}

// What is printed in the place of the second view: drawn once, in the light colours, with its numbers.
function keepPicture(view) {
  const root = document.documentElement, kept = root.dataset.theme, image = $("#sure-picture");
  root.dataset.theme = "light"; colours.clear();
  view.drawNow();
  const canvas = document.createElement("canvas"), dpr = view.canvas.width / view.canvas.clientWidth;
  canvas.width = view.canvas.width; canvas.height = view.canvas.height;
  const pen = canvas.getContext("2d");
  pen.drawImage(view.canvas, 0, 0);
  pen.font = `bold ${13 * dpr}px sans-serif`; pen.textAlign = "center"; pen.textBaseline = "middle";
  for (const { element, at } of view.labels) {
    const [x, y] = view.toScreen(at()).map(v => v * dpr);
    pen.beginPath(); pen.arc(x, y, 11 * dpr, 0, 7); pen.fillStyle = "#fff"; pen.fill(); pen.strokeStyle = "#565c66"; pen.lineWidth = dpr; pen.stroke();
    pen.fillStyle = "#1a1c20"; pen.fillText(element.textContent, x, y);
  }
  image.src = canvas.toDataURL("image/png");
  if (kept) root.dataset.theme = kept; else delete root.dataset.theme;
  colours.clear();
  view.drawNow();
}

function copyButtons() {
  for (const button of all("[data-copy]")) button.addEventListener("click", async () => {
    const source = $("#" + button.dataset.copy), text = source.textContent;
    let done = false;
    try { await navigator.clipboard.writeText(text); done = true; } catch { /* asked without permission, or from a mail */ }
    if (!done) {
      const range = document.createRange();
      range.selectNodeContents(source);
      const chosen = getSelection();
      chosen.removeAllRanges(); chosen.addRange(range);
      try { done = document.execCommand("copy"); } catch { done = false; }
    }
    button.textContent = done ? "Copied" : "Selected: press Ctrl+C";
    setTimeout(() => { button.textContent = "Copy"; }, 1800);
  });
}

function theme(views) {
  const root = document.documentElement, button = $("#theme"), dark = matchMedia("(prefers-color-scheme: dark)");
  const redraw = () => { colours.clear(); views.forEach(v => v.drawNow()); };
  const isDark = () => (root.dataset.theme || (dark.matches ? "dark" : "light")) === "dark";
  const say = () => { button.textContent = isDark() ? "Light" : "Dark"; };
  button.addEventListener("click", () => { root.dataset.theme = isDark() ? "light" : "dark"; say(); redraw(); });
  dark.addEventListener("change", () => { say(); redraw(); });
  let kept;
  addEventListener("beforeprint", () => {
    kept = root.dataset.theme; root.dataset.theme = "light"; redraw();
    for (const d of all("details")) { d.dataset.was = d.open; d.open = true; }
  });
  addEventListener("afterprint", () => {
    if (kept) root.dataset.theme = kept; else delete root.dataset.theme;
    redraw();
    for (const d of all("details")) d.open = d.dataset.was === "true";
  });
  $("#print")?.addEventListener("click", () => print());
  say();
}

const views = [];
try {
  const scene = readScene();
  if (scene) for (const made of [mainView(scene), sureView(scene)]) if (made) views.push(made);
} catch (error) {
  // No WebGL: the pictures that are meant for print are shown in its place, and the page says so.
  document.documentElement.classList.add("flat");
  const said = $("#flat-said");
  if (said) said.textContent = `The interactive view cannot start here (${error.message}); the pictures show the same.`;
}
copyButtons();
theme(views);
})();
