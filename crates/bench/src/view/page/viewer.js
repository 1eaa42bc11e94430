// An image with zoom, pan, contrast, and drawings on top.
//
// Pixels are numbered from 1: pixel k covers [k - 0.5, k + 0.5), as everywhere in microsig.

import { el, num } from "./dom.js";
import { lookup } from "./colors.js";

/** Quantiles of the counts that bracket most pixels, for the initial contrast. */
export function usualContrast(counts) {
  const histogram = new Uint32Array(65536);
  for (const count of counts) {
    histogram[count]++;
  }
  const quantile = (share) => {
    let left = share * counts.length;
    for (let v = 0; v < 65536; v++) {
      left -= histogram[v];
      if (left < 0) {
        return v;
      }
    }
    return 65535;
  };
  const [low, high] = [quantile(0.02), quantile(0.997)];
  return [low, Math.max(high, low + 1)];
}

/** An image that can be zoomed and panned. */
export class Viewer {
  /**
   * `drawn(context, viewer)` draws overlays, `clicked(x, y)` is called with pixel coordinates, `moved()`
   * after zoom and pan.
   */
  constructor({ drawn = () => {}, clicked = () => {}, hovered = () => {}, moved = () => {}, label = "Image" } = {}) {
    Object.assign(this, { drawn, clicked, hovered, moved });
    this.base = el("canvas", { "aria-hidden": "true" });
    this.top = el("canvas", { "aria-hidden": "true" });
    this.readout = el("div", { class: "readout" });
    this.element = el(
      "div",
      { class: "viewer", tabindex: "0", role: "img", "aria-label": `${label}. Plus and minus zoom, arrows with shift pan, 0 fits.` },
      this.base,
      this.top,
      this.readout,
    );
    this.pixels = document.createElement("canvas");
    this.contrast = { low: 0, high: 1000, gamma: 1, map: "gray" };
    this.image = null;
    this.scale = 1;
    this.left = 0;
    this.upper = 0;
    this.isFitted = true;
    this.listen();
    new ResizeObserver(() => this.resized()).observe(this.element);
  }

  /** Shows an image; keeps the zoom if the size is unchanged. */
  show(image) {
    const isOther = !this.image || this.image.width !== image.width || this.image.height !== image.height;
    this.image = image;
    if (isOther) {
      this.pixels.width = image.width;
      this.pixels.height = image.height;
      this.isFitted = true;
      this.fit();
    }
    this.paint();
  }

  /** Sets part of the contrast. */
  setContrast(change) {
    Object.assign(this.contrast, change);
    this.paint();
  }

  paint() {
    if (!this.image) {
      return;
    }
    const { low, high, gamma, map } = this.contrast;
    const table = lookup(low, high, gamma, map);
    const context = this.pixels.getContext("2d");
    const data = context.createImageData(this.image.width, this.image.height);
    const colors = new Uint32Array(data.data.buffer);
    const counts = this.image.counts;
    for (let i = 0; i < counts.length; i++) {
      colors[i] = table[counts[i]];
    }
    context.putImageData(data, 0, 0);
    this.draw();
  }

  resized() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.element;
    for (const canvas of [this.base, this.top]) {
      canvas.width = Math.round(clientWidth * ratio);
      canvas.height = Math.round(clientHeight * ratio);
    }
    if (this.isFitted) {
      this.fit();
    }
    this.draw();
  }

  /** Fits the image into the view. */
  fit() {
    const { clientWidth, clientHeight } = this.element;
    if (!this.image || !clientWidth) {
      return;
    }
    this.isFitted = true;
    this.scale = Math.min(clientWidth / this.image.width, clientHeight / this.image.height);
    this.left = (clientWidth - this.scale * this.image.width) / 2;
    this.upper = (clientHeight - this.scale * this.image.height) / 2;
    this.changed();
  }

  /** Zooms by a factor about a point of the screen. */
  zoom(factor, x = this.element.clientWidth / 2, y = this.element.clientHeight / 2) {
    const scale = Math.min(Math.max(this.scale * factor, 0.02), 80);
    const by = scale / this.scale;
    this.left = x - (x - this.left) * by;
    this.upper = y - (y - this.upper) * by;
    this.scale = scale;
    this.isFitted = false;
    this.changed();
  }

  /** Brings a pixel to the middle. */
  center(x, y, scale = this.scale) {
    this.scale = scale;
    this.left = this.element.clientWidth / 2 - (x - 0.5) * scale;
    this.upper = this.element.clientHeight / 2 - (y - 0.5) * scale;
    this.isFitted = false;
    this.changed();
  }

  /** After a new zoom or place. */
  changed() {
    this.moved();
    this.draw();
  }

  /** Screen position of a pixel coordinate, in CSS pixels. */
  toScreen(x, y) {
    const [left, upper] = this.corner();
    return [left + (x - 0.5) * this.scale, upper + (y - 0.5) * this.scale];
  }

  /** The pixel coordinate of a point of the screen. */
  toImage(x, y) {
    const [left, upper] = this.corner();
    return [(x - left) / this.scale + 0.5, (y - upper) / this.scale + 0.5];
  }

  /** The image's corner, rounded to a pixel of the screen. */
  corner() {
    const ratio = window.devicePixelRatio || 1;
    return [Math.round(this.left * ratio) / ratio, Math.round(this.upper * ratio) / ratio];
  }

  draw() {
    if (!this.image || this.isDrawing) {
      return;
    }
    this.isDrawing = true;
    requestAnimationFrame(() => {
      this.isDrawing = false;
      this.drawNow();
    });
  }

  drawNow() {
    const ratio = window.devicePixelRatio || 1;
    const [left, upper] = this.corner();
    const context = this.base.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.base.width, this.base.height);
    context.imageSmoothingEnabled = this.scale * ratio < 1;
    context.imageSmoothingQuality = "high";
    const { width, height } = this.image;
    context.drawImage(this.pixels, left * ratio, upper * ratio, width * this.scale * ratio, height * this.scale * ratio);
    const top = this.top.getContext("2d");
    top.setTransform(1, 0, 0, 1, 0, 0);
    top.clearRect(0, 0, this.top.width, this.top.height);
    top.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.drawn(top, this);
    this.drawScaleBar(top);
  }

  /** Sets the pixel size, um; 0 hides the scale bar. */
  setScale(umPerPx) {
    this.umPerPx = umPerPx;
    this.draw();
  }

  drawScaleBar(context) {
    if (!this.umPerPx) {
      return;
    }
    const perUm = this.scale / this.umPerPx;
    const steps = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
    const um = steps.find((step) => step * perUm > 70) ?? 5000;
    const [right, bottom] = [this.element.clientWidth - 14, this.element.clientHeight - 14];
    const length = um * perUm;
    context.fillStyle = "rgb(0 0 0 / 55%)";
    context.fillRect(right - length - 10, bottom - 22, length + 18, 30);
    context.fillStyle = "#fff";
    context.fillRect(right - length, bottom, length, 3);
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(`${um} \u00b5m`, right - length / 2, bottom - 6);
    context.textAlign = "start";
  }

  listen() {
    let from = null;
    let moved = 0;
    const at = (event) => {
      const box = this.element.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    this.element.addEventListener("pointerdown", (event) => {
      if (event.button === 0) {
        from = at(event);
        moved = 0;
        this.element.setPointerCapture(event.pointerId);
      }
    });
    this.element.addEventListener("pointermove", (event) => {
      const [x, y] = at(event);
      if (from) {
        moved += Math.abs(x - from[0]) + Math.abs(y - from[1]);
        this.left += x - from[0];
        this.upper += y - from[1];
        from = [x, y];
        this.isFitted = this.isFitted && moved < 4;
        this.changed();
      }
      this.showReadout(...this.toImage(x, y));
    });
    this.element.addEventListener("pointerup", (event) => {
      if (from && moved < 4) {
        this.clicked(...this.toImage(...at(event)));
      }
      from = null;
    });
    this.element.addEventListener("pointerleave", () => {
      this.readout.textContent = "";
    });
    this.element.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.zoom(Math.exp(-event.deltaY * (event.deltaMode === 1 ? 0.05 : 0.0015)), ...at(event));
      },
      { passive: false },
    );
    this.element.addEventListener("keydown", (event) => {
      const step = 60;
      const pans = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
      if (event.key === "+" || event.key === "=") {
        this.zoom(1.25);
      } else if (event.key === "-") {
        this.zoom(0.8);
      } else if (event.key === "0") {
        this.fit();
      } else if (event.shiftKey && pans[event.key]) {
        this.left += pans[event.key][0];
        this.upper += pans[event.key][1];
        this.isFitted = false;
        this.changed();
        event.stopPropagation();
      } else {
        return;
      }
      event.preventDefault();
    });
  }

  showReadout(x, y) {
    const [column, row] = [Math.round(x), Math.round(y)];
    const { width, height, counts } = this.image ?? { width: 0, height: 0 };
    const isInside = column >= 1 && column <= width && row >= 1 && row <= height;
    this.readout.textContent = isInside
      ? `x ${num(x, 5)}  y ${num(y, 5)} px   ${counts[(row - 1) * width + column - 1]} counts`
      : "";
    this.hovered(x, y);
  }
}

/** Radii of particle images over depth: half their width along x and y. */
export class Sizes {
  constructor(depth) {
    this.depth = depth;
  }

  radii(z) {
    if (!this.depth) {
      return [4, 4];
    }
    const { z_um: zs, width_x_px: x, width_y_px: y } = this.depth;
    const last = zs.length - 1;
    const place = Math.min(Math.max(((z - zs[0]) / (zs[last] - zs[0] || 1)) * last, 0), last);
    const below = Math.min(Math.floor(place), Math.max(0, last - 1));
    const at = (values) => values[below] + ((values[below + 1] ?? values[below]) - values[below]) * (place - below);
    return [Math.max(1, at(x) / 2), Math.max(1, at(y) / 2)];
  }
}

/** Buttons that zoom. */
export function zoomButtons(viewer) {
  const button = (text, title, run) => el("button", { type: "button", title, "aria-label": title, onclick: run }, text);
  return el(
    "span",
    { class: "buttons" },
    button("\u2212", "Zoom out (-)", () => viewer.zoom(1 / 1.5)),
    button("+", "Zoom in (+)", () => viewer.zoom(1.5)),
    button("Fit", "Whole image (0)", () => viewer.fit()),
    button("1:1", "One image pixel per screen pixel", () => {
      const [x, y] = viewer.toImage(viewer.element.clientWidth / 2, viewer.element.clientHeight / 2);
      viewer.center(x, y, 1 / (window.devicePixelRatio || 1));
    }),
  );
}

/** Draws an arrow. */
export function arrow(context, x, y, toX, toY) {
  const length = Math.hypot(toX - x, toY - y);
  if (length < 1) {
    return;
  }
  const head = Math.min(7, length * 0.4);
  const angle = Math.atan2(toY - y, toX - x);
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(toX, toY);
  for (const side of [-0.5, 0.5]) {
    context.moveTo(toX, toY);
    context.lineTo(toX - head * Math.cos(angle + side), toY - head * Math.sin(angle + side));
  }
  context.stroke();
}

/** Draws floating-point or integer counts into a small canvas of the given size. */
export function thumbnail(canvas, { width, height, counts }, contrast) {
  const { low, high, gamma, map } = contrast;
  const table = lookup(low, high, gamma, map);
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d");
  const data = context.createImageData(width, height);
  const colors = new Uint32Array(data.data.buffer);
  for (let i = 0; i < colors.length; i++) {
    colors[i] = table[Math.min(65535, Math.max(0, Math.round(counts[i])))];
  }
  context.putImageData(data, 0, 0);
}
