"""Trains the network of track.py on a stream of microsig and writes model.onnx; takes tens of minutes on a CPU.

    python train.py [STEPS]

Needs PyTorch and the package microsig. Samples have the optics of track D3 (setting 1), 1 to 48 particles of 2 um on 128 x 128 px
(up to N_S 1 and somewhat beyond) and a noise of 10 to 200 counts; seeds are those of the stream, datasets of the suite are not seen.
"""

import sys
import time

import microsig as ms
import torch
from microsig.torch import dataset
from torch import nn

from network import HIGH, LOW, OFFSET_PX, scaled

SCENARIO = {
    "name": "d3",
    "optics": {"preset": "setting1", "background_noise": 50},
    "motion": {"flow": {"field": {"poiseuille": {"max_speed_um_s": 1290}}}},
    "particles": {"number": {"count": 10}, "diameter_um": {"constant": 2}},
    "boundaries": {"z_um": [LOW, HIGH]},
    "timing": {"pairs": {"count": 1, "dt_s": 0.005}},
}
VARIED = {"particles.number.count": ms.integers(1, 48), "optics.background_noise": ms.log_uniform(10, 200)}


def block(inside, out):
    return nn.Sequential(
        nn.Conv2d(inside, out, 3, padding=1, bias=False), nn.BatchNorm2d(out), nn.ReLU(),
        nn.Conv2d(out, out, 3, padding=1, bias=False), nn.BatchNorm2d(out), nn.ReLU())


class Net(nn.Module):
    """A U-Net on blocks of 2 x 2 pixels. Maps at full resolution: logit of a particle, of its depth, and of its offset in x and y."""

    def __init__(self, widths=(24, 32, 48, 64)):
        super().__init__()
        self.down = nn.ModuleList([block(i, o) for i, o in zip((4, *widths), widths)])
        self.up = nn.ModuleList([block(a + b, b) for a, b in zip(widths[:0:-1], widths[-2::-1])])
        self.head = nn.Conv2d(widths[0], 16, 1)
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
            found = out[sample, 1:, row, column].sigmoid()
            wanted = torch.stack([z, (x - column) / (2 * OFFSET_PX) + 0.5, (y - row) / (2 * OFFSET_PX) + 0.5], dim=-1)
            loss = loss + ((found - wanted).abs().sum(-1) * mask).sum() / mask.sum().clamp(min=1) / 9
    return loss


def main():
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 3000
    torch.manual_seed(0)
    torch.set_num_threads(1)
    stream = ms.Stream(SCENARIO, batch=8, crop=(128, 128), seed=1, labels=["heatmap"], particles=96, vary=VARIED)
    net = Net().train()
    optimizer = torch.optim.AdamW(net.parameters(), lr=3e-3, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 5e-3, total_steps=steps)
    began, mean = time.perf_counter(), 0.0
    for step, batch in zip(range(steps), torch.utils.data.DataLoader(dataset(stream), batch_size=None)):
        loss = loss_of(net, batch)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        mean += (loss.item() - mean) / min(step + 1, 100)
        if (step + 1) % 100 == 0:
            print(f"step {step + 1}: loss {mean:.4f}, {(time.perf_counter() - began) / 60:.1f} minutes", flush=True)
            torch.save(net.state_dict(), "model.pt.part")
    axes = {2: "rows", 3: "columns"}
    torch.onnx.export(net.eval(), torch.zeros(1, 1, 64, 64), "model.onnx", input_names=["image"], output_names=["maps"],
                      dynamic_axes={"image": axes, "maps": axes}, opset_version=13)


if __name__ == "__main__":
    main()
