// Which points belong to the part: seen on it in colours, with the length that decides and where that comes from.
import { count, h, long, number, percent } from "./dom.js";
import { KIND_COLOURS, STAND } from "./stage.js";

// What a point belongs to, in the order of the server's numbers: how it is counted, and in words.
const KINDS = [["on_part", "on the part"], ["beyond_reach", "farther off: something else"], ["other_surfaces", "on a surface that leaves the part"], ["outliers", "single outliers"], ["excluded", "excluded"]];

// Where the length comes from.
const FROM = {
  given: share => `${share} of the part's diagonal, as you wrote. Leave it empty to have it from the data.`,
  size: share => `${share} of the part's diagonal.`,
  noise: () => "six times the noise of the scan: no point that counts lies farther off.",
  spacing: () => "one spacing of the scan: no point that counts lies farther off.",
  deviations: () => "the largest deviation of the part that is found in the scan.",
};

export async function show(app, stage) {
  if (!app.results.reach) {
    await app.run("reach", {}, "Looking which points belong to the part");
    app.renewed("reach");
  }
  app.showKinds = true;
  await app.draw();
  Object.assign(stage.layers, { part: true, scan: true, off: false, before: false });
  stage.clearLabels();
  stage.mark({});
  stage.move(STAND);
  app.render();
}

export function panel(app, stage) {
  const found = app.results.reach, unit = app.unit(), busy = Boolean(app.busy.task);
  if (!found) return null;
  const set = async text => {
    const value = text.trim() ? Number(text.replace(",", ".")) : null;
    if (value !== null && !(value > 0)) { app.say("The reach is a length above 0; leave it empty to have it from the data."); return; }
    app.say("");
    await app.change({ reach: value });
    await show(app, stage);
  };
  return h("div", { class: "card", id: "reach-panel" },
    h("div", { class: "row" }, h("label", { for: "reach-of" }, "Reach"), h("input", { id: "reach-of", class: "short", inputmode: "decimal", autocomplete: "off", disabled: busy, value: app.visit.reach ?? "", placeholder: number(found.reach), onchange: e => set(e.target.value) }), unit),
    h("p", { id: "reach-said", class: "note" }, `${long(found.reach, unit)}, ${FROM[found.from](percent(found.share, 1))}${found.from === "given" ? "" : " Another length can be written here."}`),
    h("ul", { class: "kinds" }, KINDS.map(([key, words], k) => {
      if (!found.counts[key]) return null;
      const spot = h("i", { "aria-hidden": "true" });
      spot.style.background = `var(${KIND_COLOURS[k]})`;
      return h("li", {}, spot, `${count(found.counts[key])} ${words}`);
    })));
}
