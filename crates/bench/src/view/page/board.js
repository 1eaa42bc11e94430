// Page 4: the scores of all trackers on all datasets.

import { getJson } from "./api.js";
import { choice, el, field, lastPart, num, say, unitText } from "./dom.js";
import { Chart } from "./plots.js";

const seriesColors = ["#5b9dff", "#ff9a4a", "#2fd3b5", "#c58bff", "#ff5fb0", "#c9b037"];

/** The value of a score as a number of which more is better; a missing one is the worst. */
const merit = (better, value) => {
  if (value === null) {
    return -Infinity;
  }
  const merits = { near_one: -Math.abs(value - 1), near_zero: -Math.abs(value), smaller: -value };
  return merits[better] ?? value;
};

/** The page of the leaderboard; `open` is called with a dataset and its trackers. */
export class BoardPage {
  constructor(about, open) {
    Object.assign(this, { about, open });
    this.entries = new Map();
    this.chart = new Chart({ label: "Score over an axis", share: 0.4 });
    this.table = el("div", { class: "list", tabindex: "0", role: "region", "aria-label": "Scores" });
    this.progress = el("span", { class: "state", role: "status" });
    this.sorted = { by: null, isUp: false };
    const options = about.columns.map(({ path, label, unit }) => [path, unit ? `${label}, ${unitText(unit)}` : label]);
    this.score = choice(options, "detection.f1", () => this.draw(), "Score");
    this.axis = choice(
      [...about.axes.map((axis, k) => [k, axis]), [-1, about.is_sweep ? "case" : "dataset"]],
      about.axes.length ? 0 : -1,
      () => this.draw(),
      "Axis",
    );
    const isSweep = about.is_sweep;
    this.element = el(
      "div",
      { class: "board" },
      el("div", { class: "bar" }, el("span", { class: "file", title: about.title }, lastPart(about.title)), el("span", { class: "gap" }), this.progress, field("Score", this.score), isSweep ? field("over", this.axis) : null),
      isSweep ? this.chart.element : null,
      this.table,
    );
  }

  async load() {
    if (this.isLoaded) {
      return;
    }
    this.isLoaded = true;
    const { datasets, trackers } = this.about;
    const all = datasets.flatMap((_, d) => trackers.map((tracker, t) => [d, t, tracker.has[d]])).filter(([, , has]) => has);
    let done = 0;
    this.progress.textContent = all.length ? `scoring ${all.length} results\u2026` : "";
    this.draw();
    const work = async () => {
      for (let next = all.shift(); next; next = all.shift()) {
        const [d, t] = next;
        try {
          this.entries.set(`${d}/${t}`, await getJson(`board/${d}/${t}`));
        } catch (error) {
          this.entries.set(`${d}/${t}`, { error: error.message, scores: {} });
        }
        done++;
        this.progress.textContent = all.length ? `${done} of ${done + all.length} scored` : "";
        // With few entries, draws after each one, otherwise after every twenty.
        if (datasets.length * trackers.length < 100 || done % 20 === 0) {
          this.draw();
        }
      }
    };
    await Promise.all([work(), work()]);
    this.draw();
  }

  rows() {
    const rows = [];
    this.about.datasets.forEach((dataset, d) =>
      this.about.trackers.forEach((tracker, t) => {
        if (tracker.has[d]) {
          rows.push({ d, t, dataset, tracker, entry: this.entries.get(`${d}/${t}`) ?? null });
        }
      }),
    );
    return rows;
  }

  draw() {
    const rows = this.rows();
    if (!rows.length) {
      const what = this.about.is_sweep ? "microsig view SWEEP RESULTS..." : "microsig view DATASET RESULT...";
      this.table.replaceChildren(el("p", { class: "note" }, `No results: list them after the ${this.about.is_sweep ? "sweep" : "dataset"}, ${what}`), this.datasets());
      return;
    }
    // A board of fields has no F1.
    const has = ({ path }) => rows.some(({ entry }) => (entry?.scores[path] ?? null) !== null);
    const columns = this.about.columns.filter(has);
    if (columns.length && !columns.some(({ path }) => path === this.score.value)) {
      this.score.value = columns[0].path;
    }
    this.drawTable(rows);
    this.drawChart(rows);
  }

  /** The cases of a sweep without results. */
  datasets() {
    const { axes, datasets } = this.about;
    return el(
      "table",
      { class: "values wide" },
      el("thead", {}, el("tr", {}, ["case", ...axes].map((name) => el("th", { scope: "col" }, name)))),
      el("tbody", {}, datasets.map((dataset, d) => el("tr", { tabindex: "0", onclick: () => this.open(d, []) }, el("td", {}, dataset.name), dataset.values.map((value) => el("td", {}, value))))),
    );
  }

  drawTable(rows) {
    const { axes, columns, is_sweep: isSweep } = this.about;
    const used = columns.filter(({ path }) => rows.some(({ entry }) => (entry?.scores[path] ?? null) !== null));
    const { by, isUp } = this.sorted;
    const key = by ?? this.score.value;
    const better = columns.find(({ path }) => path === key)?.better;
    const order = (row) => merit(better, row.entry?.scores[key] ?? null);
    const isReversed = Boolean(by && isUp);
    const sorted = [...rows].sort((a, b) => (isReversed ? order(a) - order(b) : order(b) - order(a)) || 0);
    const isAscending = (better === "smaller") !== isReversed;
    const best = Object.fromEntries(
      used.map(({ path, better }) => {
        const values = rows.map(({ entry }) => entry?.scores[path] ?? null);
        return [path, values.reduce((a, b) => (merit(better, b) > merit(better, a) ? b : a))];
      }),
    );
    const head = (path, label, unit) =>
      el("th", { scope: "col", "aria-sort": key === path ? (isAscending ? "ascending" : "descending") : "none" }, el("button", { type: "button", onclick: () => this.sortBy(path) }, unit ? `${label}, ${unitText(unit)}` : label));
    const name = ({ d, t, tracker }) => el("button", { type: "button", class: "link", onclick: () => this.open(d, [t]) }, tracker.name);
    this.table.replaceChildren(
      el(
        "table",
        { class: "values wide" },
        el(
          "thead",
          {},
          el("tr", {}, el("th", { scope: "col" }, "tracker"), isSweep ? el("th", { scope: "col" }, "case") : null, isSweep ? axes.map((axis) => el("th", { scope: "col" }, axis)) : null, used.map(({ path, label, unit }) => head(path, label, unit))),
        ),
        el(
          "tbody",
          {},
          sorted.map((row) =>
            el(
              "tr",
              {},
              el("td", { class: "name" }, name(row)),
              isSweep ? el("td", {}, row.dataset.name) : null,
              isSweep ? row.dataset.values.map((value) => el("td", {}, value)) : null,
              row.entry?.error
                ? el("td", { colspan: String(used.length || 1), class: "wrong" }, row.entry.error)
                : used.map(({ path }) => {
                    const value = row.entry?.scores[path] ?? null;
                    return el("td", { class: !isSweep && rows.length > 1 && value !== null && value === best[path] ? "best" : null, "data-score": path, "data-value": String(value) }, row.entry ? num(value, 4) : "\u2026");
                  }),
            ),
          ),
        ),
      ),
    );
  }

  sortBy(path) {
    this.sorted = { by: path, isUp: this.sorted.by === path ? !this.sorted.isUp : false };
    this.draw();
  }

  drawChart(rows) {
    if (!this.about.is_sweep) {
      return;
    }
    let axis = Number(this.axis.value);
    const position = ({ d, dataset }) => (axis < 0 ? d : dataset.numbers[axis] ?? NaN);
    if (rows.some((row) => Number.isNaN(position(row)))) {
      say(`the values of ${this.about.axes[axis]} are not numbers; the curve is drawn over cases`);
      this.axis.value = "-1";
      axis = -1;
    }
    const { value: path } = this.score;
    const column = this.about.columns.find((one) => one.path === path);
    const xs = [...new Set(rows.map(position))].sort((a, b) => a - b);
    // The mean over cases that share a value of the axis.
    const mean = (t, x) => {
      const values = rows.filter((row) => row.t === t && position(row) === x).map(({ entry }) => entry?.scores[path] ?? null).filter((value) => value !== null);
      return values.length ? values.reduce((a, b) => a + b) / values.length : null;
    };
    const { trackers, axes } = this.about;
    const others = axis < 0 ? [] : axes.filter((_, k) => k !== axis);
    this.chart.title = `${column.label} over ${axis < 0 ? "cases" : axes[axis]}${others.length ? `, mean over ${others.join(", ")}` : ""}`;
    this.chart.show({
      x: xs,
      series: trackers.map((tracker, t) => ({ label: tracker.name, values: xs.map((x) => mean(t, x)), color: seriesColors[t % seriesColors.length] })),
      axes: { x: axis < 0 ? "case" : axes[axis], left: column.unit ? `${column.label}, ${unitText(column.unit)}` : column.label },
      points: true,
      clicked: (k) => {
        const found = rows.find((row) => position(row) === xs[k]);
        this.open(found.d, trackers.map((tracker, t) => (tracker.has[found.d] ? t : -1)).filter((t) => t >= 0));
      },
    });
  }

  shownAgain() {
    this.chart.resized();
  }
}
