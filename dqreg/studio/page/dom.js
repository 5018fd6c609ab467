// Elements are made from values, never from text: no name of a file can become anything else than letters.
export function h(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (key === "class") made.className = value;
    else if (typeof value === "boolean") made.toggleAttribute(key, value);
    else if (value !== null && value !== undefined) made.setAttribute(key, value);
  }
  made.append(...children.flat(Infinity).filter(child => child !== null && child !== undefined && child !== false));
  return made;
}

// The same panel again keeps the keyboard where it was, and what was typed but not yet taken.
export function show(home, ...children) {
  const held = home.contains(document.activeElement) ? document.activeElement : null;
  const id = held?.id, at = held?.selectionStart;
  const typed = new Map([...home.querySelectorAll("input[id]")].filter(i => i.value !== i.defaultValue && !["radio", "checkbox", "range", "file"].includes(i.type)).map(i => [i.id, i]));
  const open = new Set([...home.querySelectorAll("details[open]")].map(d => d.id).filter(Boolean));
  home.replaceChildren(...children.flat(Infinity).filter(child => child !== null && child !== undefined && child !== false));
  for (const each of home.querySelectorAll("details[id]")) if (open.has(each.id)) each.open = true;
  for (const [name, old] of typed) {
    const fresh = home.querySelector(`#${CSS.escape(name)}`);
    if (fresh && fresh.defaultValue === old.defaultValue) fresh.value = old.value;
  }
  const again = id ? document.getElementById(id) : null;
  if (again) {
    again.focus({ preventScroll: true });
    try { if (at !== undefined && at !== null) again.setSelectionRange(at, at); } catch { /* a number has no selection */ }
  } else if (held) home.focus({ preventScroll: true });
}

export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const short = Number(value.toPrecision(digits));
  return Math.abs(short) >= 1e6 || (short !== 0 && Math.abs(short) < 1e-4) ? short.toExponential(digits - 1) : String(short);
}
export const count = value => value.toLocaleString("en-GB");
export const signed = (value, digits = 3) => (value > 0 ? "+" : "") + number(value, digits).replace("-", "−");
export const percent = (share, digits = 1) => `${Number((100 * share).toFixed(digits))}\u00a0%`;
export function facts(rows) {
  return h("table", { class: "facts" }, h("tbody", {}, rows.filter(Boolean).map(([name, ...value]) => h("tr", {}, h("th", { scope: "row" }, name), h("td", {}, value)))));
}
export function copyable(name, text) {
  const button = h("button", { class: "copy" }, "Copy");
  const pre = h("pre", { tabindex: "0" }, text);
  button.addEventListener("click", async () => {
    try { await navigator.clipboard.writeText(text); } catch {
      const range = document.createRange(); range.selectNodeContents(pre);
      const chosen = getSelection(); chosen.removeAllRanges(); chosen.addRange(range);
      document.execCommand("copy");
    }
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  });
  return h("div", { class: "copyable" }, h("div", {}, h("span", { class: "note" }, name), button), pre);
}
// A tolerance as it is written: 0.1 for both sides, +0.1/-0.05 for two; null where nothing is, undefined where it is neither.
export function sides(text) {
  const words = text.trim().replace(/,/g, ".").replace(/[−–]/g, "-").replace(/^±/, "");
  if (!words) return null;
  const found = /^\+?([\d.]+(?:e-?\d+)?)(?:\s*\/\s*-?([\d.]+(?:e-?\d+)?))?$/i.exec(words);
  const [plus, minus] = found ? [Number(found[1]), found[2] === undefined ? null : Number(found[2])] : [NaN, null];
  if (!(plus >= 0) || (minus !== null && !(minus >= 0)) || !(plus + (minus ?? 0) > 0)) return undefined;
  return { plus, minus };
}
export const sidesText = (plus, minus) => plus === null || plus === undefined ? "" : minus === null || minus === undefined ? String(plus) : `+${plus}/-${minus}`;
// A length with its unit, on one line; a unit that is not known is left out.
export const long = (value, unit, digits = 3) => unit ? `${number(value, digits)}\u00a0${unit}` : number(value, digits);
export const off = (value, unit, digits = 3) => unit ? `${signed(value, digits)}\u00a0${unit}` : signed(value, digits);
