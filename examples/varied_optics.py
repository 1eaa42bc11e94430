"""A small network measures the depth of a particle on a microscope that it was not trained on.

Two networks see the same number of samples: one at the nominal numerical aperture, one at apertures drawn from a range, as the
aperture of a real objective is known to a few per cent only. Both are tested on microscopes at apertures between.

    python varied_optics.py [--batches 600] [--out curve.csv] [--plot curve.svg]

Needs PyTorch and, for the plot, matplotlib.
"""

import argparse
import csv

import microsig as ms
import numpy as np
import torch

SCENARIO = """(
    name: "one", seed: 1,
    optics: (numerical_aperture: 0.3, pixel_dim_x: 64, pixel_dim_y: 64, background_mean: 100, background_noise: 10),
    render: (mode: expected, images: single),
    motion: flow(field: uniform(velocity_um_s: (0, 0, 0))),
    particles: (number: count(1), diameter_um: constant(2)),
    boundaries: (z_um: (-30, 10)),
    timing: sequence(frames: 1),
)"""
BATCH = 64
APERTURES = (0.27, 0.33)
HELD_OUT = (0.28, 0.3, 0.32)


def tensors(batch):
    """Images scaled to their peak, and depths in units of 10 um."""
    images = batch["image"].reshape(-1, 1, 64, 64).astype(np.float32) - 100
    images /= images.max(axis=(1, 2, 3), keepdims=True)
    z = batch["particles"][:, 0, ms.PARTICLE_COLUMNS.index("z_um")].astype(np.float32)
    return torch.from_numpy(images), torch.from_numpy(z / 10)


def network():
    torch.manual_seed(1)
    layers, channels = [], 1
    for more in (8, 16, 32, 32):
        layers += [torch.nn.Conv2d(channels, more, 3, stride=2, padding=1), torch.nn.GroupNorm(4, more), torch.nn.ReLU()]
        channels = more
    return torch.nn.Sequential(*layers, torch.nn.Flatten(), torch.nn.Linear(32 * 16, 64), torch.nn.ReLU(), torch.nn.Linear(64, 1))


def tests():
    """A batch of samples of each held-out microscope."""
    held_out = {}
    for aperture in HELD_OUT:
        values = {"optics.numerical_aperture": aperture}
        held_out[aperture] = tensors(next(ms.Stream(SCENARIO, batch=256, seed=2, split="val", set=values)))
    return held_out


def rms_um(net, images, z):
    net.eval()
    with torch.no_grad():
        error = 10 * (net(images)[:, 0] - z)
    net.train()
    return float(error.square().mean().sqrt())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--batches", type=int, default=600)
    parser.add_argument("--out", default="curve.csv")
    parser.add_argument("--plot")
    options = parser.parse_args()
    held_out, rows = tests(), []
    for name, vary in ("fixed", {}), ("varied", {"optics.numerical_aperture": ms.uniform(*APERTURES)}):
        net = network()
        optimizer = torch.optim.Adam(net.parameters(), 1e-3)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=options.batches)
        stream = ms.Stream(SCENARIO, batch=BATCH, seed=1, vary=vary)
        for step in range(1, options.batches + 1):
            images, z = tensors(next(stream))
            loss = (net(images)[:, 0] - z).square().mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            if step % max(options.batches // 10, 1) == 0:
                rows += [(name, step * BATCH, aperture, rms_um(net, *test)) for aperture, test in held_out.items()]
        for aperture, test in held_out.items():
            print(f"{name:7} NA {aperture}: z RMS {rms_um(net, *test):.2f} um after {options.batches * BATCH} samples")
    with open(options.out, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["training", "samples", "numerical_aperture", "rms_z_um"])
        table.writerows((name, samples, aperture, f"{rms:.4g}") for name, samples, aperture, rms in rows)
    if options.plot:
        plot(rows, options.plot)


def plot(rows, path):
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 8, "svg.hashsalt": "microsig", "svg.fonttype": "none"})
    figure, axes = plt.subplots(figsize=(3.35, 2.7), layout="constrained")
    lines = {"fixed": ("--", "#b35900"), "varied": ("-", "#0b5ea8")}
    for name, (style, color) in lines.items():
        for aperture, marker in zip(HELD_OUT, "so^"):
            own = [(samples / 1000, rms) for kind, samples, na, rms in rows if kind == name and na == aperture]
            axes.plot(*zip(*own), style, color=color, marker=marker, markersize=3, linewidth=1, label=f"{name}, NA {aperture}")
    axes.set(xlabel="training samples, thousands", ylabel="RMS error of z, um", yscale="log")
    axes.set_yticks([2, 3, 5, 10], ["2", "3", "5", "10"])
    axes.minorticks_off()
    figure.legend(fontsize=6.5, ncols=2, loc="outside lower center", frameon=False)
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main()
