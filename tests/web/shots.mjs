// Screenshots of all pages, light and dark, small and large: node shots.mjs [FOLDER]

import { mkdirSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { closeBrowser, folder, look, microsig, serve } from "./harness.mjs";

const out = process.argv[2] ?? "shots";
const only = process.argv[3];
mkdirSync(out, { recursive: true });
const place = folder();
const scenario = process.env.SCENARIO ?? "../../scenarios/quickstart.ron";
const dataset = join(place, "quickstart");
microsig("generate", scenario, "--out", dataset, "--quiet", "--set", "timing.pairs.count=6", "--set", "particles.number.count=46");
const results = ["aptv", "ncc"].map((method) => {
  const path = join(place, `${method}.csv`);
  microsig("track", dataset, "--method", method, "--out", path, "--quiet");
  return path;
});
const sweep = join(place, "noise.ron");
writeFileSync(sweep, `(name: "noise_and_density", base: "${join(process.cwd(), scenario)}", axes: [
  (path: "particles.number.count", values: list([20, 60, 160])), (path: "optics.background_noise", values: list([2, 40]))])`);
const cases = join(place, "sweep");
microsig("sweep", sweep, "--out", cases, "--quiet");
const trackers = ["spots", "aptv"].map((method) => join(place, method));
for (const tracker of trackers) {
  mkdirSync(tracker);
  for (const name of readdirSync(cases).filter((name) => /^case_\d+$/.test(name))) {
    microsig("track", join(cases, name), "--method", tracker.split("/").pop(), "--out", join(tracker, `${name}.csv`), "--quiet");
  }
}
const own = join(place, "quickstart.ron");
writeFileSync(own, readFileSync(scenario));
const vectors = join(place, "piv_gaussian");
microsig("generate", "../../scenarios/piv_gaussian.ron", "--out", vectors, "--quiet", "--set", "timing.pairs.count=3");
microsig("track", vectors, "--method", "piv", "--out", join(place, "piv.csv"), "--quiet");

const servers = {
  scenario: await serve(own, "--stay"),
  dataset: await serve(dataset, ...results, "--stay"),
  field: await serve(vectors, join(place, "piv.csv"), "--stay"),
  sweep: await serve(cases, ...trackers, "--stay"),
};

const shots = {
  scenario: async (page) => page.waitForFunction(() => document.querySelector(".scenario")?.dataset.preview),
  "scenario-wrong": async (page) => {
    await page.waitForFunction(() => document.querySelector(".scenario")?.dataset.preview);
    const area = page.locator("textarea");
    await area.focus();
    await area.evaluate((t) => t.setSelectionRange(t.value.indexOf("(preset: setting1)") + 1, t.value.indexOf("(preset: setting1)") + 17));
    await page.keyboard.type("preset: setting1, gian: 3");
    await page.waitForSelector(".problems li");
  },
  "scenario-complete": async (page) => {
    await page.waitForFunction(() => document.querySelector(".scenario")?.dataset.preview);
    const area = page.locator("textarea");
    await area.focus();
    await area.evaluate((t) => t.setSelectionRange(t.value.indexOf("(preset: setting1)") + 17, t.value.indexOf("(preset: setting1)") + 17));
    await page.keyboard.type(", b");
    await page.waitForSelector(".completions li");
  },
  dataset: async (page) => {
    await page.waitForFunction(() => document.querySelector(".frame-name")?.textContent);
    await page.waitForTimeout(1500);
    const box = await page.locator(".panel:not([hidden]) .viewer").boundingBox();
    await page.mouse.click(box.x + box.width * 0.5, box.y + box.height * 0.5);
    for (const [x, y] of [[0.4, 0.4], [0.6, 0.5], [0.35, 0.6], [0.5, 0.3], [0.3, 0.3], [0.7, 0.7]]) {
      if (await page.locator(".particle table").count()) {
        break;
      }
      await page.mouse.click(box.x + box.width * x, box.y + box.height * y);
      await page.waitForTimeout(100);
    }
    await page.waitForTimeout(600);
  },
  result: async (page) => {
    await page.waitForSelector(".list tr[tabindex]");
    await page.waitForTimeout(1200);
  },
  "result-jump": async (page) => {
    await page.waitForSelector(".list tr[tabindex]");
    await page.locator(".list tbody tr").nth(2).click();
    await page.waitForTimeout(800);
  },
  "result-field": async (page) => {
    await page.waitForFunction(() => window.microsig?.page("result")?.panes[0]?.vectors?.x_px.length > 0);
    await page.waitForTimeout(800);
  },
  "dataset-field": async (page) => {
    await page.waitForFunction(() => document.querySelector(".frame-name")?.textContent);
    await page.getByLabel("Circles of the image's size").uncheck();
    await page.getByLabel("Velocity", { exact: true }).uncheck();
    await page.getByLabel("Field", { exact: true }).check();
    await page.waitForTimeout(1200);
  },
  board: async (page) => {
    await page.waitForFunction(() => [...document.querySelectorAll(".board td")].length && !document.querySelector(".board").textContent.includes("\u2026"));
    await page.waitForTimeout(500);
  },
};

for (const [name, prepare] of Object.entries(shots)) {
  if (only && !name.startsWith(only)) {
    continue;
  }
  const kind = name.split("-")[0];
  const server = name.endsWith("-field") ? servers.field : kind === "board" ? servers.sweep : (servers[kind] ?? servers.dataset);
  for (const theme of ["light", "dark"]) {
    for (const [width, height] of [[1280, 720], [2560, 1440]]) {
      const page = await look(server.address + `#${kind}`, { width, height, theme });
      await prepare(page).catch((error) => console.log(name, error.message.split("\n")[0]));
      await page.screenshot({ path: join(out, `${name}-${theme}-${width}.png`) });
      if (page.strays.length + page.faults.length) {
        console.log(name, theme, width, page.strays, page.faults);
      }
      await page.context().close();
    }
  }
}
await closeBrowser();
await Promise.all(Object.values(servers).map((server) => server.end()));
