// Elements, formatting of numbers, debouncing.

/** An element with attributes and children; `on...` attributes are listeners. */
export function el(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) {
      element.addEventListener(key.slice(2), value);
    } else if (key in element && key !== "list" && typeof value !== "string") {
      element[key] = value;
    } else if (value !== false && value !== null && value !== undefined) {
      element.setAttribute(key, value === true ? "" : value);
    }
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return element;
}

/** A number with the given significant digits; a dash for a missing one. */
export function num(value, digits = 3) {
  if (value === null || value === undefined || Number.isNaN(value)) {
    return "\u2013";
  }
  if (value === 0 || (Math.abs(value) >= 1e-3 && Math.abs(value) < 1e6)) {
    const fixed = Math.max(0, digits - 1 - Math.floor(Math.log10(Math.abs(value) || 1)));
    return Number(value.toFixed(Math.min(fixed, 6))).toLocaleString("en", { maximumFractionDigits: 6 });
  }
  return value.toExponential(digits - 1);
}

/** The last part of a path, to save space. */
export function lastPart(path) {
  return path.split(/[\\/]/).filter(Boolean).pop() ?? path;
}

/** A unit as it is written, where tables say `um`. */
export function unitText(unit) {
  return unit.replace(/\bum/g, "\u00b5m");
}

/** A duration in words. */
export function duration(s) {
  if (s === null || s === undefined) {
    return "\u2013";
  }
  return s < 1 ? `${num(1000 * s, 2)} ms` : s < 90 ? `${num(s, 2)} s` : s < 5400 ? `${num(s / 60, 2)} min` : `${num(s / 3600, 2)} h`;
}

/** A size in words. */
export function byteSize(bytes) {
  return bytes < 1e6 ? `${num(bytes / 1e3, 2)} kB` : bytes < 1e9 ? `${num(bytes / 1e6, 3)} MB` : `${num(bytes / 1e9, 3)} GB`;
}

/** Calls a function once input has paused for some milliseconds. */
export function afterRest(ms, run) {
  let timer = 0;
  return (...given) => {
    clearTimeout(timer);
    timer = setTimeout(() => run(...given), ms);
  };
}

/** A labeled control. */
export function field(label, control, hint) {
  return el("label", { class: "field", title: hint ?? null }, el("span", {}, label), control);
}

/** A check box; `changed` is called with its state. */
export function check(label, checked, changed, hint) {
  const box = el("input", { type: "checkbox", checked, onchange: () => changed(box.checked) });
  return el("label", { class: "check", title: hint ?? null }, box, el("span", {}, label));
}

/** A choice among [value, text] pairs. */
export function choice(options, value, changed, name) {
  const select = el("select", { "aria-label": name ?? null, onchange: () => changed(select.value) });
  select.append(...options.map(([own, text]) => el("option", { value: String(own) }, text)));
  select.value = String(value);
  return select;
}

let hasLastWord = false;

/** Shows a message in the corner of the page and to screen readers; no message follows one with `isLast`. */
export function say(text, isWrong = false, isLast = false) {
  if (hasLastWord) {
    return;
  }
  hasLastWord = isLast;
  const banner = document.getElementById("banner");
  banner.textContent = text;
  banner.hidden = !text;
  banner.classList.toggle("wrong", isWrong);
}
