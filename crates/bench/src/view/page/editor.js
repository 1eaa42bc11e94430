// The scenario editor: colors, messages at their lines, completion, help for the key at the cursor.

import { getJson } from "./api.js";
import { el } from "./dom.js";
import { expectedAt, pathAt, walk } from "./ron.js";

const known = new Map();

/** Information on a key, from the program. */
function keyInfo(path) {
  if (!known.has(path)) {
    known.set(path, getJson(path ? `keys/${encodeURIComponent(path)}` : "keys").catch(() => null));
  }
  return known.get(path);
}

/** Help for a key: unit, range, default, meaning. */
function help(info) {
  const facts = [
    info.kind && `${info.kind}${info.unit ? `, ${info.unit}` : ""}`,
    info.range && `range ${info.range}`,
    info.default && `default ${info.default}`,
  ].filter(Boolean);
  return [
    el("b", {}, info.path ?? info.name),
    facts.length ? el("span", { class: "facts" }, facts.join(" \u00b7 ")) : null,
    el("span", { class: "meaning" }, info.meaning || ""),
  ];
}

/** The editor; `changed` is called with the text after every change. */
export class Editor {
  constructor(changed) {
    this.changed = changed;
    this.problems = [];
    this.area = el("textarea", {
      class: "code",
      spellcheck: "false",
      autocapitalize: "off",
      autocomplete: "off",
      wrap: "off",
      "aria-label": "Scenario. Ctrl+Space completes; the line below explains the key at the cursor.",
      "aria-describedby": "key-help",
    });
    this.shown = el("pre", { class: "code shown", "aria-hidden": "true" });
    this.gutter = el("div", { class: "gutter", "aria-hidden": "true" });
    this.list = el("ul", { class: "completions", role: "listbox", "aria-label": "Completions", hidden: true });
    this.tip = el("div", { class: "tip", hidden: true });
    this.help = el("div", { class: "help", id: "key-help", role: "status" });
    this.wrong = el("ol", { class: "problems", "aria-label": "Problems" });
    this.sheet = el("div", { class: "sheet" }, this.gutter, el("div", { class: "page" }, this.shown, this.area), this.list, this.tip);
    this.element = el("div", { class: "editor" }, this.sheet, this.wrong, this.help);
    this.choices = [];
    this.listen();
  }

  get text() {
    return this.area.value;
  }

  set text(text) {
    this.area.value = text;
    this.problems = [];
    this.paint();
    this.changed(text);
  }

  /** Shows messages at their lines. */
  showProblems(problems) {
    this.problems = problems;
    this.paint();
    const jump = (problem) => () => {
      if (problem.from !== null && problem.from !== undefined) {
        this.area.focus();
        this.area.setSelectionRange(problem.from, problem.to);
        this.reveal(problem.from);
      }
    };
    this.wrong.replaceChildren(
      ...problems.map((problem) =>
        el(
          "li",
          {},
          el("button", { type: "button", onclick: jump(problem) }, problem.line ? el("b", {}, `line ${problem.line}`) : null, ` ${problem.message}`),
        ),
      ),
    );
  }

  reveal(at) {
    const line = this.text.slice(0, at).split("\n").length - 1;
    const { lineHeight } = this.metrics();
    if (line * lineHeight < this.area.scrollTop || line * lineHeight > this.area.scrollTop + this.area.clientHeight - 40) {
      this.area.scrollTop = Math.max(0, line * lineHeight - this.area.clientHeight / 2);
    }
  }

  metrics() {
    if (!this.measured) {
      const style = getComputedStyle(this.area);
      const context = document.createElement("canvas").getContext("2d");
      context.font = `${style.fontSize} ${style.fontFamily}`;
      this.measured = {
        width: context.measureText("0".repeat(100)).width / 100,
        lineHeight: parseFloat(style.lineHeight),
        padding: parseFloat(style.paddingLeft),
        top: parseFloat(style.paddingTop),
      };
    }
    return this.measured;
  }

  paint() {
    const text = this.text;
    const marks = this.problems.filter((problem) => Number.isInteger(problem.from) && problem.to <= text.length);
    const isWrong = (from, to) => marks.some((mark) => mark.from < to && from < Math.max(mark.to, mark.from + 1));
    const { named } = walk(text);
    const parts = [];
    let at = 0;
    const add = (to, kind) => {
      if (to > at) {
        const piece = text.slice(at, to);
        const wrong = isWrong(at, to) && piece.trim() !== "";
        parts.push(kind || wrong ? el("span", { class: `${kind ?? ""}${wrong ? " wrong" : ""}` }, piece) : piece);
        at = to;
      }
    };
    const comments = [...text.matchAll(/"(?:\\.|[^"\\])*"|(\/\/[^\n]*|\/\*[\s\S]*?\*\/)/g)].filter((match) => match[1]);
    const colored = [
      ...named.map((piece) => [piece.from, piece.to, piece.isKey ? "key" : piece.kind === "word" ? "variant" : piece.kind]),
      ...comments.map((match) => [match.index, match.index + match[0].length, "comment"]),
    ].sort((a, b) => a[0] - b[0]);
    for (const [from, to, kind] of colored) {
      add(from, null);
      add(to, kind);
    }
    add(text.length, null);
    this.shown.replaceChildren(...parts, "\n");
    const lines = text.split("\n").length;
    const wrongLines = new Map(this.problems.filter((p) => p.line).map((p) => [p.line, p.message]));
    this.gutter.replaceChildren(
      ...Array.from({ length: lines }, (_, k) =>
        el("div", { class: wrongLines.has(k + 1) ? "wrong" : null, title: wrongLines.get(k + 1) ?? null }, String(k + 1)),
      ),
    );
    this.follow();
  }

  follow() {
    this.shown.scrollTop = this.area.scrollTop;
    this.shown.scrollLeft = this.area.scrollLeft;
    this.gutter.scrollTop = this.area.scrollTop;
  }

  listen() {
    this.area.addEventListener("input", () => {
      // Positions of problems are no longer valid; the next response has the new ones.
      this.problems = [];
      this.paint();
      this.changed(this.text);
      this.complete(false);
    });
    this.area.addEventListener("scroll", () => {
      this.follow();
      this.close();
      this.tip.hidden = true;
    });
    this.area.addEventListener("keydown", (event) => this.pressed(event));
    this.area.addEventListener("blur", () => setTimeout(() => this.close(), 150));
    for (const name of ["keyup", "click"]) {
      this.area.addEventListener(name, () => this.explain());
    }
    this.area.addEventListener("mousemove", (event) => this.hover(event));
    this.area.addEventListener("mouseleave", () => (this.tip.hidden = true));
  }

  pressed(event) {
    if (event.key === " " && event.ctrlKey) {
      event.preventDefault();
      this.complete(true);
    } else if (!this.list.hidden && (event.key === "ArrowDown" || event.key === "ArrowUp")) {
      event.preventDefault();
      this.pick((this.picked + (event.key === "ArrowDown" ? 1 : this.choices.length - 1)) % this.choices.length);
    } else if (!this.list.hidden && (event.key === "Enter" || event.key === "Tab")) {
      event.preventDefault();
      this.accept(this.choices[this.picked]);
    } else if (event.key === "Escape") {
      this.close();
    } else if (event.key === "Enter") {
      event.preventDefault();
      const before = this.text.slice(0, this.area.selectionStart);
      const indent = /(^|\n)([ \t]*)[^\n]*$/.exec(before)[2];
      const deeper = /[([{]\s*$/.test(before);
      const closes = /^\s*[)\]}]/.test(this.text.slice(this.area.selectionEnd));
      this.insert(`\n${indent}${deeper ? "    " : ""}`, deeper && closes ? `\n${indent}` : "");
    }
  }

  /** Inserts `before` at the cursor and `after` behind it. */
  insert(before, after = "") {
    const { selectionStart, selectionEnd } = this.area;
    this.area.setRangeText(before + after, selectionStart, selectionEnd, "end");
    const at = selectionStart + before.length;
    this.area.setSelectionRange(at, at);
    this.area.dispatchEvent(new Event("input"));
  }

  async complete(isAsked) {
    const expected = expectedAt(this.text, this.area.selectionStart);
    if (!expected || (!isAsked && expected.start.length < 1)) {
      return this.close();
    }
    const text = this.text;
    const info = await keyInfo(expected.path);
    if (text !== this.text || !info) {
      return this.close();
    }
    const flags = info.kind === "true or false" ? ["true", "false"].map((name) => ({ name, insert: name, meaning: "" })) : [];
    const starts = (entry) => entry.name.startsWith(expected.start);
    this.choices = [...info.below, ...flags]
      .filter((entry) => (expected.isValue ? entry.is_variant !== false : !entry.is_variant))
      .filter((entry) => !expected.keys.includes(entry.name) || entry.name === expected.start)
      .filter((entry) => starts(entry) && (isAsked || entry.name !== expected.start))
      .slice(0, 60);
    if (!this.choices.length) {
      return this.close();
    }
    this.from = expected.from;
    this.list.replaceChildren(
      ...this.choices.map((entry, k) =>
        el(
          "li",
          { role: "option", onmousedown: (event) => (event.preventDefault(), this.accept(entry)), onmouseenter: () => this.pick(k) },
          el("span", { class: "name" }, entry.name),
          entry.is_required ? el("span", { class: "needed" }, "required") : null,
          el("span", { class: "meaning" }, [entry.unit, entry.meaning].filter(Boolean).join(" \u00b7 ")),
        ),
      ),
    );
    const [x, y] = this.positionOf(this.from);
    this.list.hidden = false;
    const below = this.sheet.clientHeight - y;
    this.list.style.left = `${Math.min(x, this.sheet.clientWidth - this.list.offsetWidth - 8)}px`;
    this.list.style.top = below > 140 ? `${y + this.metrics().lineHeight}px` : `${Math.max(0, y - this.list.offsetHeight)}px`;
    this.pick(0);
  }

  /** Position of a character in the sheet, px. */
  positionOf(at) {
    const before = this.text.slice(0, at);
    const column = at - (before.lastIndexOf("\n") + 1);
    const line = before.split("\n").length - 1;
    const { width, lineHeight, padding, top } = this.metrics();
    return [
      this.gutter.offsetWidth + padding + column * width - this.area.scrollLeft,
      top + line * lineHeight - this.area.scrollTop,
    ];
  }

  pick(k) {
    this.picked = k;
    [...this.list.children].forEach((item, i) => item.setAttribute("aria-selected", String(i === k)));
    this.list.children[k]?.scrollIntoView({ block: "nearest" });
    const entry = this.choices[k];
    if (entry) {
      this.help.replaceChildren(...help(entry).filter(Boolean));
    }
  }

  accept(entry) {
    this.close();
    const text = entry.insert ?? entry.name;
    const cursor = text.indexOf("|");
    const follows = this.text.slice(this.area.selectionStart);
    const isFollowed = /^\s*[:(]/.test(follows);
    const written = isFollowed ? entry.name : text.replace("|", "");
    this.area.setSelectionRange(this.from, this.area.selectionStart);
    this.insert(isFollowed || cursor < 0 ? written : text.slice(0, cursor), isFollowed || cursor < 0 ? "" : text.slice(cursor + 1));
    this.close();
  }

  close() {
    this.list.hidden = true;
    this.choices = [];
  }

  async explain() {
    const at = pathAt(this.text, this.area.selectionStart);
    if (!this.list.hidden) {
      return;
    }
    const info = at && (await keyInfo(at.path));
    this.help.replaceChildren(
      ...(info && info.path ? help(info).filter(Boolean) : [el("span", { class: "meaning" }, "Ctrl+Space completes; the key at the cursor is explained here.")]),
    );
  }

  async hover(event) {
    const { width, lineHeight, padding, top } = this.metrics();
    const box = this.area.getBoundingClientRect();
    const column = Math.floor((event.clientX - box.left - padding + this.area.scrollLeft) / width);
    const line = Math.floor((event.clientY - box.top - top + this.area.scrollTop) / lineHeight);
    const lines = this.text.split("\n");
    if (line < 0 || line >= lines.length || column < 0 || column >= lines[line].length) {
      this.tip.hidden = true;
      return;
    }
    const at = lines.slice(0, line).reduce((sum, own) => sum + own.length + 1, 0) + column;
    const wrong = this.problems.find((problem) => problem.from <= at && at < Math.max(problem.to, problem.from + 1));
    const found = pathAt(this.text, at);
    const key = `${found?.path}/${wrong?.message}`;
    if (this.hovered === key && !this.tip.hidden) {
      return;
    }
    this.hovered = key;
    const info = found && (await keyInfo(found.path));
    if (this.hovered !== key || (!wrong && !info?.path)) {
      this.tip.hidden = true;
      return;
    }
    this.tip.replaceChildren(
      ...[wrong ? el("span", { class: "wrong" }, wrong.message) : null, ...(info?.path ? help(info) : [])].filter(Boolean),
    );
    this.tip.hidden = false;
    const [x, y] = this.positionOf(found?.from ?? at);
    this.tip.style.left = `${Math.max(4, Math.min(x, this.sheet.clientWidth - this.tip.offsetWidth - 8))}px`;
    const under = y + lineHeight + 4;
    this.tip.style.top = `${under + this.tip.offsetHeight < this.sheet.clientHeight ? under : y - this.tip.offsetHeight - 4}px`;
  }
}
