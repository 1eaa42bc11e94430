// `microsig view` in a real browser.

import assert from "node:assert/strict";
import { existsSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { pathToFileURL } from "node:url";
import { PNG } from "pngjs";
import { closeBrowser, folder, generate, look, microsig, serve } from "./harness.mjs";

const place = folder();

/**
 * Gaussian particle images of known places, no noise: their centroids can be measured to a hundredth of a
 * pixel.
 */
const GAUSSIAN = `(
    name: "gaussian", seed: 3,
    optics: (gaussian: (diameter_px: 4, peak_counts: 3000), pixel_dim_x: 200, pixel_dim_y: 140, background_mean: 100, background_noise: 0),
    motion: flow(field: poiseuille(max_speed_um_s: 300)),
    particles: (number: count(12), diameter_um: constant(2)),
    timing: pairs(count: 2, dt_s: 0.005),
)`;

/** In focus and dense: a displacement field can be measured. */
const VECTORS = `(
    name: "vectors", seed: 4,
    optics: (gaussian: (diameter_px: 2.75, peak_counts: 1000), pixel_dim_x: 192, pixel_dim_y: 160, background_mean: 100, background_noise: 10),
    motion: flow(field: lamb_oseen(max_speed_um_s: 774, core_radius_um: 30)),
    particles: (number: ppp(0.03), diameter_um: constant(1)),
    boundaries: (z_um: (-5, 5)),
    timing: pairs(count: 2, dt_s: 0.005),
)`;

const SMALL = readFileSync("../../scenarios/quickstart.ron", "utf8");

let dataset;
let results;

before(() => {
  dataset = generate(place, "quickstart", SMALL, "--set", "timing.pairs.count=4");
  results = ["spots", "aptv"].map((method) => {
    const path = join(place, `${method}.csv`);
    microsig("track", dataset, "--method", method, "--out", path, "--quiet");
    return path;
  });
});

after(closeBrowser);

/** Runs a check with a page, and checks that it asked nobody but its server and met no error. */
async function withPage(args, check, options) {
  const server = await serve(...args);
  const page = await look(server.address + (options?.hash ?? ""), options);
  try {
    await check(page, server);
    assert.deepEqual(page.strays, [], "requests beyond the server");
    assert.deepEqual(page.faults, [], "errors on the page");
  } finally {
    await page.context().close();
    await server.end();
  }
}

const preview = (page, n = 1) =>
  page.waitForFunction((n) => Number(document.querySelector(".scenario")?.dataset.preview ?? 0) >= n, n, { timeout: 60000 });

/** Puts the cursor behind a part of the scenario. */
async function cursorBehind(page, part) {
  await page.locator("textarea").focus();
  await page.locator("textarea").evaluate((area, part) => {
    const at = area.value.indexOf(part) + part.length;
    area.setSelectionRange(at, at);
  }, part);
}

test("a change is previewed, problems stand at their lines", async () => {
  const file = join(place, "edit.ron");
  writeFileSync(file, SMALL);
  await withPage([file], async (page) => {
    await preview(page);
    const facts = await page.locator(".facts-grid").textContent();
    for (const name of ["Images", "N_S", "SNR", "Displacement A to B", "Full dataset"]) {
      assert.ok(facts.includes(name), name);
    }
    assert.equal(await page.locator(".strip canvas").count(), 11);
    await cursorBehind(page, "count: 10");
    await page.keyboard.type("0");
    await preview(page, 2);
    assert.match(await page.locator(".facts-grid").textContent(), /200 \(100 pairs\)/);
    await cursorBehind(page, "(preset: setting1");
    await page.keyboard.type(", gian: 3");
    await page.waitForFunction(() => document.querySelector(".problems").textContent.includes("gian"));
    assert.match(await page.locator(".problems").textContent(), /line \d+ unknown key `optics.gian`; did you mean `gain`\?/);
    assert.equal(await page.locator(".gutter .wrong").count(), 1);
    const line = SMALL.split("\n").findIndex((text) => text.includes("preset: setting1")) + 1;
    assert.equal(await page.locator(".gutter .wrong").textContent(), String(line));
    assert.equal(await page.locator(".shown .wrong").first().textContent(), "gian");
  });
});

test("keys are completed and explained", async () => {
  const file = join(place, "keys.ron");
  writeFileSync(file, SMALL);
  await withPage([file], async (page) => {
    await preview(page);
    await cursorBehind(page, "(preset: setting1");
    await page.keyboard.type(", background_no");
    await page.waitForSelector(".completions li");
    assert.equal(await page.locator(".completions li .name").first().textContent(), "background_noise");
    await page.keyboard.press("Enter");
    await page.keyboard.press("End");
    assert.match(await page.locator("textarea").inputValue(), /preset: setting1, background_noise: /);
    await cursorBehind(page, "background_noi");
    await page.keyboard.press("ArrowLeft");
    await page.waitForFunction(() => document.querySelector(".help").textContent.includes("optics.background_noise"));
    assert.match(await page.locator(".help").textContent(), /counts.*range/);
    // Variants where a value is due.
    await cursorBehind(page, "number: ");
    await page.keyboard.press("Control+Space");
    await page.waitForSelector(".completions li");
    const names = await page.locator(".completions li .name").allTextContents();
    assert.ok(names.includes("ppp"), names.join());
    await page.keyboard.press("Escape");
    // With the mouse over a key.
    const box = await page.locator("textarea").boundingBox();
    const at = await page.evaluate(() => {
      const area = document.querySelector("textarea");
      const lines = area.value.split("\n");
      const line = lines.findIndex((text) => text.includes("max_speed_um_s"));
      const style = getComputedStyle(area);
      const context = document.createElement("canvas").getContext("2d");
      context.font = `${style.fontSize} ${style.fontFamily}`;
      const width = context.measureText("0").width;
      return [parseFloat(style.paddingLeft) + width * (lines[line].indexOf("max_speed") + 3), parseFloat(style.paddingTop) + (line + 0.5) * parseFloat(style.lineHeight)];
    });
    await page.mouse.move(box.x + at[0], box.y + at[1]);
    await page.waitForSelector(".tip:not([hidden])");
    assert.match(await page.locator(".tip").textContent(), /um\/s/);
  });
});

test("a new edit cancels the preview under way, and Stop stops it", async () => {
  const file = join(place, "slow.ron");
  writeFileSync(file, SMALL);
  await withPage([file], async (page) => {
    await preview(page);
    // Twenty edits: each begins a preview, the last one is shown.
    for (let k = 0; k < 20; k++) {
      await page.locator("textarea").evaluate((area, k) => {
        area.value = area.value.replace(/count\(\d+\)/, `count(${50 + k})`);
        area.dispatchEvent(new Event("input"));
      }, k);
      await page.waitForTimeout(130);
    }
    await page.waitForFunction(() => document.querySelector(".state.ready"), null, { timeout: 60000 });
    assert.match(await page.locator(".facts-grid").textContent(), /In view(6\d|7\d)/);
    await page.locator("textarea").evaluate((area) => {
      area.value = area.value.replace(/count\(\d+\)/, "count(3000)");
      area.dispatchEvent(new Event("input"));
    });
    await page.waitForSelector(".state.busy");
    await page.getByRole("button", { name: "Stop" }).click();
    assert.equal(await page.locator(".state").first().textContent(), "stopped");
    // In the midst of frames that take four seconds each.
    await page.locator("textarea").evaluate((area) => {
      area.value = area.value.replace("preset: setting1", "preset: setting1, n_rays: 50000");
      area.dispatchEvent(new Event("input"));
    });
    await page.waitForFunction(() => document.querySelector(".state").textContent.startsWith("rendering frames"));
    await page.waitForTimeout(300);
    const began = Date.now();
    await page.locator("textarea").evaluate((area, text) => {
      area.value = text;
      area.dispatchEvent(new Event("input"));
    }, SMALL);
    await page.waitForFunction(() => document.querySelector(".state.ready"), null, { timeout: 60000, polling: 20 });
    const ms = Date.now() - began;
    console.log(`# from an edit in the midst of a frame to the whole preview: ${ms} ms`);
    assert.ok(ms < 4000, `${ms} ms`);
  });
});

test("a scenario written only with the page validates and generates", async () => {
  const file = join(place, "written.ron");
  await withPage([file], async (page) => {
    await preview(page);
    await page.locator("textarea").focus();
    await page.keyboard.press("Control+A");
    await page.keyboard.press("Delete");
    await page.keyboard.type('(name: "written",\nmotion: flow(field: lamb_oseen()),\nparticles: (number: ppp(0.001)),\ntiming: pairs(count: 2, dt_s: 0.005),\n)', { delay: 4 });
    await page.keyboard.press("Escape");
    await page.waitForFunction(() => document.querySelector(".state.ready") && document.querySelector(".facts-grid").textContent.includes("4 (2 pairs)"), null, { timeout: 60000 });
    await page.keyboard.press("Control+S");
    await page.waitForFunction(() => document.getElementById("banner").textContent === "Saved.");
  });
  assert.ok(existsSync(file));
  const out = join(place, "written");
  microsig("generate", file, "--out", out, "--quiet");
  microsig("verify", out, "--quiet");
});

/** Centroid of what a screenshot holds within a box, by the weights of its pixels. */
function centroid(png, [left, top, right, bottom], weight) {
  let [n, sx, sy] = [0, 0, 0];
  for (let y = Math.round(top); y < bottom; y++) {
    for (let x = Math.round(left); x < right; x++) {
      const at = 4 * (y * png.width + x);
      const own = weight(png.data[at], png.data[at + 1], png.data[at + 2]);
      // A pixel of the screen covers [x, x + 1).
      n += own;
      sx += own * (x + 0.5);
      sy += own * (y + 0.5);
    }
  }
  return [sx / n, sy / n];
}

test("overlays lie on the particles to a quarter of a pixel of the zoomed image", async () => {
  const out = generate(place, "gaussian", GAUSSIAN);
  await withPage([out], async (page) => {
    await page.waitForFunction(() => document.querySelector(".frame-name")?.textContent);
    await page.waitForTimeout(800);
    const viewer = page.locator(".viewer");
    const box = await viewer.boundingBox();
    const truth = await (await page.request.get(new URL("dataset/0/truth/0", page.url()).href)).json();
    const { x_px: xs, y_px: ys, track: tracks, visible } = truth.columns;
    // Those whose images stand alone, away from the edges.
    const alone = tracks.map((_, i) => i).filter((i) =>
      visible[i] && xs[i] > 20 && xs[i] < 180 && ys[i] > 20 && ys[i] < 120 &&
      tracks.every((_, j) => j === i || Math.hypot(xs[i] - xs[j], ys[i] - ys[j]) > 18));
    assert.ok(alone.length >= 2, `${alone.length} particles stand alone`);
    const label = (name) => page.getByLabel(name, { exact: true });
    for (const i of alone) {
      for (const scale of [8, 5.37]) {
        await page.evaluate(([x, y, scale]) => window.microsig.center("dataset", x, y, scale), [xs[i] + 1.3, ys[i] - 0.7, scale]);
        await label("Circles of the image's size").uncheck();
        await label("Velocity").uncheck();
        await page.waitForTimeout(120);
        const plain = PNG.sync.read(await page.screenshot());
        const [sx, sy] = await page.evaluate(([x, y]) => window.microsig.toScreen("dataset", x, y), [xs[i], ys[i]]);
        const reach = 7 * scale;
        const around = [box.x + sx - reach, box.y + sy - reach, box.x + sx + reach, box.y + sy + reach];
        // The image itself: gray above the background.
        const image = centroid(plain, around, (r) => Math.max(0, r - 40));
        await label("Circles of the image's size").check();
        await page.waitForTimeout(120);
        const drawn = PNG.sync.read(await page.screenshot());
        const ring = centroid(drawn, around, (r, g, b) => (Math.max(r, g, b) - Math.min(r, g, b) > 40 ? 1 : 0));
        const off = Math.hypot(ring[0] - image[0], ring[1] - image[1]) / scale;
        assert.ok(off < 0.25, `particle ${tracks[i]} at zoom ${scale}: ${off.toFixed(3)} px off`);
        console.log(`# particle ${tracks[i]} at zoom ${scale}: circle ${off.toFixed(3)} px beside its image`);
      }
    }
  });
});

test("the numbers of the result page are those of score.json", async () => {
  const scores = results.map((path, k) => {
    const out = join(place, `score${k}`);
    microsig("evaluate", dataset, path, "--out", out, "--quiet");
    return JSON.parse(readFileSync(join(out, "score.json"), "utf8"));
  });
  await withPage([dataset, ...results], async (page) => {
    await page.waitForSelector(".list tr[tabindex]");
    const panes = page.locator(".pane");
    assert.equal(await panes.count(), 2);
    for (let k = 0; k < 2; k++) {
      const shown = await panes.nth(k).locator("[data-score]").evaluateAll((all) => all.map((one) => [one.dataset.score, Number(one.dataset.value)]));
      assert.ok(shown.length >= 5);
      for (const [path, value] of shown) {
        assert.equal(value, path.split(".").reduce((score, step) => score[step], scores[k]), path);
      }
    }
    // The frames' counts add up to those of the score.
    const about = await (await page.request.get(new URL("dataset/0/result/0", page.url()).href)).json();
    const sum = (values) => values.reduce((a, b) => a + b, 0);
    assert.deepEqual([sum(about.tp), sum(about.fn), sum(about.fp)], ["tp", "fn", "fp"].map((name) => scores[0].detection[name]));
    // A row of the list leads to its frame.
    await page.locator(".list tbody tr").nth(1).click();
    const frame = await page.locator(".list tbody tr").nth(1).locator("td").first().textContent();
    await page.waitForFunction((k) => document.querySelector(".result .frame-name").textContent.includes(`(${k + 1} of`), Number(frame));
    // and to its place, in all results.
    await page.waitForFunction(() => window.microsig?.page("result").panes.every(({ viewer }) => viewer.scale >= 3));
    await page.waitForTimeout(200);
    const places = await page.evaluate(() => window.microsig.page("result").panes.map(({ viewer }) => [viewer.scale, viewer.left, viewer.upper]));
    assert.deepEqual(places[0], places[1]);
    await page.getByRole("tab", { name: "Leaderboard" }).click();
    await page.waitForFunction(() => document.querySelectorAll(".board td[data-value]").length > 8 && !document.querySelector(".board").textContent.includes("\u2026"));
    const rows = await page.locator(".board tbody tr").evaluateAll((all) => all.map((row) => [row.querySelector(".name").textContent, Number(row.querySelector('[data-score="detection.f1"]').dataset.value)]));
    for (const [name, f1] of rows) {
      assert.equal(f1, scores[name === "spots" ? 0 : 1].detection.f1);
    }
  });
});

test("vectors of a field are drawn where they are, with the scores of evaluate", async () => {
  const out = generate(place, "vectors", VECTORS);
  const path = join(place, "piv.csv");
  microsig("track", out, "--method", "piv", "--out", path, "--quiet");
  const scored = join(place, "vectors_score");
  microsig("evaluate", out, path, "--out", scored, "--quiet");
  const score = JSON.parse(readFileSync(join(scored, "score.json"), "utf8"));
  await withPage([out, path], async (page) => {
    await page.waitForSelector(".pane [data-score]");
    for (const name of ["aee_px", "valid_vector_probability"]) {
      const shown = await page.locator(`.pane [data-score="field.${name}"]`).getAttribute("data-value");
      assert.equal(Number(shown), score.field[name], name);
    }
    assert.equal(await page.locator(".list").count(), 0, "a field has no list of particles");
    const side = await page.locator(".result .side").innerText();
    assert.ok(side.includes("Average endpoint error") && !side.includes("null"), side);
    const text = await page.locator('.side [data-score="field.outlier_fraction"]').getAttribute("data-value");
    assert.equal(Number(text), score.field.outlier_fraction);
    await page.getByLabel("Magnification of errors").fill("1");
    await page.keyboard.press("Tab");
    await page.waitForFunction(() => window.microsig?.page("result").panes[0].vectors?.x_px.length > 0);
    const vectors = await page.evaluate(() => window.microsig.page("result").panes[0].vectors);
    // Each line of the result is a vector of the first pair.
    const lines = readFileSync(path, "utf8").trim().split("\n").slice(1).map((line) => line.split(",").map(Number));
    const first = lines.filter(([pair]) => pair === 0);
    assert.equal(vectors.x_px.length, first.length);
    assert.deepEqual([vectors.x_px[5], vectors.y_px[5], vectors.dx_px[5], vectors.dy_px[5]], first[5].slice(1, 5));
    // Those that stand out, away from edges, in an image of 14 px of the screen for each of its own.
    const long = vectors.x_px.map((_, i) => i).filter((i) => Math.hypot(vectors.dx_px[i], vectors.dy_px[i]) > 2.5 && Math.abs(vectors.x_px[i] - 96) < 60 && Math.abs(vectors.y_px[i] - 80) < 50);
    assert.ok(long.length >= 4, `${long.length} long vectors`);
    for (const i of long.slice(0, 4)) {
      const [x, y, dx, dy] = ["x_px", "y_px", "dx_px", "dy_px"].map((name) => vectors[name][i]);
      await page.evaluate(([x, y]) => window.microsig.page("result").panes[0].viewer.center(x, y, 14), [x, y]);
      await page.waitForTimeout(150);
      const box = await page.locator(".pane .viewer").boundingBox();
      const png = PNG.sync.read(await page.screenshot());
      const isBlue = async (share) => {
        const [sx, sy] = await page.evaluate(([x, y]) => window.microsig.page("result").panes[0].viewer.toScreen(x, y), [x + share * dx, y + share * dy]);
        for (const [ox, oy] of [[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1]]) {
          const at = 4 * (Math.floor(box.y + sy + oy) * png.width + Math.floor(box.x + sx + ox));
          if (png.data[at + 2] - png.data[at] > 60) {
            return true;
          }
        }
        return false;
      };
      assert.ok(await isBlue(0.4), `vector ${i} at 0.4 of its length`);
      assert.ok(await isBlue(0.8), `vector ${i} at 0.8 of its length`);
      assert.ok(!(await isBlue(-0.5)), `behind vector ${i}`);
    }
  });
  const html = join(place, "vectors.html");
  microsig("view", out, path, "--export", html, "--frames", "0,2", "--quiet");
  const page = await look(pathToFileURL(html).href);
  await page.waitForFunction(() => window.microsig?.page("result")?.panes[0]?.vectors?.x_px.length > 0);
  assert.equal(Number(await page.locator('.pane [data-score="field.aee_px"]').getAttribute("data-value")), score.field.aee_px);
  await page.locator(".pane .viewer").focus();
  await page.keyboard.press("ArrowRight");
  await page.waitForFunction(() => document.querySelector(".result .frame-name").textContent.includes("2 of 2"));
  await page.waitForFunction(() => window.microsig?.page("result").panes[0].vectors?.pair[0] === 1);
  assert.deepEqual([page.strays, page.faults], [[], []]);
  await page.context().close();
});

test("a particle that is clicked shows its row and its noise-free image", async () => {
  await withPage([dataset], async (page) => {
    await page.waitForFunction(() => document.querySelector(".frame-name")?.textContent);
    await page.waitForTimeout(500);
    const truth = await (await page.request.get(new URL("dataset/0/truth/0", page.url()).href)).json();
    const i = truth.columns.visible.indexOf(1);
    const [x, y] = [truth.columns.x_px[i], truth.columns.y_px[i]];
    const [sx, sy] = await page.evaluate(([x, y]) => window.microsig.toScreen("dataset", x, y), [x, y]);
    const box = await page.locator(".viewer").boundingBox();
    await page.mouse.click(box.x + sx, box.y + sy);
    await page.waitForSelector(".particle caption");
    const track = Number((await page.locator(".particle caption").textContent()).replace(/\D/g, ""));
    assert.ok(truth.columns.track.includes(track));
    await page.waitForSelector(".pictures canvas");
    assert.equal(await page.locator(".pictures canvas").count(), 2);
    // By the keyboard: next frame, the same particle.
    await page.locator(".viewer").focus();
    await page.keyboard.press("ArrowRight");
    await page.waitForFunction(() => document.querySelector(".frame-name").textContent.includes("(2 of"));
    assert.match(await page.locator(".particle").textContent(), new RegExp(`article ${track}`));
  });
});

test("an exported page opens without the program and asks nobody", async () => {
  const out = join(place, "page.html");
  const said = JSON.parse(microsig("view", dataset, ...results, "--export", out, "--frames", "0,1,5", "--json", "--quiet"));
  assert.deepEqual(said.frames, [0, 1, 5]);
  assert.equal(readFileSync(out).length, said.bytes);
  const page = await look(pathToFileURL(out).href);
  await page.waitForSelector(".list tr[tabindex]");
  assert.deepEqual(await page.getByRole("tab").allTextContents(), ["Dataset", "Result", "Leaderboard"]);
  assert.match(await page.locator(".result .frame-name").textContent(), /1 of 3/);
  await page.getByRole("tab", { name: "Dataset" }).click();
  await page.waitForFunction(() => document.querySelector(".dataset .frame-name")?.textContent);
  await page.getByRole("tab", { name: "Leaderboard" }).click();
  await page.waitForSelector(".board td[data-value]");
  assert.deepEqual(page.strays, []);
  assert.deepEqual(page.faults, []);
  await page.context().close();
});

test("an exported sweep has its leaderboard, its curves and the frames of its first case", async () => {
  const file = join(place, "sweep.ron");
  const base = join(place, "sweep_base.ron");
  writeFileSync(base, SMALL.replace("count: 10", "count: 2"));
  writeFileSync(file, `(name: "sweep", base: "${base}", axes: [(path: "particles.number.count", values: list([10, 30]))])`);
  const cases = join(place, "sweep");
  microsig("sweep", file, "--out", cases, "--quiet");
  const tracker = join(place, "tracker");
  mkdirSync(tracker);
  const scores = ["case_00000", "case_00001"].map((name) => {
    const path = join(tracker, `${name}.csv`);
    microsig("track", join(cases, name), "--method", "spots", "--out", path, "--quiet");
    microsig("evaluate", join(cases, name), path, "--out", join(place, `score_${name}`), "--quiet");
    return JSON.parse(readFileSync(join(place, `score_${name}`, "score.json"), "utf8"));
  });
  const out = join(place, "sweep.html");
  const said = JSON.parse(microsig("view", cases, tracker, "--export", out, "--json", "--quiet"));
  assert.equal(readFileSync(out).length, said.bytes);
  assert.ok(said.bytes < said.limit_bytes);
  const page = await look(pathToFileURL(out).href);
  await page.waitForFunction(() => document.querySelectorAll(".board td[data-value]").length > 8 && !document.querySelector(".board").textContent.includes("\u2026"));
  for (const [k, name] of ["case_00000", "case_00001"].entries()) {
    const row = page.locator(".board tbody tr", { hasText: name });
    for (const path of ["detection.f1", "detection.recall", "links.f1"]) {
      const value = Number(await row.locator(`[data-score="${path}"]`).getAttribute("data-value"));
      assert.equal(value, path.split(".").reduce((score, step) => score[step], scores[k]), `${name} ${path}`);
    }
  }
  assert.match(await page.locator(".board figcaption").textContent(), /F1 over particles.number.count/);
  assert.ok((await page.locator(".board .chart canvas").count()) > 0);
  await page.locator(".board tbody tr", { hasText: "case_00001" }).getByRole("button").click();
  await page.waitForFunction(() => document.getElementById("banner").textContent.includes("does not contain the frames"));
  await page.getByRole("tab", { name: "Leaderboard" }).click();
  await page.locator(".board tbody tr", { hasText: "case_00000" }).getByRole("button").click();
  await page.waitForSelector(".list tr[tabindex]");
  assert.deepEqual([page.strays, page.faults], [[], []]);
  await page.context().close();
});

test("an export that would be too large leaves frames out and says which", async () => {
  const out = generate(place, "large", GAUSSIAN.replace("pixel_dim_x: 200, pixel_dim_y: 140", "pixel_dim_x: 2048, pixel_dim_y: 2048").replace("count: 2", "count: 4"), "--set", "calibration=none");
  const html = join(place, "large.html");
  const said = JSON.parse(microsig("view", out, "--export", html, "--frames", "0,1,2,3,4,5,6,7", "--json", "--quiet"));
  assert.deepEqual([...said.frames, ...said.left_out], [0, 1, 2, 3, 4, 5, 6, 7]);
  assert.ok(said.frames.length >= 4 && said.left_out.length >= 1, JSON.stringify(said));
  assert.equal(said.bytes, readFileSync(html).length);
  assert.ok(said.bytes <= said.limit_bytes && said.limit_bytes === 64 * 2 ** 20);
});

test("the program ends when the last page is closed, and by Ctrl-C", async () => {
  const first = await serve(dataset);
  const page = await look(first.address);
  await page.waitForFunction(() => document.querySelector(".frame-name")?.textContent);
  await page.reload();
  await page.waitForFunction(() => document.querySelector(".frame-name")?.textContent);
  await page.context().close();
  assert.equal(await first.ended, 0);
  const second = await serve(dataset);
  const other = await look(second.address);
  await other.waitForFunction(() => document.querySelector(".frame-name")?.textContent);
  assert.equal(await second.end(), 0);
  await other.waitForFunction(() => document.getElementById("banner").textContent.includes("has ended"));
  await other.context().close();
});
