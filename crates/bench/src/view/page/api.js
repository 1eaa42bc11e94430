// Requests to the server; an exported page contains the responses.

const exported = window.MICROSIG_EXPORT;

/** Whether this page is an exported file, which runs without the program. */
export const isExport = Boolean(exported);

const home = new URL("./", location.href);

/** A response as JSON; null if it does not exist. Throws the error that the program reports. */
export async function getJson(path, signal) {
  if (exported) {
    return exported[path] ?? exportedList(path);
  }
  const answer = await fetch(new URL(path, home), { signal });
  if (answer.status === 404) {
    return null;
  }
  if (!answer.ok) {
    const body = await answer.json().catch(() => ({}));
    throw new Error(body.error ?? `the program refused ${path} (${answer.status})`);
  }
  return answer.json();
}

/** The counts of a frame. */
export async function getCounts(path, signal) {
  if (exported) {
    const bytes = Uint8Array.from(atob(exported[path].base64), (c) => c.charCodeAt(0));
    return new Uint16Array(bytes.buffer);
  }
  const answer = await fetch(new URL(path, home), { signal });
  if (!answer.ok) {
    const body = await answer.json().catch(() => ({}));
    throw new Error(body.error ?? `the program refused ${path} (${answer.status})`);
  }
  return new Uint16Array(await answer.arrayBuffer());
}

/** Writes the scenario's file. */
export async function saveScenario(text) {
  const answer = await fetch(new URL("scenario", home), { method: "POST", body: text });
  const body = await answer.json().catch(() => ({}));
  if (!answer.ok) {
    throw new Error(body.error ?? `not saved (${answer.status})`);
  }
  return body;
}

/** The parts of a preview as they arrive: JSON and bytes. */
export async function* previewParts(text, signal) {
  const answer = await fetch(new URL("preview", home), { method: "POST", body: text, signal });
  if (!answer.ok) {
    throw new Error(answer.status === 413 ? "the scenario is longer than 1 MB" : `no preview (${answer.status})`);
  }
  const reader = answer.body.getReader();
  let pieces = [];
  let held = 0;
  const take = async (n) => {
    while (held < n) {
      const { done, value } = await reader.read();
      if (done) {
        return null;
      }
      pieces.push(value);
      held += value.length;
    }
    const all = new Uint8Array(held);
    let at = 0;
    for (const piece of pieces) {
      all.set(piece, at);
      at += piece.length;
    }
    pieces = [all.subarray(n)];
    held -= n;
    return all.slice(0, n);
  };
  for (;;) {
    const head = await take(8);
    if (!head) {
      return;
    }
    const lengths = new DataView(head.buffer);
    const json = await take(lengths.getUint32(0, true));
    const block = await take(lengths.getUint32(4, true));
    if (!json || !block) {
      return;
    }
    yield [JSON.parse(new TextDecoder().decode(json)), block.buffer];
  }
}

/** Keeps the program informed that the page is open; calls `ended` when the program has ended. */
export async function keepAlive(ended) {
  if (exported) {
    return;
  }
  try {
    const answer = await fetch(new URL("alive", home));
    const reader = answer.body.getReader();
    while (!(await reader.read()).done);
  } catch {
    // A broken connection counts as ended.
  }
  ended();
}

/** In an exported page, lists of the worst points are computed here, from the exported frames. */
function exportedList(path) {
  const asked = /^dataset\/0\/result\/(\d+)\/worst\?(.*)$/.exec(path);
  if (!asked) {
    return null;
  }
  const query = new URLSearchParams(asked[2]);
  const range = (name) => {
    const [low, high] = (query.get(name) ?? ",").split(",");
    return [low === "" ? -Infinity : Number(low), high === "" ? Infinity : Number(high)];
  };
  const rows = [];
  for (const frame of exported["dataset/0"].exported_frames) {
    const points = exported[`dataset/0/result/${asked[1]}/frame/${frame}`];
    points.kind.forEach((_, i) => rows.push(Object.fromEntries(Object.keys(points).map((k) => [k, points[k][i]]))));
  }
  const within = (value, [low, high]) =>
    value === null ? low === -Infinity && high === Infinity : value >= low && value <= high;
  const by = { 0: (p) => Math.hypot(p.dx_px, p.dy_px), 1: (p) => Math.abs(p.dz_um), 2: (p) => -p.frame }[query.get("by") ?? 0];
  // Missed particles, then ghosts, then found ones by their errors.
  const rank = (p) => (query.get("by") === "2" ? 0 : [0, 2, 1][p.kind]);
  const size = (p) => (p.kind === 0 || query.get("by") === "2" ? by(p) : -Infinity);
  const kept = rows.filter(
    (p) =>
      (!query.has("kind") || p.kind === Number(query.get("kind"))) &&
      (query.get("switches") !== "1" || p.is_switch) &&
      within(p.z_um, range("z")) &&
      within(p.snr, range("snr")) &&
      within(p.overlap, range("overlap")),
  );
  kept.sort((a, b) => rank(b) - rank(a) || size(b) - size(a) || 0);
  const columns = {};
  for (const name of Object.keys(kept[0] ?? {})) {
    columns[name] = kept.slice(0, 500).map((p) => p[name]);
  }
  return { of: kept.length, columns };
}
