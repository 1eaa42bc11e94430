// A notebook in JupyterLab, run in a real browser: progress, the card of a dataset with its picture, tables of pandas and polars.
//   JUPYTER=ENVIRONMENT/bin/jupyter-lab node jupyter.mjs [PICTURE.png]     the environment has microsig, jupyterlab, pandas, polars, tqdm, ipywidgets

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { writeFileSync } from "node:fs";
import { join } from "node:path";
import { closeBrowser, folder, theBrowser } from "./harness.mjs";

const CELLS = [
  'import microsig as ms\nds = ms.generate("quickstart", set={"timing.pairs.count": 3}, progress=True)\nds',
  "import pandas\npandas.DataFrame(ds.tracks).head()",
  "import polars\npolars.DataFrame(ds.tracks).head()",
  'print("the end")',
];

const place = folder();
const cell = (source, k) => ({ cell_type: "code", id: `c${k}`, metadata: {}, execution_count: null, outputs: [], source });
const notebook = { cells: CELLS.map(cell), metadata: { kernelspec: { name: "python3", display_name: "Python 3" } }, nbformat: 4, nbformat_minor: 5 };
writeFileSync(join(place, "first.ipynb"), JSON.stringify(notebook));

const server = spawn(
  process.env.JUPYTER,
  ["--no-browser", "--allow-root", "--ip=127.0.0.1", "--port=0", "--ServerApp.token=", "--ServerApp.password=", `--notebook-dir=${place}`],
  { stdio: ["ignore", "ignore", "pipe"], env: { ...process.env, JUPYTER_CONFIG_DIR: join(place, "config") } },
);
const address = await new Promise((done, fail) => {
  let said = "";
  server.stderr.on("data", (data) => {
    said += data;
    const found = said.match(/http:\/\/127\.0\.0\.1:\d+\//);
    if (found) done(found[0]);
  });
  server.on("exit", (code) => fail(new Error(`JupyterLab ended with ${code}:\n${said}`)));
});

const context = await (await theBrowser()).newContext({ viewport: { width: 1200, height: 1600 } });
const page = await context.newPage();
page.setDefaultTimeout(60_000);
try {
  await page.goto(`${address}lab/tree/first.ipynb`);
  await page.locator(".jp-Notebook .jp-CodeCell").first().waitFor();
  // JupyterLab may ask for the kernel, although the notebook names one.
  const accept = page.locator(".jp-Dialog .jp-mod-accept");
  const asked = await accept.waitFor({ timeout: 15_000 }).then(() => true, () => false);
  if (asked) await accept.click();
  await page.locator(".jp-Notebook-ExecutionIndicator[data-status='idle']").waitFor();
  await page.locator(".lm-MenuBar-itemLabel", { hasText: /^Run$/ }).click();
  await page.locator(".lm-Menu-itemLabel", { hasText: /^Run All Cells$/ }).click();
  await page.locator(".jp-OutputArea-output", { hasText: "the end" }).waitFor();
  const outputs = (k) => page.locator(".jp-CodeCell").nth(k).locator(".jp-OutputArea-output");
  const first = (await outputs(0).allInnerTexts()).join("\n");
  assert.match(first, /100\s?%|6\/6/, `progress: ${first}`);
  assert.match(first, /6 of 752 x 366 px/, first);
  const picture = outputs(0).locator("img");
  assert.ok(await picture.evaluate((image) => image.naturalWidth > 100), "the card has a picture");
  for (const [k, kind] of [[1, "pandas"], [2, "polars"]]) {
    const head = await outputs(k).locator("thead").first().innerText();
    for (const name of ["frame", "track", "x_px", "z_um"]) assert.match(head, new RegExp(`\\b${name}\\b`), `${kind}: ${head}`);
    assert.equal(await outputs(k).locator("tbody tr").count(), 5, kind);
  }
  console.log("a notebook in JupyterLab shows progress, a dataset's card with its picture, and tables");
} finally {
  if (process.argv[2]) await page.screenshot({ path: process.argv[2] });
  await closeBrowser();
  server.removeAllListeners("exit");
  server.kill();
}
