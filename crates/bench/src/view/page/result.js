// Page 3: found, missed and ghost particles of trackers, one image for each result.

import { getJson } from "./api.js";
import { afterRest, check, el, field, num, say } from "./dom.js";
import { KINDS } from "./colors.js";
import { Sizes, Viewer, arrow, zoomButtons } from "./viewer.js";
import { Chart } from "./plots.js";
import { Contrast, Source, Timeline } from "./dataset.js";

/** Maximum number of results shown side by side. */
const MAX_SIDE_BY_SIDE = 4;

/** Scores in the header of a result: path in score.json, name, unit. */
const HEAD_SCORES = [
  ["detection.f1", "F1", ""],
  ["detection.recall", "recall", ""],
  ["detection.precision", "precision", ""],
  ["detection.rmse_xy_px", "RMSE xy", " px"],
  ["detection.rmse_z_um", "RMSE z", " \u00b5m"],
  ["links.f1", "links F1", ""],
  ["clear.id_switches", "switches", ""],
  ["field.aee_px", "AEE", " px"],
  ["field.valid_vector_probability", "valid", ""],
];

/** Scores without meaning for results whose points are not linked. */
const LINK_SCORES = ["links.f1", "clear.id_switches"];

/** Scores of displacement fields: name in score.json, what it is, unit. */
const FIELD_SCORES = [
  ["n_reported", "Vectors", ""],
  ["n_interpolated", "Interpolated", ""],
  ["aee_px", "Average endpoint error", " px"],
  ["epe_rms_px", "RMS endpoint error", " px"],
  ["angular_error_deg", "Angular error", "\u00b0"],
  ["outlier_fraction", "Outliers", ""],
  ["valid_vector_probability", "Valid vectors", ""],
];

/** A value of a score by its path. */
export function scoreAt(score, path) {
  return path.split(".").reduce((value, step) => value?.[step], score) ?? null;
}

/** One result beside others: its image, its scores, its list. */
class ResultPane {
  constructor(page, tracker, name) {
    Object.assign(this, { page, tracker, name });
    this.viewer = new Viewer({
      label: `Frame with the result ${name}`,
      drawn: (context) => this.drawOver(context),
      clicked: (x, y) => page.clicked(this, x, y),
      // Zoom and position are the same for all results.
      moved: () => page.aligned(this),
    });
    this.scores = el("div", { class: "scores" });
    this.legend = el("div", { class: "legend" });
    this.element = el("section", { class: "pane", "aria-label": name }, el("h2", {}, name), this.scores, this.viewer.element, this.legend);
    this.points = null;
  }

  async load(path) {
    this.path = `${path}/result/${this.tracker}`;
    this.about = await getJson(this.path);
    const { score } = this.about;
    this.scores.replaceChildren(
      ...HEAD_SCORES.filter(([own]) => scoreAt(score, own) !== null && (this.about.is_linked || !LINK_SCORES.includes(own))).map(([own, name, unit]) =>
        el("span", { "data-score": own, "data-value": String(scoreAt(score, own)), title: own }, el("b", {}, num(scoreAt(score, own), 4) + unit), ` ${name}`),
      ),
    );
    const caveats = [...(score.hints ?? []).map((hint) => hint.what), ...(score.warnings ?? [])];
    this.page.notes.append(...caveats.map((text) => el("li", {}, `${this.name}: ${text}`)));
  }

  /** The scores of a displacement field, by their names in score.json. */
  fieldScores() {
    const { field } = this.about.score;
    const rows = FIELD_SCORES.filter(([name]) => typeof field[name] === "number").flatMap(([name, text, unit]) => [
      el("dt", { title: `field.${name}` }, text),
      el("dd", { "data-score": `field.${name}`, "data-value": String(field[name]) }, num(field[name], 4) + unit),
    ]);
    return el("fieldset", {}, el("legend", {}, `Field, ${this.name}`), el("dl", { class: "facts-grid" }, rows));
  }

  async show(image, frame) {
    if (this.about.is_field) {
      const { are_pairs: arePairs } = this.page.source.about;
      this.vectors = await getJson(`${this.path}/vectors/${arePairs ? Math.floor(frame / 2) : frame}`);
      this.points = null;
    } else {
      this.points = await getJson(`${this.path}/frame/${frame}`);
    }
    this.viewer.show(image);
    const [tp, missed, ghosts] = ["tp", "fn", "fp"].map((name) => this.about[name][frame] ?? 0);
    this.legend.replaceChildren(
      ...(this.points
        ? [
            ["\u25cb", KINDS[0].color, `${tp} found`],
            ["\u25a1", KINDS[1].color, `${missed} missed`],
            ["\u2715", KINDS[2].color, `${ghosts} ghosts`],
          ].map(([mark, color, text]) => {
            const item = el("span", {}, el("i", { "aria-hidden": "true" }, mark), ` ${text}`);
            item.firstChild.style.color = color;
            return item;
          })
        : [["#5b9dff", "result"], ["#8a94a6", "truth"], [KINDS[2].color, "error, magnified"]].map(([color, text]) => {
            const item = el("span", {}, el("i", { "aria-hidden": "true" }, "\u2192"), ` ${text}`);
            item.firstChild.style.color = color;
            return item;
          })),
    );
  }

  drawOver(context) {
    if (this.points?.kind) {
      this.drawPoints(context);
    } else if (this.vectors?.x_px) {
      this.drawVectors(context);
    }
  }

  drawPoints(context) {
    const { points, viewer, page } = this;
    const { options } = page;
    // Marks stay apart in images that are shown small.
    const isSmall = viewer.scale < 1;
    context.lineWidth = isSmall ? 1.25 : 1.75;
    points.kind.forEach((kind, i) => {
      const [x, y] = [points.x_px[i], points.y_px[i]];
      const [sx, sy] = viewer.toScreen(x, y);
      if (!options.kinds[kind] || !page.isWithin(points, i)) {
        return;
      }
      const color = KINDS[kind].color;
      context.strokeStyle = color;
      const [rx, ry] = kind === 2 ? [4, 4] : page.sizes.radii(points.z_um[i] ?? 0);
      const [w, h] = [Math.max(4, rx * viewer.scale), Math.max(4, ry * viewer.scale)];
      context.beginPath();
      if (kind === 0) {
        context.ellipse(sx, sy, w, h, 0, 0, 2 * Math.PI);
      } else if (kind === 1) {
        context.rect(sx - w, sy - h, 2 * w, 2 * h);
      } else {
        const half = isSmall ? 3 : Math.min(9, 3 * viewer.scale + 1);
        context.moveTo(sx - half, sy - half);
        context.lineTo(sx + half, sy + half);
        context.moveTo(sx + half, sy - half);
        context.lineTo(sx - half, sy + half);
      }
      context.stroke();
      const at = kind === 0 ? [x + points.dx_px[i], y + points.dy_px[i]] : [x, y];
      if (options.links && points.from_x_px[i] !== null) {
        context.strokeStyle = points.is_right[i] ? "#e8eef7" : KINDS[2].color;
        context.setLineDash(points.is_right[i] ? [] : [4, 3]);
        context.beginPath();
        context.moveTo(...viewer.toScreen(points.from_x_px[i], points.from_y_px[i]));
        context.lineTo(...viewer.toScreen(...at));
        context.stroke();
        context.setLineDash([]);
      }
      if (points.is_switch[i]) {
        context.fillStyle = KINDS[2].color;
        context.font = "bold 15px system-ui, sans-serif";
        context.fillText("\u21c4", sx + 7, sy - 7);
      }
      if (kind === 0 && options.errors) {
        context.strokeStyle = "#ffffff";
        const magnified = [x + points.dx_px[i] * options.magnify, y + points.dy_px[i] * options.magnify];
        arrow(context, sx, sy, ...viewer.toScreen(...magnified));
      }
      if (page.isChosen(points, i)) {
        context.strokeStyle = "#ffffff";
        context.setLineDash([5, 4]);
        context.strokeRect(sx - w - 7, sy - h - 7, 2 * w + 14, 2 * h + 14);
        context.setLineDash([]);
      }
    });
  }

  drawVectors(context) {
    const { vectors, viewer } = this;
    const { magnify, errors } = this.page.options;
    vectors.x_px.forEach((x, i) => {
      const y = vectors.y_px[i];
      const from = viewer.toScreen(x, y);
      const draw = (color, dx, dy) => {
        if (dx !== null && dy !== null) {
          context.strokeStyle = color;
          arrow(context, ...from, ...viewer.toScreen(x + dx, y + dy));
        }
      };
      context.lineWidth = 1.5;
      draw("#ffffff", vectors.true_dx_px[i], vectors.true_dy_px[i]);
      draw("#5b9dff", vectors.dx_px[i], vectors.dy_px[i]);
      if (errors && vectors.dx_px[i] !== null && vectors.true_dx_px[i] !== null) {
        draw(KINDS[2].color, (vectors.dx_px[i] - vectors.true_dx_px[i]) * magnify, (vectors.dy_px[i] - vectors.true_dy_px[i]) * magnify);
      }
    });
  }
}

/** The page of results. */
export class ResultPage {
  constructor() {
    this.options = { kinds: [true, true, true], errors: true, links: true, magnify: 10, z: ["", ""], snr: ["", ""], overlap: ["", ""], kind: "", by: "0", switches: false };
    this.panes = [];
    this.timeline = new Timeline((frame) => this.show(frame));
    this.stage = el("div", { class: "panes" });
    this.buttons = el("span");
    this.head = el("span", { class: "file" });
    this.list = el("div", { class: "list", tabindex: "0", role: "region", "aria-label": "Points, worst first" });
    this.notes = el("ul", { class: "warnings" });
    this.counts = new Chart({ label: "F1 over frames", share: 0.15 });
    this.chosen = null;
    this.relist = afterRest(150, () => this.listWorst());
    this.side = el("aside", { class: "side", "aria-label": "Overlays, filters and lists" });
    this.element = el(
      "div",
      { class: "dataset result", onkeydown: (event) => this.timeline.key(event) },
      el("section", { class: "stage", "aria-label": "Results" }, el("div", { class: "bar" }, this.head, el("span", { class: "gap" }), this.buttons), this.stage, this.timeline.element),
      this.side,
    );
  }

  async load(number, trackers, names) {
    const key = `${number}/${trackers}`;
    if (this.key === key) {
      return;
    }
    this.key = key;
    const source = await Source.open(number);
    if (!source) {
      this.key = null;
      return say("this file does not contain the frames of this dataset", true);
    }
    this.source = source;
    this.sizes = new Sizes(null);
    this.head.textContent = this.source.about.name;
    this.notes.replaceChildren();
    this.panes = trackers.slice(0, MAX_SIDE_BY_SIDE).map((tracker) => new ResultPane(this, tracker, names[tracker]));
    if (trackers.length > this.panes.length) {
      this.notes.append(el("li", {}, `${trackers.length - this.panes.length} more results are in the leaderboard`));
    }
    this.stage.replaceChildren(el("p", { class: "note" }, "Scoring\u2026"));
    try {
      await Promise.all(this.panes.map((pane) => pane.load(this.source.path)));
    } catch (error) {
      this.stage.replaceChildren(el("p", { class: "note wrong" }, error.message));
      throw error;
    }
    this.stage.replaceChildren(...this.panes.map((pane) => pane.element));
    this.arrange();
    this.contrast = new Contrast(this.panes.map((pane) => pane.viewer));
    this.buttons.replaceChildren(zoomButtons(this.panes[0].viewer));
    this.makeSide();
    this.panes.forEach((pane) => pane.viewer.setScale(this.source.about.um_per_px));
    await this.timeline.open(this.source);
    this.contrast.auto();
    getJson(`${this.source.path}/depth`)
      .then((depth) => {
        this.sizes = new Sizes(depth);
        this.draw();
      })
      .catch(() => {});
    this.listWorst();
    this.showCounts();
  }

  /** Places two results side by side or one above the other, whichever makes the images larger. */
  arrange() {
    const { clientWidth: w, clientHeight: h } = this.stage;
    const { width, height } = this.source.about;
    const [beside, above] = [Math.min(w / 2 / width, h / height), Math.min(w / width, (h / 2 - 50) / height)];
    this.stage.dataset.panes = this.panes.length === 2 && above > beside ? "above" : String(this.panes.length);
  }

  makeSide() {
    const { options } = this;
    const set = (run) => (value) => {
      run(value);
      this.draw();
      this.relist();
    };
    const range = (name, label) => {
      const box = (k, text) =>
        el("input", { type: "number", step: "any", placeholder: text, value: options[name][k], "aria-label": `${label}, ${text}`, oninput: (e) => set((value) => (options[name][k] = value))(e.target.value) });
      return el("div", { class: "row range" }, el("span", {}, label), box(0, "min"), box(1, "max"));
    };
    const select = (name, pairs, label) => {
      const list = el("select", { "aria-label": label, onchange: () => set(() => (options[name] = list.value))() });
      list.append(...pairs.map(([value, text]) => el("option", { value }, text)));
      list.value = options[name];
      return list;
    };
    const particles = this.panes.filter((pane) => !pane.about.is_field);
    const isField = particles.length === 0;
    const magnify = el("input", { type: "number", min: "1", max: "1000", value: String(options.magnify), "aria-label": "Magnification of errors", onchange: (e) => set((v) => (options.magnify = v))(Number(e.target.value)) });
    const of = el("select", { "aria-label": "Result of the list", onchange: () => ((this.listed = Number(of.value)), this.listWorst()) });
    of.append(...particles.map((pane) => el("option", { value: String(this.panes.indexOf(pane)) }, pane.name)));
    this.listed = Math.max(0, this.panes.indexOf(particles[0]));
    const parts = [
      el(
        "fieldset",
        {},
        el("legend", {}, "Show"),
        isField
          ? null
          : el("div", { class: "row" }, KINDS.map(({ name, color }, k) => {
              const box = check(name, options.kinds[k], set((isOn) => (options.kinds[k] = isOn)));
              box.style.color = color;
              box.classList.add("kind");
              return box;
            })),
        el("div", { class: "row" }, check("Errors", options.errors, set((isOn) => (options.errors = isOn))), field("times", magnify), isField || !this.panes.some((pane) => pane.about.is_linked) ? null : check("Links", options.links, set((isOn) => (options.links = isOn)), "To the track's position in the previous frame; wrong links are dashed, switches are marked \u21c4")),
      ),
      isField ? null : el("fieldset", {}, el("legend", {}, "Filter"), range("z", "z, \u00b5m"), range("snr", "SNR"), range("overlap", "overlap")),
      isField
        ? null
        : el(
            "fieldset",
            { class: "grow" },
            el("legend", {}, "Worst first"),
            el(
              "div",
              { class: "row" },
              particles.length > 1 ? of : null,
              select("kind", [["", "all"], ["0", "found"], ["1", "missed"], ["2", "ghosts"]], "Which points"),
              select("by", [["0", "error in x, y"], ["1", "error in z"], ["2", "frame"]], "Sorted by"),
              this.panes.some((pane) => pane.about.is_linked) ? check("switches", options.switches, set((isOn) => (options.switches = isOn))) : null,
            ),
            this.list,
          ),
      ...this.panes.filter((pane) => pane.about.is_field).map((pane) => pane.fieldScores()),
      el("details", {}, el("summary", {}, "Contrast"), this.contrast.element),
      isField ? null : this.counts.element,
      this.notes,
    ];
    this.side.replaceChildren(...parts.filter(Boolean));
  }

  isWithin(points, i) {
    const within = (value, [low, high]) => value === null || value === undefined ? low === "" && high === "" : (low === "" || value >= Number(low)) && (high === "" || value <= Number(high));
    const { z, snr, overlap } = this.options;
    return within(points.z_um[i], z) && within(points.snr[i], snr) && within(points.overlap[i], overlap);
  }

  isChosen(points, i) {
    const { chosen } = this;
    return chosen && chosen.frame === points.frame[i] && chosen.truth === points.truth_row[i] && (chosen.truth !== null || chosen.result === points.result_row[i]);
  }

  draw() {
    this.panes.forEach((pane) => pane.viewer.draw());
  }

  /** Aligns the other results to the same part of the image. */
  aligned(from) {
    for (const pane of this.panes) {
      const { viewer } = pane;
      const { scale, left, upper, isFitted } = from.viewer;
      if (pane !== from && viewer.image && (viewer.scale !== scale || viewer.left !== left || viewer.upper !== upper)) {
        if (from.viewer.element.clientWidth === viewer.element.clientWidth) {
          Object.assign(viewer, { scale, left, upper, isFitted });
          viewer.draw();
        }
      }
    }
  }

  async show(frame) {
    const wanted = (this.wanted = frame);
    try {
      const image = await this.source.counts(frame);
      if (this.wanted === wanted) {
        await Promise.all(this.panes.map((pane) => pane.show(image, frame)));
      }
    } catch (error) {
      say(error.message, true);
    }
  }

  async listWorst() {
    const pane = this.panes[this.listed ?? 0];
    if (!pane || pane.about.is_field) {
      return;
    }
    const { z, snr, overlap, kind, by, switches } = this.options;
    // Digits, signs and commas only, which need no escapes.
    const range = (ends) => ends.map((end) => (end === "" ? "" : String(Number(end)))).join();
    const query = { by, z: range(z), snr: range(snr), overlap: range(overlap), switches: switches ? "1" : "0", ...(kind === "" ? {} : { kind }) };
    const found = await getJson(`${pane.path}/worst?${Object.entries(query).map((part) => part.join("=")).join("&")}`);
    const rows = found.columns;
    const n = rows.frame?.length ?? 0;
    this.list.replaceChildren(
      el("p", { class: "note" }, n < found.of ? `${n} of ${found.of} points` : `${found.of} points`),
      el(
        "table",
        { class: "values" },
        el("thead", {}, el("tr", {}, [["frame"], [""], ["\u0394xy", "error in the image plane, px"], ["\u0394z", "error in depth, \u00b5m"], ["z", "true depth, \u00b5m"], ["SNR"]].map(([name, title]) => el("th", { scope: "col", title: title ?? null }, name, title ? el("small", {}, title.split(",")[1]) : null)))),
        el(
          "tbody",
          {},
          Array.from({ length: n }, (_, i) => {
            const kind = KINDS[rows.kind[i]];
            const mark = el("td", { class: "kind" }, `${kind.name}${rows.is_switch[i] ? " \u21c4" : ""}`);
            mark.style.color = kind.color;
            const distance = rows.dx_px[i] === null ? null : Math.hypot(rows.dx_px[i], rows.dy_px[i]);
            const go = () => this.goTo(rows, i);
            const row = el(
              "tr",
              { tabindex: "0", onclick: go, onkeydown: (event) => event.key === "Enter" && go() },
              el("td", {}, String(rows.frame[i])),
              mark,
              el("td", {}, num(distance, 3)),
              el("td", {}, num(rows.dz_um[i], 3)),
              el("td", {}, num(rows.z_um[i], 3)),
              el("td", {}, num(rows.snr[i], 2)),
            );
            return row;
          }),
        ),
      ),
    );
  }

  /** Shows a point of the list in the image. */
  async goTo(rows, i) {
    this.chosen = { frame: rows.frame[i], truth: rows.truth_row[i], result: rows.result_row[i] };
    await this.timeline.toFrame(rows.frame[i]);
    const { viewer } = this.panes[this.listed ?? 0];
    viewer.center(rows.x_px[i], rows.y_px[i], Math.max(viewer.scale, 3));
  }

  clicked(pane, x, y) {
    const { points } = pane;
    if (!points) {
      return;
    }
    let [best, least] = [-1, 12 / pane.viewer.scale];
    points.kind.forEach((_, i) => {
      const distance = Math.hypot(points.x_px[i] - x, points.y_px[i] - y);
      if (distance < least) {
        [best, least] = [i, distance];
      }
    });
    this.chosen = best < 0 ? null : { frame: points.frame[best], truth: points.truth_row[best], result: points.result_row[best] };
    this.draw();
  }

  showCounts() {
    const particles = this.panes.filter((pane) => !pane.about.is_field);
    if (!particles.length) {
      return;
    }
    const frames = this.source.frames;
    const f1 = ({ about: { tp, fn, fp } }) => frames.map((k) => ((2 * (tp[k] ?? 0)) / (2 * (tp[k] ?? 0) + (fn[k] ?? 0) + (fp[k] ?? 0)) || null));
    const colors = ["#5b9dff", "#ff9a4a", "#2fd3b5", "#c58bff"];
    this.counts.show({
      x: frames,
      series: particles.map((pane, k) => ({ label: pane.name, values: f1(pane), color: colors[k] })),
      axes: { x: "frame", left: "F1" },
      points: frames.length < 60,
      clicked: (k) => this.timeline.to(k),
    });
  }

  shownAgain() {
    if (this.source) {
      this.arrange();
    }
    this.panes.forEach((pane) => pane.viewer.resized());
  }
}
