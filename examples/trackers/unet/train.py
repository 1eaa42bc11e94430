"""Trains the networks of track.py on streams of microsig and writes model.onnx or axes.onnx; takes tens of minutes on a CPU.

    python train.py [STEPS] [--axes]

Needs PyTorch, onnxscript and the package microsig. Samples have the optics of the tracks D3 and S (setting 1), 128 x 128 px and a noise of 10 to
200 counts: 1 to 48 spheres of 2 um (up to N_S 1 and somewhat beyond), or with --axes, 1 to 16 spheroids of 4 um with aspect ratios
0.25 to 5. Seeds are those of the stream, datasets of the suite are not seen.
"""

import argparse
import time

import microsig as ms
import onnx
import torch
from microsig.torch import dataset
from torch import nn

from network import AXIS, HIGH, LOW, OFFSET_PX, scaled

SCENARIO = {
    "name": "d3",
    "optics": {"preset": "setting1", "background_noise": 50},
    "motion": {"flow": {"field": {"poiseuille": {"max_speed_um_s": 1290}}}},
    "particles": {"number": {"count": 10}, "diameter_um": {"constant": 2}},
    "boundaries": {"z_um": [LOW, HIGH]},
    "timing": {"pairs": {"count": 1, "dt_s": 0.005}},
}
VARIED = {"particles.number.count": ms.integers(1, 48), "optics.background_noise": ms.log_uniform(10, 200)}
RODS_AND_DISCS = SCENARIO | {
    "name": "s",
    "particles": {"number": {"count": 5}, "diameter_um": {"constant": 4}, "spheroids": {"e_p": 3, "orientation": "random"}},
    "render": {"spheroids": "uniform"},
}
VARIED_SHAPES = VARIED | {"particles.number.count": ms.integers(1, 16), "particles.spheroids.e_p": ms.log_uniform(0.22, 5.5)}


def block(inside, out):
    return nn.Sequential(
        nn.Conv2d(inside, out, 3, padding=1, bias=False), nn.BatchNorm2d(out), nn.ReLU(),
        nn.Conv2d(out, out, 3, padding=1, bias=False), nn.BatchNorm2d(out), nn.ReLU())


class Net(nn.Module):
    """A U-Net on blocks of 2 x 2 pixels. Maps at full resolution: logit of a particle, of its depth, and of its offset in x and y; and
    with axes, the elements of n n^T."""

    def __init__(self, maps, widths=(24, 32, 48, 64)):
        super().__init__()
        self.down = nn.ModuleList([block(i, o) for i, o in zip((4, *widths), widths)])
        self.up = nn.ModuleList([block(a + b, b) for a, b in zip(widths[:0:-1], widths[-2::-1])])
        self.head = nn.Conv2d(widths[0], 4 * maps, 1)
        nn.init.constant_(self.head.bias[:4], -2.0)

    def forward(self, x):
        seen, x = [], nn.functional.pixel_unshuffle(x, 2)
        for k, layer in enumerate(self.down):
            x = layer(x if k == 0 else nn.functional.max_pool2d(x, 2))
            seen.append(x)
        for layer, skip in zip(self.up, seen[-2::-1]):
            x = layer(torch.cat([nn.functional.interpolate(x, scale_factor=2.0, mode="nearest"), skip], dim=1))
        return nn.functional.pixel_shuffle(self.head(x), 2)


def loss_of(net, batch):
    out, heat, mask = net(scaled(batch["image"], torch.asinh)), batch["heatmap"], batch["mask"]
    # Particles cover few pixels, so pixels near them have larger weights.
    place = nn.functional.binary_cross_entropy_with_logits(out[:, 0], heat, reduction="none")
    loss = (place * (1 + 20 * heat)).mean()
    last = heat.shape[-1] - 1
    x, y = batch["particles"][..., 0] - 1, batch["particles"][..., 1] - 1
    z = (batch["particles"][..., 2] - LOW) / (HIGH - LOW)
    sample = torch.arange(len(x))[:, None].expand_as(x)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            column, row = (x.round().long() + dx).clamp(0, last), (y.round().long() + dy).clamp(0, last)
            found = out[sample, 1:4, row, column].sigmoid()
            wanted = torch.stack([z, (x - column) / (2 * OFFSET_PX) + 0.5, (y - row) / (2 * OFFSET_PX) + 0.5], dim=-1)
            wrong = (found - wanted).abs().sum(-1)
            if "shapes" in batch:
                axis = batch["shapes"][..., :3]
                tensor = torch.stack([axis[..., i] * axis[..., j] for i, j in AXIS], dim=-1)
                wrong = wrong + 0.3 * (out[sample, 4:, row, column] - tensor).abs().sum(-1)
            loss = loss + (wrong * mask).sum() / mask.sum().clamp(min=1) / 9
    return loss


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("steps", nargs="?", type=int, default=3000)
    parser.add_argument("--axes", action="store_true")
    args = parser.parse_args()
    scenario, vary, maps, name = (RODS_AND_DISCS, VARIED_SHAPES, 10, "axes") if args.axes else (SCENARIO, VARIED, 4, "model")
    labels = ["heatmap", "shapes"] if args.axes else ["heatmap"]
    torch.manual_seed(0)
    torch.set_num_threads(1)
    stream = ms.Stream(scenario, batch=8, crop=(128, 128), seed=1, labels=labels, particles=96, vary=vary)
    net = Net(maps).train()
    optimizer = torch.optim.AdamW(net.parameters(), lr=3e-3, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 5e-3, total_steps=args.steps)
    began, mean = time.perf_counter(), 0.0
    for step, batch in zip(range(args.steps), torch.utils.data.DataLoader(dataset(stream), batch_size=None)):
        loss = loss_of(net, batch)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        mean += (loss.item() - mean) / min(step + 1, 100)
        if (step + 1) % 100 == 0:
            print(f"step {step + 1}: loss {mean:.4f}, {(time.perf_counter() - began) / 60:.1f} minutes", flush=True)
            torch.save(net.state_dict(), f"{name}.pt.part")
    sides = {2: torch.export.Dim("rows"), 3: torch.export.Dim("columns")}
    torch.onnx.export(net.eval(), torch.zeros(1, 1, 64, 64), f"{name}.onnx", input_names=["image"], output_names=["maps"],
                      dynamic_shapes={"x": sides}, opset_version=18, external_data=False)
    model = onnx.load(f"{name}.onnx")
    # Places in the source of each node.
    for node in model.graph.node:
        node.ClearField("metadata_props")
    onnx.save(model, f"{name}.onnx")


if __name__ == "__main__":
    main()
