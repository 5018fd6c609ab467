// Sections in the step Judge: a plane through a place that is clicked, and what part and scan are along it.
import { h, number, percent } from "./dom.js";

const AXES = ["x", "y", "z"];

export function tools(app, stage, state) {
  return AXES.map((name, k) => h("button", { id: `cut-${name}`, "aria-pressed": String(state.cutting === k), "aria-label": `Section across ${name}`, onclick: () => {
    state.cutting = state.cutting === k ? undefined : k;
    state.labelling = false;
    stage.box.classList.toggle("aim", state.cutting !== undefined);
    app.render();
  } }, `Section ⊥ ${name}`));
}

// The plane through a place, across the axis that was chosen.
export function through(app, point) {
  const axis = app.step_state.judge.cutting;
  return { sections: [...app.visit.sections, { point, normal: AXES.map((_, k) => k === axis ? 1 : 0) }] };
}

export function panel(app, found, state, choose) {
  const { sections } = app.visit, unit = app.unit(), busy = Boolean(app.busy.task);
  const change = (k, each) => choose({ sections: each ? sections.map((old, i) => i === k ? each : old) : sections.filter((_, i) => i !== k) });
  return [
    state.cutting !== undefined && h("p", { class: "note" }, `Click the part where it should be cut across ${AXES[state.cutting]}.`),
    sections.length ? h("section", { id: "sections" }, h("h3", {}, "Sections"), sections.map((each, k) => {
      const axis = each.normal.findIndex(x => x !== 0), cut = found.sections?.find(each => each.name === `section ${k + 1}`);
      const set = e => {
        const value = Number(e.target.value.replace(",", ".").replace("−", "-"));
        if (Number.isFinite(value)) change(k, { ...each, point: each.point.map((x, i) => i === axis ? value : x) });
      };
      return h("figure", { class: "section" }, h("figcaption", { class: "row" }, h("label", { for: `section-${k}` }, `${k + 1}: ${AXES[axis]} =`),
        h("input", { id: `section-${k}`, class: "short", inputmode: "decimal", value: number(each.point[axis], 5), autocomplete: "off", onchange: set }), ` ${unit}`,
        h("button", { id: `unsection-${k}`, disabled: busy, "aria-label": `Remove section ${k + 1}`, onclick: () => change(k, null) }, "Remove")),
        cut && h("img", { src: `data:image/svg+xml;charset=utf-8,${encodeURIComponent(cut.picture)}`, alt: `Outline of section ${k + 1} with the deviations along it; ${percent(cut.coverage, 0)} of it was scanned` }));
    })) : null,
  ];
}
