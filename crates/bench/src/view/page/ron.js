// Analysis of a scenario's text for the editor: kinds of words, and positions of keys.

const word = /[A-Za-z_][A-Za-z0-9_.+-]*|[-+]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][-+]?\d+)?/y;

/** Tokens of a text: { kind, from, to }, separated by white space. */
export function pieces(text) {
  const found = [];
  let at = 0;
  const until = (end) => {
    const place = text.indexOf(end, at + 2);
    return place < 0 ? text.length : place + end.length;
  };
  while (at < text.length) {
    const from = at;
    const two = text.slice(at, at + 2);
    if (/\s/.test(text[at])) {
      at++;
      continue;
    }
    let kind = "mark";
    if (two === "//") {
      kind = "comment";
      const end = text.indexOf("\n", at);
      at = end < 0 ? text.length : end;
    } else if (two === "/*") {
      kind = "comment";
      at = until("*/");
    } else if (text[at] === '"') {
      kind = "text";
      at++;
      while (at < text.length && text[at] !== '"') {
        at += text[at] === "\\" ? 2 : 1;
      }
      at = Math.min(at + 1, text.length);
    } else {
      word.lastIndex = at;
      const match = word.exec(text);
      if (match) {
        kind = /^[A-Za-z_]/.test(match[0]) ? "word" : "number";
        at += match[0].length;
      } else {
        at++;
      }
    }
    found.push({ kind, from, to: at });
  }
  return found;
}

/**
 * Walks through a text; returns the tokens with the path that each names or belongs to, and the open brackets
 * at the end.
 */
export function walk(text, end = text.length) {
  const all = pieces(text.slice(0, end));
  const named = [];
  const open = [];
  const top = () => open[open.length - 1];
  // Path of the next value.
  const place = () => {
    const bracket = top();
    if (!bracket) {
      return [];
    }
    if (bracket.key !== null) {
      return [...bracket.path, bracket.key];
    }
    return bracket.kind === "[" ? [...bracket.path, String(bracket.index)] : bracket.path;
  };
  let variant = null;
  all.forEach((piece, k) => {
    const own = text.slice(piece.from, piece.to);
    if (piece.kind === "comment") {
      return;
    }
    if (piece.kind === "mark") {
      if ("([{".includes(own)) {
        open.push({ kind: own, path: variant ?? place(), key: null, index: 0, keys: [], isAfterColon: false });
      } else if (")]}".includes(own)) {
        open.pop();
      } else if (own === "," && top()) {
        top().index++;
        top().key = null;
        top().isAfterColon = false;
      } else if (own === ":" && top()) {
        top().isAfterColon = true;
      }
      variant = null;
      return;
    }
    const next = all.slice(k + 1).find((other) => other.kind !== "comment");
    const follows = next ? text[next.from] : "";
    const name = piece.kind === "text" ? own.slice(1, -1) : own;
    variant = null;
    if (follows === ":" && top() && !top().isAfterColon) {
      top().key = name;
      top().keys.push(name);
      named.push({ ...piece, path: [...top().path, name], isKey: true });
    } else if (piece.kind === "word" || (piece.kind === "text" && top()?.kind === "[")) {
      const path = [...place(), name];
      variant = follows === "(" ? path : null;
      named.push({ ...piece, path, isKey: false });
    } else {
      named.push({ ...piece, path: place(), isKey: false, isValue: true });
    }
  });
  return { named, open, place: place() };
}

/** The path of the key, variant or value at a position in the text. */
export function pathAt(text, at) {
  const found = walk(text).named.find((piece) => piece.from <= at && at <= piece.to);
  return found ? { path: found.path.join("."), from: found.from, to: found.to, isKey: found.isKey } : null;
}

/**
 * What is expected at a position: the path whose keys or variants fit, the start of the word, the existing
 * keys.
 */
export function expectedAt(text, at) {
  const start = /[A-Za-z0-9_]*$/.exec(text.slice(0, at))[0];
  const from = at - start.length;
  const inside = pieces(text.slice(0, at)).pop();
  const isOver = inside && (inside.kind === "comment" || inside.kind === "text") && inside.to === at;
  if (isOver && !(inside.kind === "text" && text[at - 1] === '"' && inside.to - inside.from > 1)) {
    return null;
  }
  const { open, place } = walk(text, from);
  const bracket = open[open.length - 1];
  if (!bracket) {
    return null;
  }
  const isValue = bracket.isAfterColon || bracket.kind === "[";
  // Includes keys after the cursor.
  const rest = walk(text).named.filter((piece) => piece.isKey).map((piece) => piece.path.join("."));
  const prefix = bracket.path.join(".");
  const keys = rest.filter((path) => path.startsWith(prefix ? `${prefix}.` : "")).map((path) => path.slice(prefix ? prefix.length + 1 : 0));
  const path = (isValue ? place : bracket.path).join(".");
  return { path, isValue, from, start, keys: isValue ? [] : keys.filter((key) => !key.includes(".")) };
}
