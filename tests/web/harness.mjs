// A dataset, a server that shows it, a browser that looks at it.

import { execFileSync, spawn } from "node:child_process";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { chromium } from "playwright-core";

/** The command. */
export const MICROSIG = process.env.MICROSIG ?? "../../target/debug/microsig";

const CHROMIUM = process.env.CHROMIUM ?? "/usr/bin/chromium";

/** A folder that is removed at the end. */
export function folder() {
  const path = mkdtempSync(join(tmpdir(), "microsig-web-"));
  process.on("exit", () => rmSync(path, { recursive: true, force: true }));
  return path;
}

/** Runs the command to its end. */
export function microsig(...args) {
  return execFileSync(MICROSIG, args, { encoding: "utf8", stdio: ["ignore", "pipe", "pipe"] });
}

/** Makes a dataset of a scenario's text. */
export function generate(place, name, text, ...args) {
  const file = join(place, `${name}.ron`);
  writeFileSync(file, text);
  const out = join(place, name);
  microsig("generate", file, "--out", out, "--quiet", ...args);
  return out;
}

/** Starts `microsig view`; gives its address and how to end it. */
export async function serve(...args) {
  const child = spawn(MICROSIG, ["view", "--json", "--no-browser", "--quiet", ...args], { stdio: ["ignore", "pipe", "inherit"] });
  const ended = new Promise((done) => child.on("exit", (code) => done(code)));
  const address = await new Promise((done, fail) => {
    let said = "";
    child.stdout.on("data", (data) => {
      said += data;
      if (said.includes("\n")) {
        done(JSON.parse(said.split("\n")[0]).address);
      }
    });
    child.on("exit", (code) => fail(new Error(`microsig view ended with ${code}`)));
  });
  const end = async () => {
    child.kill("SIGINT");
    return ended;
  };
  return { address, end, ended, child };
}

let browser = null;

/** The browser, started once. */
export async function theBrowser() {
  browser ??= await chromium.launch({ executablePath: CHROMIUM, args: ["--no-sandbox", "--disable-gpu", "--force-color-profile=srgb"] });
  return browser;
}

/** Closes the browser. */
export async function closeBrowser() {
  await browser?.close();
  browser = null;
}

/** A page at an address. Requests to other places than its server, and messages of errors, are collected. */
export async function look(address, { width = 1280, height = 720, theme = "light" } = {}) {
  const context = await (await theBrowser()).newContext({ viewport: { width, height }, colorScheme: theme, deviceScaleFactor: 1 });
  const page = await context.newPage();
  page.strays = [];
  page.faults = [];
  page.on("request", (request) => {
    const url = request.url();
    if (!url.startsWith(address.split("#")[0]) && !/^(data|blob|about):/.test(url)) {
      page.strays.push(url);
    }
  });
  page.on("pageerror", (error) => page.faults.push(String(error)));
  page.on("console", (message) => {
    if (message.type() === "error") {
      page.faults.push(message.text());
    }
  });
  if (process.env.MICROSIG_PAGE && address.startsWith("http")) {
    // While the page is written: its files as they are now, not those in the command.
    await page.route(address.split("#")[0], (route) => route.fulfill({ path: join(process.env.MICROSIG_PAGE, "index.html") }));
    await page.route(/\/page\/[^/]+$/, (route) => route.fulfill({ path: join(process.env.MICROSIG_PAGE, route.request().url().split("/").pop()) }));
  }
  await page.goto(address);
  return page;
}
