// Color scales of counts and depth, colors of found, missed and ghost particles.

/** Colors of found, missed and ghost particles: distinguishable with any color vision, and also by shape. */
export const KINDS = [
  { name: "found", color: "#2fd3b5" },
  { name: "missed", color: "#ffb000" },
  { name: "ghost", color: "#ff5fb0" },
];

// viridis without its dark end, which dark images hide: lightness increases evenly, for any color vision and in gray.
const depthStops = ["#3e4c8a", "#2d718e", "#1f978b", "#44bf70", "#a0da39", "#fde725"];

const parsed = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));

function between(stops, share) {
  const place = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const below = Math.min(Math.floor(place), stops.length - 2);
  const [a, b] = [parsed(stops[below]), parsed(stops[below + 1])];
  return a.map((v, k) => v + (b[k] - v) * (place - below));
}

/** Color of a depth within a range. */
export function depthColor(z, [low, high]) {
  const [r, g, b] = between(depthStops, high > low ? (z - low) / (high - low) : 0.5);
  return `rgb(${r.toFixed(0)} ${g.toFixed(0)} ${b.toFixed(0)})`;
}

const maps = {
  gray: ["#000000", "#ffffff"],
  inverted: ["#ffffff", "#000000"],
  hot: ["#000000", "#7a0f0f", "#e2571e", "#ffc84a", "#ffffff"],
};

/** Names of the color maps of images. */
export const MAP_NAMES = Object.keys(maps);

/** The color of every count from 0 to 65535 as RGBA in one number, little endian. */
export function lookup(low, high, gamma, map) {
  const table = new Uint32Array(65536);
  const steps = new Uint32Array(1024);
  for (let k = 0; k < 1024; k++) {
    const [r, g, b] = between(maps[map], (k / 1023) ** gamma).map(Math.round);
    steps[k] = (255 << 24) | (b << 16) | (g << 8) | r;
  }
  const scale = 1023 / Math.max(high - low, 1e-9);
  for (let v = 0; v < 65536; v++) {
    table[v] = steps[Math.min(1023, Math.max(0, Math.round((v - low) * scale)))];
  }
  return table;
}
