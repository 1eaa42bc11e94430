// Page 2: the frames of a dataset with their truth.
// Longer than 500 lines because it contains the page together with the controls that only this page uses.

import { getCounts, getJson, isExport } from "./api.js";
import { afterRest, check, choice, el, field, num, say, unitText } from "./dom.js";
import { MAP_NAMES, depthColor } from "./colors.js";
import { Sizes, Viewer, arrow, thumbnail, usualContrast, zoomButtons } from "./viewer.js";
import { Chart, binned } from "./plots.js";

/** Maximum size of cached images, bytes. */
const KEPT_BYTES = 160e6;

/** A dataset: its facts, and its frames, loaded when needed. */
export class Source {
  constructor(number, about) {
    this.path = `dataset/${number}`;
    this.about = about;
    this.kept = new Map();
    this.truths = new Map();
    this.frames = about.exported_frames ?? Array.from({ length: about.frames }, (_, k) => k);
  }

  /** Opens a dataset by its index; null if it does not exist. */
  static async open(number) {
    const about = await getJson(`dataset/${number}`);
    return about && new Source(number, about);
  }

  /** The image of a frame. */
  counts(frame) {
    const { width, height } = this.about;
    return this.keep(this.kept, frame, KEPT_BYTES / (2 * width * height), async () => ({
      width,
      height,
      counts: await getCounts(`${this.path}/frame/${frame}`),
    }));
  }

  /** The true particles of a frame by columns; null without truth. */
  truth(frame) {
    if (!this.frames.includes(frame) && isExport) {
      return Promise.resolve(null);
    }
    return this.keep(this.truths, frame, 400, () => getJson(`${this.path}/truth/${frame}`));
  }

  keep(all, key, most, make) {
    let found = all.get(key);
    if (!found) {
      found = make();
      found.catch(() => all.delete(key));
    }
    // Least recently used entries are dropped first.
    all.delete(key);
    all.set(key, found);
    for (const old of all.keys()) {
      if (all.size <= Math.max(2, most)) {
        break;
      }
      all.delete(old);
    }
    return found;
  }

  /** Name of a frame, with its time. */
  name(frame) {
    const { are_pairs: arePairs, times_s: times, mode } = this.about;
    const time = times[frame] === undefined ? "" : `, t = ${num(times[frame], 4)} s`;
    const own = arePairs
      ? `pair ${Math.floor(frame / 2)} ${frame % 2 ? "B" : "A"}`
      : mode === "four_pulse"
        ? `burst ${Math.floor(frame / 4)} ${"ABCD"[frame % 4]}`
        : `frame ${frame}`;
    return `${own}${time}`;
  }

  /** The previous frame, if it shows the same particles. */
  before(frame) {
    const { are_pairs: arePairs, mode } = this.about;
    const each = arePairs ? 2 : mode === "four_pulse" ? 4 : Infinity;
    return frame % each === 0 ? null : frame - 1;
  }
}

/** Slider, play and steps through frames; `moved` is called with the new frame. */
export class Timeline {
  constructor(moved) {
    this.moved = moved;
    this.k = 0;
    this.slider = el("input", { type: "range", min: "0", value: "0", "aria-label": "Frame", oninput: () => this.to(Number(this.slider.value)) });
    this.playButton = el("button", { type: "button", onclick: () => this.play(!this.isPlaying), title: "Space" }, "Play");
    this.speed = choice([[2, "2 / s"], [5, "5 / s"], [10, "10 / s"], [25, "25 / s"]], 5, () => {}, "Frames per second");
    this.label = el("output", { class: "frame-name" });
    const step = (by, text, title) => el("button", { type: "button", title, "aria-label": title, onclick: () => this.to(this.k + by) }, text);
    this.element = el(
      "div",
      { class: "timeline bar" },
      step(-1, "\u2039", "Previous frame (\u2190)"),
      this.playButton,
      step(1, "\u203a", "Next frame (\u2192)"),
      this.slider,
      this.label,
      this.speed,
    );
  }

  open(source) {
    this.source = source;
    this.slider.max = String(Math.max(0, source.frames.length - 1));
    return this.to(0);
  }

  get frame() {
    return this.source.frames[this.k];
  }

  /** Goes to a frame by its number. */
  toFrame(frame) {
    const k = this.source.frames.indexOf(frame);
    return k < 0 ? say(`frame ${frame} is not in this file`, true) : this.to(k);
  }

  async to(k) {
    const { frames } = this.source;
    this.k = Math.min(Math.max(k, 0), frames.length - 1);
    this.slider.value = String(this.k);
    const name = this.source.name(this.frame);
    this.slider.setAttribute("aria-valuetext", name);
    this.label.textContent = `${name}  (${this.k + 1} of ${frames.length})`;
    await this.moved(this.frame);
  }

  async play(isOn) {
    this.isPlaying = isOn;
    this.playButton.textContent = isOn ? "Pause" : "Play";
    while (this.isPlaying) {
      const due = performance.now() + 1000 / Number(this.speed.value);
      await this.to((this.k + 1) % this.source.frames.length);
      this.played = (this.played ?? 0) + 1;
      await new Promise((done) => setTimeout(done, Math.max(0, due - performance.now())));
      if (!this.element.isConnected) {
        this.play(false);
      }
    }
  }

  key(event) {
    const steps = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10 };
    if (/^(INPUT|SELECT|TEXTAREA|BUTTON)$/.test(event.target.tagName) || event.shiftKey || event.ctrlKey) {
      return;
    }
    if (steps[event.key]) {
      this.to(this.k + steps[event.key]);
    } else if (event.key === " ") {
      this.play(!this.isPlaying);
    } else {
      return;
    }
    event.preventDefault();
  }
}

/** Controls of contrast for one or more viewers. */
export class Contrast {
  constructor(viewers) {
    this.viewers = viewers;
    const numberBox = (name) =>
      el("input", { type: "number", min: "0", max: "65535", "aria-label": name, onchange: () => this.apply() });
    const slider = (name) => el("input", { type: "range", min: "0", max: "1000", "aria-label": `${name}, slider`, oninput: () => this.slid() });
    this.low = numberBox("Black at, counts");
    this.high = numberBox("White at, counts");
    this.lowSlider = slider("Black at");
    this.highSlider = slider("White at");
    this.gamma = choice([[1, "linear"], [0.5, "square root"], [0.25, "fourth root"]], 1, () => this.apply(), "Gray scale");
    this.map = choice(MAP_NAMES.map((name) => [name, name]), "gray", () => this.apply(), "Colors");
    this.element = el(
      "fieldset",
      {},
      el("legend", {}, "Contrast"),
      el("div", { class: "row" }, field("black", this.low), this.lowSlider),
      el("div", { class: "row" }, field("white", this.high), this.highSlider),
      el("div", { class: "row" }, this.gamma, this.map, el("button", { type: "button", onclick: () => this.auto() }, "Auto")),
    );
  }

  /** Sets the contrast to the range of most pixels. */
  auto() {
    const image = this.viewers[0].image;
    if (image) {
      [this.low.value, this.high.value] = usualContrast(image.counts).map(String);
      this.apply();
    }
  }

  // Sliders have a cube-root scale, because particles are at low counts.
  slid() {
    const counts = (slider) => Math.round(65535 * (Number(slider.value) / 1000) ** 3);
    this.low.value = String(counts(this.lowSlider));
    this.high.value = String(Math.max(counts(this.highSlider), counts(this.lowSlider) + 1));
    this.apply(false);
  }

  apply(moves = true) {
    const [low, high] = [Number(this.low.value), Number(this.high.value)];
    if (moves) {
      this.lowSlider.value = String(1000 * Math.cbrt(low / 65535));
      this.highSlider.value = String(1000 * Math.cbrt(high / 65535));
    }
    this.viewers.forEach((viewer) => viewer.setContrast({ low, high, gamma: Number(this.gamma.value), map: this.map.value }));
  }
}

/** The color bar of depth with its limits. */
export function depthBar([low, high]) {
  const canvas = el("canvas", { width: 160, height: 10, "aria-hidden": "true" });
  const context = canvas.getContext("2d");
  for (let x = 0; x < 160; x++) {
    context.fillStyle = depthColor(low + ((high - low) * x) / 159, [low, high]);
    context.fillRect(x, 0, 1, 10);
  }
  return el("div", { class: "depth-bar" }, el("span", {}, num(low)), canvas, el("span", {}, `${num(high)} \u00b5m`));
}

/** The page of a dataset. */
export class DatasetPage {
  constructor() {
    this.viewer = new Viewer({
      label: "Frame with its truth",
      drawn: (context) => this.drawOver(context),
      clicked: (x, y) => this.clicked(x, y),
    });
    this.options = { circles: true, arrows: true, tails: false, ids: false, field: false, magnify: 1, tail: 10, hidden: false, plane: null };
    this.timeline = new Timeline((frame) => this.show(frame));
    this.contrast = new Contrast([this.viewer]);
    this.side = el("aside", { class: "side", "aria-label": "Overlays and particle" });
    this.facts = el("dl", { class: "facts-grid" });
    this.particle = el("div", { class: "particle", role: "status" }, el("p", { class: "note" }, "Click a particle to see its truth and its noise-free image."));
    this.levels = new Chart({ label: "Light levels of this frame", share: 0.16 });
    // Not for frames that are only skipped through.
    this.levelsLater = afterRest(200, (image) => this.showLevels(image));
    this.element = el(
      "div",
      { class: "dataset", onkeydown: (event) => this.timeline.key(event) },
      el("section", { class: "stage", "aria-label": "Frame" }, el("div", { class: "bar" }, (this.head = el("span", { class: "file" })), el("span", { class: "gap" }), zoomButtons(this.viewer)), this.viewer.element, this.timeline.element),
      this.side,
    );
    this.truth = null;
    this.past = [];
    this.selected = null;
  }

  async load(number = 0) {
    if (this.number === number) {
      return;
    }
    const source = await Source.open(number);
    if (!source) {
      return;
    }
    this.number = number;
    this.source = source;
    this.sizes = new Sizes(null);
    this.selected = null;
    const { about } = source;
    this.head.textContent = about.title && about.title !== about.name ? `${about.name}: ${about.title}` : about.name;
    this.makeSide(about);
    this.viewer.setScale(about.um_per_px);
    await this.timeline.open(source);
    this.contrast.auto();
    getJson(`${source.path}/depth`)
      .then((depth) => {
        this.sizes = new Sizes(depth);
        this.viewer.draw();
      })
      .catch((error) => say(`sizes of particle images are not available: ${error.message}`, true));
  }

  makeSide(about) {
    const set = (name) => (value) => {
      this.options[name] = value;
      this.again();
    };
    const numberBox = (name, label, least, most) =>
      el("input", { type: "number", min: String(least), max: String(most), value: String(this.options[name]), "aria-label": label, onchange: (e) => set(name)(Number(e.target.value)) });
    this.planes = el("select", { "aria-label": "Plane of the field", hidden: true, onchange: () => set("plane")(this.planes.value) });
    const rows = [
      ["Images", `${about.frames}, ${about.width} \u00d7 ${about.height} px, ${about.bits ?? "?"} bit`],
      ["In view", `${num(about.n_p)} particles, N_S ${num(about.n_s)}`],
      ["SNR", num(about.snr)],
      ["Largest displacement", `${num(about.max_displacement_px)} px`],
      ["Renderer", about.renderer ?? "\u2013"],
    ];
    this.facts.replaceChildren(...rows.flatMap(([name, value]) => [el("dt", {}, name), el("dd", {}, value)]));
    const truth = about.has_truth
      ? el(
          "fieldset",
          {},
          el("legend", {}, "Truth"),
          about.depth_um ? depthBar(about.depth_um) : null,
          el("div", { class: "row" }, check("Circles of the image's size", this.options.circles, set("circles")), check("IDs", this.options.ids, set("ids"))),
          el("div", { class: "row" }, check("Velocity", this.options.arrows, set("arrows"), "Displacement during one time step"), field("times", numberBox("magnify", "Magnification of arrows", 0.1, 1000))),
          el("div", { class: "row" }, check("Tails", this.options.tails, set("tails")), field("frames", numberBox("tail", "Length of tails", 1, 100))),
          about.has_field ? el("div", { class: "row" }, check("Field", this.options.field, (isOn) => (set("field")(isOn), this.loadField()), "truth/field.csv"), this.planes) : null,
        )
      : el("p", { class: "note" }, "The truth of this dataset is withheld.");
    this.side.replaceChildren(
      el("fieldset", {}, el("legend", {}, "Dataset"), this.facts),
      truth,
      // On a small screen the particle comes first.
      el("details", { open: window.innerHeight > 900 }, el("summary", {}, "Contrast"), this.contrast.element, this.levels.element),
      el("fieldset", {}, el("legend", {}, "Particle"), this.particle),
    );
  }

  async show(frame) {
    const wanted = (this.wanted = frame);
    try {
      const [image, truth] = await Promise.all([this.source.counts(frame), this.source.truth(frame)]);
      if (this.wanted !== wanted) {
        return;
      }
      this.truth = truth?.columns ?? null;
      this.viewer.show(image);
      this.levelsLater(image);
      await this.again();
      this.follow();
      this.ahead(frame);
    } catch (error) {
      say(error.message, true);
    }
  }

  ahead(frame) {
    if (this.timeline.isPlaying) {
      for (const next of [frame + 1, frame + 2]) {
        if (this.source.frames.includes(next)) {
          this.source.counts(next).catch(() => {});
          this.source.truth(next).catch(() => {});
        }
      }
    }
  }

  /** Loads the data for overlays and draws. */
  async again() {
    this.past = [];
    if (this.options.tails) {
      let frame = this.source.before(this.timeline.frame);
      const frames = [];
      for (let k = 0; k < this.options.tail && frame !== null; k++) {
        frames.push(frame);
        frame = this.source.before(frame);
      }
      const truths = await Promise.all(frames.map((one) => this.source.truth(one)));
      this.past = truths.filter(Boolean).map(({ columns }) => {
        const places = new Map();
        columns.track.forEach((track, i) => places.set(track, [columns.x_px[i], columns.y_px[i]]));
        return places;
      });
    }
    if (this.options.field) {
      await this.loadField();
    }
    this.viewer.draw();
  }

  async loadField() {
    this.planes.hidden = !this.options.field;
    if (!this.options.field) {
      return this.viewer.draw();
    }
    const { are_pairs: arePairs } = this.source.about;
    const pair = arePairs ? Math.floor(this.timeline.frame / 2) : this.timeline.frame;
    const field = await getJson(`${this.source.path}/field/${pair}`);
    this.field = field?.columns ?? null;
    if (this.field) {
      const planes = new Map(this.field.plane.map((plane, i) => [String(plane), this.field.z_um[i]]));
      const names = [...planes].map(([plane, z]) => [plane, `z = ${num(z)} \u00b5m`]);
      if (this.field.weighted_dx_px) {
        names.push(["weighted", "depth-weighted"]);
      }
      // The plane may be one of a dataset that was open before.
      const isThere = names.some(([value]) => value === this.options.plane);
      const had = isThere ? this.options.plane : names[Math.floor((names.length - 1) / 2)][0];
      this.planes.replaceChildren(...names.map(([value, text]) => el("option", { value }, text)));
      this.planes.value = had;
      this.options.plane = had;
    }
    this.viewer.draw();
  }

  showLevels(image) {
    if (this.timeline.isPlaying || !this.levels.element.isConnected) {
      return;
    }
    let [low, high] = [65535, 0];
    for (const count of image.counts) {
      low = Math.min(low, count);
      high = Math.max(high, count);
    }
    const [x, n] = binned(image.counts, low, high + 1, Math.min(100, Math.max(8, high - low + 1)));
    this.levels.show({ x, series: [{ label: "pixels", values: n.map((v) => v || null), color: "#5b9dff" }], axes: { x: "counts", left: "pixels" }, log: true, bars: true });
  }

  visible(i) {
    return this.truth.visible?.[i] !== 0;
  }

  drawOver(context) {
    if (!this.truth) {
      return;
    }
    const { viewer, options, truth } = this;
    const { x_px: x, y_px: y, z_um: z, u_um_s: u, v_um_s: v, track } = truth;
    const { depth_um: range, dt_s: dt, um_per_px: pixel } = this.source.about;
    const each = (dt / pixel) * options.magnify;
    context.lineWidth = 1.5;
    context.font = "11px system-ui, sans-serif";
    for (let i = 0; i < x.length; i++) {
      if (!this.visible(i)) {
        continue;
      }
      const [sx, sy] = viewer.toScreen(x[i], y[i]);
      const color = range ? depthColor(z[i], range) : "#4f9dff";
      context.strokeStyle = color;
      context.fillStyle = color;
      if (options.tails && this.past.length) {
        context.beginPath();
        context.moveTo(sx, sy);
        for (const places of this.past) {
          const place = places.get(track[i]);
          if (!place) {
            break;
          }
          context.lineTo(...viewer.toScreen(...place));
        }
        context.stroke();
      }
      if (options.circles) {
        const [rx, ry] = this.sizes.radii(z[i]);
        context.beginPath();
        context.ellipse(sx, sy, Math.max(3, rx * viewer.scale), Math.max(3, ry * viewer.scale), 0, 0, 2 * Math.PI);
        context.stroke();
      }
      if (options.arrows && u[i] !== null) {
        arrow(context, sx, sy, ...viewer.toScreen(x[i] + u[i] * each, y[i] + v[i] * each));
      }
      if (options.ids) {
        context.fillText(String(track[i]), sx + 6, sy - 6);
      }
    }
    this.drawField(context);
    this.drawSelected(context);
  }

  drawField(context) {
    const { field, options, viewer } = this;
    if (!options.field || !field) {
      return;
    }
    // Distinguishable from particle images.
    context.strokeStyle = "#ffc83d";
    context.lineWidth = 1.75;
    const isWeighted = options.plane === "weighted";
    const [plane, kind] = isWeighted ? [String(field.plane[0]), "weighted"] : [options.plane, "central"];
    const [dx, dy] = [field[`${kind}_dx_px`], field[`${kind}_dy_px`]];
    field.x_px.forEach((x, i) => {
      if (String(field.plane[i]) === plane && field.mask?.[i] !== 1 && dx[i] !== null) {
        const [sx, sy] = viewer.toScreen(x, field.y_px[i]);
        arrow(context, sx, sy, ...viewer.toScreen(x + dx[i] * options.magnify, field.y_px[i] + dy[i] * options.magnify));
      }
    });
  }

  drawSelected(context) {
    const k = this.selected === null ? -1 : this.truth.track.indexOf(this.selected);
    if (k >= 0) {
      const [sx, sy] = this.viewer.toScreen(this.truth.x_px[k], this.truth.y_px[k]);
      const [rx, ry] = this.sizes.radii(this.truth.z_um[k]);
      const half = Math.max(10, Math.max(rx, ry) * this.viewer.scale + 6);
      context.strokeStyle = "#ffffff";
      context.lineWidth = 2;
      context.setLineDash([5, 4]);
      context.strokeRect(sx - half, sy - half, 2 * half, 2 * half);
      context.setLineDash([]);
    }
  }

  clicked(x, y) {
    if (!this.truth) {
      return;
    }
    let [best, least] = [-1, Infinity];
    this.truth.x_px.forEach((own, i) => {
      const distance = Math.hypot(own - x, this.truth.y_px[i] - y);
      // A particle can be selected anywhere within its image, or within 12 screen pixels.
      const [rx, ry] = this.sizes.radii(this.truth.z_um[i]);
      const reach = Math.max(rx, ry, 12 / this.viewer.scale);
      if (this.visible(i) && distance < reach && distance < least) {
        [best, least] = [i, distance];
      }
    });
    this.selected = best < 0 ? null : this.truth.track[best];
    this.follow();
    this.viewer.draw();
  }

  /** Shows the selected particle in this frame. */
  async follow() {
    const k = this.selected === null || !this.truth ? -1 : this.truth.track.indexOf(this.selected);
    if (k < 0) {
      const text = this.selected === null ? "Click a particle to see its truth and its noise-free image." : `Particle ${this.selected} is not in this frame.`;
      return this.particle.replaceChildren(el("p", { class: "note" }, text));
    }
    const frame = this.timeline.frame;
    const cells = this.source.about.columns.filter(([name]) => name in this.truth);
    const table = el(
      "table",
      { class: "values" },
      el("caption", {}, `Particle ${this.selected}`),
      el("tbody", {}, cells.map(([name, unit, about]) => el("tr", { title: about }, el("th", { scope: "row" }, name), el("td", {}, num(this.truth[name][k], 6)), el("td", {}, unitText(unit))))),
    );
    const pictures = el("div", { class: "pictures" });
    this.particle.replaceChildren(pictures, table);
    if (this.timeline.isPlaying) {
      return;
    }
    const crop = isExport ? null : await getJson(`${this.source.path}/particle/${frame}/${k}`).catch(() => null);
    if (!crop || this.timeline.frame !== frame || !this.viewer.image) {
      return;
    }
    const { x, y, width, height } = crop;
    const { image } = this.viewer;
    const measured = new Float64Array(width * height);
    for (let row = 0; row < height; row++) {
      for (let column = 0; column < width; column++) {
        measured[row * width + column] = image.counts[(y - 1 + row) * image.width + x - 1 + column];
      }
    }
    const peak = Math.max(...crop.counts);
    const base = Math.min(...crop.counts);
    const contrast = { ...this.viewer.contrast, low: Math.max(0, base - 0.1 * (peak - base)), high: Math.max(peak, base + 1) };
    const picture = (counts, name) => {
      const canvas = el("canvas", { role: "img", "aria-label": name });
      thumbnail(canvas, { width, height, counts }, contrast);
      return el("figure", {}, canvas, el("figcaption", {}, name));
    };
    pictures.replaceChildren(picture(measured, "frame"), picture(crop.counts, "alone, noise-free"));
  }

  shownAgain() {
    this.viewer.resized();
  }
}
