// Page 1: the text of a scenario beside a preview of its dataset.

import { getJson, previewParts, saveScenario } from "./api.js";
import { afterRest, byteSize, check, choice, duration, el, lastPart, num, say } from "./dom.js";
import { KINDS, depthColor } from "./colors.js";
import { Sizes, Viewer, arrow, thumbnail, usualContrast, zoomButtons } from "./viewer.js";
import { Chart, binned } from "./plots.js";
import { Editor } from "./editor.js";

/** Milliseconds without typing after which a preview starts. */
const REST_MS = 120;

/** The page of the scenario. */
export class ScenarioPage {
  constructor() {
    this.start = afterRest(REST_MS, () => this.preview());
    this.frames = [];
    this.shown = 0;
    this.sizes = new Sizes(null);
    this.overlay = true;
    this.editor = new Editor(() => {
      // At once, so that no part of the former preview can follow and enable Stop while the next preview waits.
      this.running?.abort();
      this.state("waiting", "\u2026");
      this.start();
    });
    this.makePreview();
    this.status = el("span", { class: "state", role: "status" });
    this.presets = el("select", { "aria-label": "Start from", onchange: () => this.begin() });
    this.saveButton = el("button", { type: "button", onclick: () => this.save(), title: "Ctrl+S" }, "Save");
    this.stopButton = el("button", { type: "button", onclick: () => this.stop(), disabled: true }, "Stop");
    this.name = el("span", { class: "file" });
    this.element = el(
      "div",
      { class: "scenario split" },
      el(
        "section",
        { "aria-label": "Scenario" },
        el("div", { class: "bar" }, this.name, this.presets, el("span", { class: "gap" }), this.saveButton),
        this.editor.element,
      ),
      el("section", { "aria-label": "Preview" }, this.previewElement),
    );
    this.element.addEventListener("keydown", (event) => {
      if (event.key.toLowerCase() === "s" && (event.ctrlKey || event.metaKey)) {
        event.preventDefault();
        this.save();
      }
    });
    this.toolbar.prepend(this.status, this.stopButton);
  }

  makePreview() {
    this.viewer = new Viewer({ label: "Frame of the preview", drawn: (context) => this.drawOver(context) });
    this.buttons = ["A", "B"].map((name, k) =>
      el("button", { type: "button", "aria-pressed": "false", onclick: () => this.showFrame(k) }, name),
    );
    this.blink = check("Blink", false, (isOn) => this.blinking(isOn), "Frames A and B alternating, 4 per second");
    this.toolbar = el(
      "div",
      { class: "bar" },
      el("span", { class: "gap" }),
      el("span", { class: "buttons", role: "group", "aria-label": "Frame" }, this.buttons),
      this.blink,
      check("Truth", true, (isOn) => ((this.overlay = isOn), this.viewer.draw()), "Particles by depth, with velocities"),
      choice([[1, "linear"], [0.5, "\u221a counts"]], 1, (gamma) => this.setGamma(Number(gamma)), "Gray scale"),
      zoomButtons(this.viewer),
    );
    this.facts = el("dl", { class: "facts-grid", "aria-label": "Numbers of the dataset" });
    this.strip = el("div", { class: "strip", role: "img", "aria-label": "One particle over depth" });
    this.depthChart = new Chart({ label: "One particle over depth: peak and width", share: 0.2 });
    this.levels = new Chart({ label: "Light levels of the frame", share: 0.2 });
    this.levelsText = el("p", { class: "note" });
    this.stripText = el("p", { class: "note" });
    this.warnings = el("ul", { class: "warnings" });
    this.previewElement = el(
      "div",
      { class: "preview" },
      this.toolbar,
      el("div", { class: "first" }, this.viewer.element, el("div", { class: "beside" }, this.facts, this.warnings)),
      el("figure", { class: "chart" }, el("figcaption", {}, "One particle over depth, noise-free"), this.strip, this.stripText),
      el("div", { class: "two" }, this.depthChart.element, el("div", {}, this.levels.element, this.levelsText)),
    );
  }

  /** Loads the scenario that the page was opened with. */
  async load() {
    const about = await getJson("scenario");
    this.presetList = about.presets;
    this.name.textContent = about.may_save && !about.exists ? `${lastPart(about.name)} (new)` : lastPart(about.name);
    this.name.title = about.name;
    this.saveButton.disabled = !about.may_save;
    this.saveButton.title = about.may_save ? "Ctrl+S" : "Open the page with `microsig view FILE.ron` to save";
    this.presets.append(
      el("option", { value: "" }, "Start from\u2026"),
      ...about.presets.map((preset, k) => el("option", { value: String(k), title: preset.question }, preset.name)),
    );
    this.saved = about.exists ? about.text : null;
    this.editor.text = about.text;
    this.editor.explain();
  }

  begin() {
    const preset = this.presetList[Number(this.presets.value)];
    if (preset && this.presets.value !== "") {
      this.editor.area.focus();
      this.editor.area.select();
      // Inserted as if typed, so that undo restores the former text.
      if (!document.execCommand("insertText", false, preset.text)) {
        this.editor.text = preset.text;
      }
      this.editor.area.setSelectionRange(0, 0);
      this.editor.area.scrollTop = 0;
      this.editor.close();
    }
    this.presets.value = "";
  }

  async save() {
    if (this.saveButton.disabled) {
      return say(this.saveButton.title, true);
    }
    try {
      const text = this.editor.text;
      await saveScenario(text);
      this.saved = text;
      this.name.textContent = lastPart(this.name.title);
      say("Saved.");
      setTimeout(() => say(""), 2000);
    } catch (error) {
      say(error.message, true);
    }
  }

  state(kind, text) {
    this.status.className = `state ${kind}`;
    this.status.textContent = text;
    this.stopButton.disabled = kind !== "busy";
  }

  stop() {
    this.running?.abort();
    this.state("", "stopped");
  }

  async preview() {
    const running = new AbortController();
    this.running = running;
    const began = performance.now();
    this.state("busy", "reading\u2026");
    try {
      for await (const [part, block] of previewParts(this.editor.text, running.signal)) {
        if (running.signal.aborted) {
          return;
        }
        this.take(part, block, performance.now() - began);
      }
    } catch (error) {
      if (!running.signal.aborted) {
        this.state("wrong", error.message);
      }
    }
  }

  take(part, block, ms) {
    const next = { checked: "rendering frames\u2026", frame: "one particle over depth\u2026", depth: "numbers\u2026" };
    if (next[part.part]) {
      this.state("busy", next[part.part]);
    }
    if (part.part === "problems") {
      this.hasProblems = true;
      this.editor.showProblems(part.problems);
      this.state("wrong", part.problems.length === 1 ? "1 problem" : `${part.problems.length} problems`);
      this.element.classList.add("stale");
    } else if (part.part === "checked") {
      this.hasProblems = false;
      this.editor.showProblems([]);
      this.element.classList.remove("stale");
      this.about = part.about;
      this.fresh = [];
      this.facts.replaceChildren(...this.known(part));
      this.warnings.replaceChildren(
        ...[...part.warnings, ...(part.too_large ? [part.too_large] : [])].map((text) => el("li", {}, text)),
      );
    } else if (part.part === "frame") {
      this.takeFrame(part, block);
    } else if (part.part === "depth") {
      this.showDepth(part, new Float32Array(block));
    } else if (part.part === "numbers") {
      this.showNumbers(part);
    } else if (part.part === "failed") {
      this.state("wrong", part.message);
    } else if (part.part === "end" && !this.hasProblems) {
      this.state("ready", `preview in ${duration(ms / 1000)}`);
      this.element.dataset.preview = String(Number(this.element.dataset.preview ?? 0) + 1);
      this.element.dataset.ms = String(Math.round(ms));
    }
  }

  takeFrame(part, block) {
    const frame = { ...part, counts: new Uint16Array(block) };
    this.fresh.push(frame);
    if (this.fresh.length === 1) {
      this.frames = this.fresh;
      const [low, high] = usualContrast(frame.counts);
      Object.assign(this.viewer.contrast, { low, high });
      this.viewer.setScale(this.about.um_per_px);
      this.showFrame(0);
      this.showLevels(frame);
    } else if (this.shown === 1) {
      this.showFrame(1);
    }
    this.buttons.forEach((button, k) => (button.disabled = k >= this.fresh.length));
    if (part.share < 1) {
      this.warnings.append(
        el("li", {}, `frame ${part.index}: only the first ${num(100 * part.share, 2)} % of its particles are rendered; all would take ${duration(part.seconds)}`),
      );
    }
  }

  showFrame(k) {
    if (!this.frames[k]) {
      return;
    }
    this.shown = k;
    this.viewer.show(this.frames[k]);
    this.buttons.forEach((button, i) => button.setAttribute("aria-pressed", String(i === k)));
  }

  blinking(isOn) {
    clearInterval(this.timer);
    if (isOn) {
      this.timer = setInterval(() => this.showFrame(1 - this.shown), 250);
    }
  }

  setGamma(gamma) {
    this.viewer.setContrast({ gamma });
    this.showStrip();
  }

  drawOver(context) {
    const frame = this.frames[this.shown];
    if (!this.overlay || !frame || !this.about) {
      return;
    }
    const { x_px: x, y_px: y, z_um: z, u_um_s: u, v_um_s: v } = frame.particles;
    const perFrame = this.about.dt_s / this.about.um_per_px;
    context.lineWidth = 1.5;
    for (let i = 0; i < x.length; i++) {
      const [sx, sy] = this.viewer.toScreen(x[i], y[i]);
      context.strokeStyle = depthColor(z[i], this.about.depth_um);
      const [rx, ry] = this.sizes.radii(z[i]);
      context.beginPath();
      context.ellipse(sx, sy, Math.max(3, rx * this.viewer.scale), Math.max(3, ry * this.viewer.scale), 0, 0, 2 * Math.PI);
      context.stroke();
      if (u[i] !== null) {
        arrow(context, sx, sy, ...this.viewer.toScreen(x[i] + u[i] * perFrame, y[i] + v[i] * perFrame));
      }
    }
  }

  row(name, value, hint) {
    return [el("dt", { title: hint ?? null }, name), el("dd", {}, value)];
  }

  known({ about, cost }) {
    this.cost = cost;
    return [
      ...this.row("Images", `${about.frames} (${about.are_pairs ? `${about.frames / 2} pairs` : about.mode.replace("_", " ")}), ${about.renderer}`),
      ...this.row("Sensor", `${about.width} \u00d7 ${about.height} px of ${num(about.um_per_px)} \u00b5m, ${about.bits} bit`),
      ...this.row("Depth", `${num(about.depth_um[0])} to ${num(about.depth_um[1])} \u00b5m`),
    ];
  }

  showNumbers(part) {
    const { numbers } = part;
    this.warnings.append(...part.warnings.map((text) => el("li", {}, text)));
    const [least, median, most] = numbers.displacement_px;
    const depth = numbers.displacement_um;
    this.facts.append(
      ...this.row("In view", `${num(numbers.n_p)} particles`, `${num(numbers.n_ppp, 2)} per pixel`),
      ...this.row("N_S", num(numbers.n_s), "Source density: particles in view times the area of a particle image over that of the sensor"),
      ...this.row("SNR", num(part.snr), "Median over depth: peak of a particle over the standard deviation of the background"),
      ...this.row("Displacement A to B", most === null ? "\u2013" : `${num(least, 2)} to ${num(most, 2)}, median ${num(median, 2)} px`, "Displacement in the image plane from the first frame to the second: minimum, maximum, median"),
      ...this.row("along z", depth === null ? "\u2013" : depth[0] === depth[1] ? `${num(depth[0], 2)} \u00b5m` : `${num(depth[0], 2)} to ${num(depth[1], 2)} \u00b5m`),
      ...this.row("Best focus", part.focus_um === null ? "all depths" : `z = ${num(part.focus_um)} \u00b5m`),
      ...this.row("Full dataset", `about ${duration(part.seconds)}, ${byteSize(part.bytes)}`, "Time on this machine, estimated from the frames of this preview; estimated size"),
    );
    this.showLevels(this.frames[0], part);
  }

  showLevels(frame, part) {
    const end = this.about.saturation_counts;
    let [low, high, saturated] = [65535, 0, 0];
    for (const count of frame.counts) {
      low = Math.min(low, count);
      high = Math.max(high, count);
      saturated += count >= Math.floor(end);
    }
    const bins = Math.min(120, Math.max(8, high - low + 1));
    const [x, n] = binned(frame.counts, low, high + 1, bins);
    const marks = [];
    if (part) {
      marks.push({ x: part.background_counts, label: "background" });
    }
    if (end <= high * 1.5) {
      marks.push({ x: end, label: "saturation" });
    }
    this.levels.show({
      x,
      series: [{ label: "pixels", values: n.map((v) => v || null), color: KINDS[0].color }],
      axes: { x: "counts", left: "pixels" },
      log: true,
      bars: true,
      marks,
    });
    const noise = part ? `, background ${num(part.background_counts)} \u00b1 ${num(part.background_noise_counts)}` : "";
    this.levelsText.textContent =
      `brightest pixel ${high} of ${num(end, 5)} counts (${num((100 * high) / end, 3)} % of full well or scale)${noise}, ` +
      `${saturated ? num((100 * saturated) / frame.counts.length, 2) : "0"} % of pixels saturated`;
  }

  showDepth({ curves, strip }, values) {
    this.stripGiven = { strip, values };
    this.sizes = new Sizes(curves);
    this.viewer.draw();
    this.showStrip();
    const marks = curves.focus_um === null ? [] : [{ x: curves.focus_um, label: "best focus" }];
    this.depthChart.show({
      x: curves.z_um,
      series: [
        { label: "peak, counts", values: curves.peak_counts, color: KINDS[0].color },
        { label: "width x, px", values: curves.width_x_px, color: "#5b9dff", axis: "right" },
        { label: "width y, px", values: curves.width_y_px, color: "#ff9a4a", axis: "right", dash: [6, 6] },
      ],
      axes: { x: "z, \u00b5m", left: "peak, counts", right: "width at 10 %, px" },
      marks,
    });
    this.stripText.textContent = `sphere of ${num(curves.d_um)} \u00b5m, each image in its own gray scale; side ${strip.side} px`;
  }

  showStrip() {
    if (!this.stripGiven) {
      return;
    }
    const { strip, values } = this.stripGiven;
    const { side } = strip;
    const { gamma, map } = this.viewer.contrast;
    this.strip.replaceChildren(
      ...strip.z_um.map((z, k) => {
        const counts = values.subarray(k * side * side, (k + 1) * side * side);
        let peak = 1e-9;
        for (const value of counts) {
          peak = Math.max(peak, value);
        }
        const canvas = el("canvas", { "aria-hidden": "true" });
        const scaled = counts.map((value) => (value / peak) * 60000);
        thumbnail(canvas, { width: side, height: side, counts: scaled }, { low: 0, high: 60000, gamma, map });
        return el("div", {}, canvas, el("span", {}, num(z, 3)));
      }),
      el("div", { class: "unit" }, "z, \u00b5m"),
    );
  }

  shownAgain() {
    this.viewer.resized();
  }
}
