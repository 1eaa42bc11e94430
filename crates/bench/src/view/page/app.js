// The page: tabs, theme, end of the program.

import { getJson, isExport, keepAlive } from "./api.js";
import { el, lastPart, say } from "./dom.js";
import { redrawCharts } from "./plots.js";
import { ScenarioPage } from "./scenario.js";
import { DatasetPage } from "./dataset.js";
import { ResultPage } from "./result.js";
import { BoardPage } from "./board.js";

const main = document.getElementById("main");
const tabs = document.getElementById("tabs");
const views = {};

function showTab(name) {
  for (const tab of tabs.children) {
    tab.setAttribute("aria-selected", String(tab.dataset.name === name));
    tab.tabIndex = tab.dataset.name === name ? 0 : -1;
  }
  for (const [own, { panel }] of Object.entries(views)) {
    panel.hidden = own !== name;
  }
  const view = views[name];
  history.replaceState(null, "", `#${name}`);
  if (!view.isMade) {
    view.isMade = true;
    view.page = view.make();
    view.panel.append(view.page.element);
  }
  Promise.resolve(view.load(view.page)).catch((error) => say(error.message, true));
  view.page.shownAgain?.();
}

function addTab(name, text, make, load = (page) => page.load()) {
  const panel = el("div", { class: "panel", role: "tabpanel", id: `panel-${name}`, "aria-label": text, hidden: true });
  const tab = el("button", { type: "button", role: "tab", "data-name": name, "aria-controls": panel.id, onclick: () => showTab(name) }, text);
  tabs.append(tab);
  main.append(panel);
  views[name] = { panel, make, load, page: null, isMade: false };
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  redrawCharts();
}

async function begin() {
  const about = await getJson("about");
  const title = document.getElementById("title");
  title.textContent = isExport ? `${lastPart(about.title)} (exported)` : lastPart(about.title);
  title.title = about.title;
  document.title = `${lastPart(about.title)} \u2013 microsig`;
  // Selection of the dataset and result pages; the leaderboard changes it.
  const first = about.trackers.map((tracker, t) => (tracker.has[0] ? t : -1)).filter((t) => t >= 0);
  const chosen = { dataset: 0, trackers: first };
  const names = about.trackers.map((tracker) => tracker.name);
  const openResult = (dataset, trackers) => {
    Object.assign(chosen, { dataset, trackers });
    showTab(trackers.length ? "result" : "dataset");
  };
  if (!isExport) {
    addTab("scenario", "Scenario", () => new ScenarioPage(), (page) => (page.isLoaded ? null : ((page.isLoaded = true), page.load())));
  }
  if (about.datasets.length) {
    addTab("dataset", "Dataset", () => new DatasetPage(), (page) => page.load(chosen.dataset));
  }
  if (about.trackers.length) {
    addTab("result", "Result", () => new ResultPage(), (page) => page.load(chosen.dataset, chosen.trackers, names));
  }
  if (about.is_sweep || about.trackers.length) {
    addTab("board", "Leaderboard", () => new BoardPage(about, openResult));
  }
  tabs.addEventListener("keydown", (event) => {
    const all = [...tabs.children];
    const k = all.findIndex((tab) => tab === document.activeElement);
    const next = { ArrowRight: k + 1, ArrowLeft: k - 1 }[event.key];
    if (k >= 0 && next !== undefined) {
      all[(next + all.length) % all.length].focus();
      all[(next + all.length) % all.length].click();
    }
  });
  const requested = location.hash.slice(1);
  const usual = about.is_sweep ? "board" : about.trackers.length ? "result" : about.datasets.length ? "dataset" : "scenario";
  showTab(views[requested] ? requested : usual);
}

const dark = matchMedia("(prefers-color-scheme: dark)");
setTheme(dark.matches ? "dark" : "light");
dark.addEventListener("change", () => setTheme(dark.matches ? "dark" : "light"));
document.getElementById("theme").addEventListener("click", () => {
  setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
});
begin().catch((error) => say(error.message, true));
keepAlive(() => say("The program has ended. Start `microsig view` again to continue.", true, true));

// For scripts and tests: screen position of an image pixel, and centering of the view.
window.microsig = {
  toScreen: (name, x, y) => views[name].page.viewer.toScreen(x, y),
  page: (name) => views[name]?.page,
  center: (name, x, y, scale) => views[name].page.viewer.center(x, y, scale),
};
