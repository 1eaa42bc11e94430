// Times and memory of `microsig view`: node measure.mjs [FOLDER]; prints the rows of results/view/README.md.

import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { loadavg } from "node:os";
import { join } from "node:path";
import { closeBrowser, folder, generate, look, microsig, serve } from "./harness.mjs";

const place = process.argv[2] ?? folder();
const quickstart = readFileSync("../../scenarios/quickstart.ron", "utf8");

/** 2048 x 2048 px with 500 particles. */
const LARGE = quickstart
  .replace("(preset: setting1)", "(preset: setting1, pixel_dim_x: 2048, pixel_dim_y: 2048)")
  .replace("count(46)", "count(500)");

/** Peak memory of a process, MB. */
const peakMb = (pid) => Number(/VmHWM:\s+(\d+)/.exec(readFileSync(`/proc/${pid}/status`, "utf8"))[1]) / 1024;

const tell = (what, value, bar) => console.log(`| ${what} | ${value} | ${bar} | ${loadavg()[0].toFixed(1)} |`);

/** Makes a dataset unless it is there already. */
const dataset = (name, text, ...args) => (existsSync(join(place, name)) ? join(place, name) : generate(place, name, text, ...args, "--set", "calibration=none"));

console.log("| what | found | bar | load before |\n|---|---|---|---|");

/** Times from a key to the whole preview, ms. */
async function typing(text, edits) {
  const file = join(place, "typed.ron");
  writeFileSync(file, text);
  const server = await serve(file, "--stay");
  const page = await look(server.address);
  const done = (n) => page.waitForFunction((n) => Number(document.querySelector(".scenario")?.dataset.preview ?? 0) >= n, n, { timeout: 120000, polling: 10 });
  await done(1);
  const times = [];
  const firsts = [];
  for (let k = 0; k < edits; k++) {
    await page.locator("textarea").focus();
    await page.locator("textarea").evaluate((area) => {
      const at = area.value.indexOf("seed: ") + 6;
      area.setSelectionRange(at, at);
    });
    const began = Date.now();
    await page.keyboard.type("1");
    await page.waitForFunction(() => /one particle|numbers|preview in/.test(document.querySelector(".state").textContent), null, { timeout: 120000, polling: 10 });
    firsts.push(Date.now() - began);
    await done(k + 2);
    times.push(Date.now() - began);
  }
  const mb = peakMb(server.child.pid);
  await page.context().close();
  await server.end();
  const middle = (all) => [...all].sort((a, b) => a - b)[Math.floor(all.length / 2)];
  return { frame: middle(firsts), all: middle(times), worst: Math.max(...times), mb };
}

const small = await typing(quickstart, 9);
tell("quickstart, from a key to frames A and B / to the whole preview (median, worst of 9)", `${small.frame} / ${small.all}, ${small.worst} ms`, "1000 ms");
const large = await typing(LARGE, 5);
tell("2048 x 2048 px, 500 particles, the same (of 5)", `${large.frame} / ${large.all}, ${large.worst} ms`, "2000 ms");
tell("peak memory of the server, previews of 2048 x 2048 px", `${large.mb.toFixed(0)} MB`, "300 MB");

const long = dataset("long", quickstart, "--set", "timing=sequence(frames: 10000, dt_s: 0.0005)");
{
  const server = await serve(long, "--stay");
  const began = Date.now();
  const page = await look(`${server.address}#dataset`);
  await page.waitForFunction(() => document.querySelector(".frame-name")?.textContent && document.querySelector(".viewer canvas").width, null, { polling: 10 });
  await page.waitForFunction(() => document.querySelector(".fieldset, .side dd"), null, { polling: 10 });
  tell("10,000 frames: from the address to the first frame with its truth", `${Date.now() - began} ms`, "2000 ms");
  // Steps through frames as fast as they come, in places that were not seen yet.
  const fps = await page.evaluate(async () => {
    const slider = document.querySelector('input[aria-label="Frame"]');
    const name = document.querySelector(".frame-name");
    const page = window.microsig.page("dataset");
    const start = performance.now();
    let n = 0;
    for (let k = 0; k < 100; k++) {
      await page.timeline.to((k * 97 + 13) % 10000);
      n++;
    }
    return { fps: (1000 * n) / (performance.now() - start), name: name.textContent, value: slider.value };
  });
  tell("10,000 frames: frames a second while scrolling to new places", fps.fps.toFixed(0), "10");
  tell("10,000 frames: peak memory of the server", `${peakMb(server.child.pid).toFixed(0)} MB`, "300 MB");
  await page.context().close();
  await server.end();
}
{
  const path = join(long, "truth/tracks.csv");
  const server = await serve(long, path, "--stay");
  const page = await look(`${server.address}#result`);
  const began = Date.now();
  await page.waitForSelector(".list tr[tabindex]", { timeout: 300000 });
  tell("10,000 frames with a result of all particles: scored and listed after", `${Date.now() - began} ms`, "");
  tell("the same: peak memory of the server", `${peakMb(server.child.pid).toFixed(0)} MB`, "300 MB");
  await page.context().close();
  await server.end();
}
{
  const large = dataset("large", LARGE, "--set", "timing.pairs.count=20");
  const server = await serve(large, "--stay");
  const page = await look(`${server.address}#dataset`, { width: 2560, height: 1440 });
  await page.waitForFunction(() => document.querySelector(".frame-name")?.textContent);
  await page.waitForTimeout(3000);
  const fps = await page.evaluate(async () => {
    const page = window.microsig.page("dataset");
    const start = performance.now();
    for (let k = 0; k < 39; k++) {
      await page.timeline.to(k + 1);
      await new Promise(requestAnimationFrame);
    }
    return 39000 / (performance.now() - start);
  });
  tell("2048 x 2048 px: frames a second, first time seen", fps.toFixed(1), "");
  tell("2048 x 2048 px: peak memory of the server", `${peakMb(server.child.pid).toFixed(0)} MB`, "300 MB");
  await page.context().close();
  await server.end();
}
await closeBrowser();
