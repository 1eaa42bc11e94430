"""Events of an event camera under pulsed light, from a dataset of expected images: one image is one pulse.

    pip install numpy tifffile ./python
    python pulsed.py quickstart_astigmatic events.raw

writes the events (Prophesee RAW, EVT 3.0), rebuilds the light of each pulse from the times of its events, tracks the particles in it
with ``ncc``, and scores them with the truth of the dataset.

Model of a pixel: a photoreceptor whose logarithmic voltage follows the light with a low pass of first order, with a time constant
that is inversely proportional to the light (Lichtsteiner, Posch and Delbruck, IEEE J. Solid-State Circuits 43, 566, 2008); the first
ON event, when the voltage has risen by the pixel's threshold; a readout of limited rate in the order of the events. Not modeled:
readout by rows, further events of a pulse, OFF events, refractory time, noise events, drift of the thresholds.
"""

import argparse
import pathlib
import tempfile

import microsig as ms
import numpy as np
import tifffile

THRESHOLD, MISMATCH = 0.25, 0.03  # in ln(light), and its standard deviation over the pixels
DARK = 20.0  # light of the background and the dark current, counts
PULSE_S = 500e-6
TAU_S, TAU_LIGHT, SHORTEST_TAU_S = 250e-6, 120.0, 10e-6  # time constant at TAU_LIGHT counts; its least value
EVENTS_PER_S = 1e9  # read out


def latency(light, threshold):
    """Time from the start of a pulse to the first event, s; infinite without one. light: counts."""
    rise = np.log1p(np.maximum(light, 0) / DARK)
    tau = np.maximum(TAU_S * TAU_LIGHT / (np.maximum(light, 0) + DARK), SHORTEST_TAU_S)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(rise > threshold, tau * np.log(rise / (rise - threshold)), np.inf)
    return np.where(t < PULSE_S, t, np.inf)


def events(images, period_s, thresholds):
    """Times (s), pixels and pulse of all events, in the order in which they leave the sensor. images: light, counts."""
    parts = []
    for pulse, light in enumerate(images):
        t = latency(light, thresholds)
        y, x = np.nonzero(np.isfinite(t))
        parts.append((pulse * period_s + t[y, x], x, y, np.full(len(y), pulse)))
    t, x, y, pulse = (np.concatenate(column) for column in zip(*parts))
    order = np.argsort(t, kind="stable")
    t, waited = t[order], np.arange(len(order)) / EVENTS_PER_S
    # One after the other: each leaves when it has happened and the one before has left.
    return np.maximum.accumulate(t - waited) + waited, x[order], y[order], pulse[order]


def write_evt3(path, t_us, x, y, shape):
    """Prophesee RAW, EVT 3.0: 16 bit words of 4 bit type (8: upper 12 bit of the time, 6: lower, 0: row, 2: column and polarity)."""
    t_us = t_us.astype(np.int64)
    high = np.concatenate(([0], t_us >> 12))
    words = []
    for k in range(len(t_us)):
        # Every step of the upper time is written, also where nothing happens: decoders count its overflows.
        words += [0x8000 | h & 0xFFF for h in range(high[k] + (k > 0), high[k + 1] + 1)]
        if k == 0 or t_us[k] != t_us[k - 1] or y[k] != y[k - 1]:
            words += [0x6000 | t_us[k] & 0xFFF, y[k]]
        words.append(0x2800 | x[k])
    header = f"% evt 3.0\n% format EVT3;height={shape[0]};width={shape[1]}\n% geometry {shape[1]}x{shape[0]}\n% end\n"
    pathlib.Path(path).write_bytes(header.encode() + np.array(words, "<u2").tobytes())


def light_of_events(t, x, y, pulse, period_s, pulses, shape):
    """Light of each pulse from the latency of its events, counts (pulses, rows, columns); pixels without an event are dark."""
    light = np.geomspace(0.1, 1e5, 4000)
    falling = latency(light, THRESHOLD)
    seen = np.isfinite(falling)
    images = np.zeros((pulses, *shape))
    images[pulse, y, x] = np.interp(-(t - pulse * period_s), -falling[seen], light[seen])
    return np.round(images).clip(0, 65535).astype(np.uint16)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("scenario")
    arguments.add_argument("raw")
    arguments.add_argument("--pulses", type=int, default=10)
    given = arguments.parse_args()
    noiseless = {"optics.background_noise": 0, "optics.background_mean": 0, "render.mode": "expected"}
    ds = ms.generate(given.scenario, set=noiseless | {"timing.pairs.count": given.pulses // 2, "image_format": "float32"})
    shape = ds.images.shape[1:]
    thresholds = np.maximum(THRESHOLD + MISMATCH * np.random.default_rng(1).standard_normal(shape), 0.05)
    found = events(ds.images, ds.dt_s, thresholds)
    write_evt3(given.raw, np.round(found[0] * 1e6), found[1], found[2], shape)

    with tempfile.TemporaryDirectory() as folder:
        images, scan = f"{folder}/light.tif", f"{folder}/scan.tif"
        tifffile.imwrite(images, light_of_events(*found, ds.dt_s, len(ds.images), shape))
        # The calibration particle, in the middle of the sensor.
        steps = ds.calibration.images
        margins = [(0, 0)] + [((n - m) // 2, n - m - (n - m) // 2) for n, m in zip(shape, steps.shape[1:])]
        steps = np.pad(steps.astype(float), margins)
        tifffile.imwrite(scan, light_of_events(*events(steps, ds.dt_s, thresholds), ds.dt_s, len(steps), shape))
        z = f"{folder}/z.csv"
        np.savetxt(z, np.c_[np.arange(len(steps)), ds.calibration.z_um], "%g", ",", header="page,z_um", comments="")
        recording = ms.import_recording(
            images, scan, f"{folder}/recording", z=z, magnification=1, pixel_size_um=ds.um_per_px, dt_s=ds.dt_s, pairs=True
        )
        result = ms.track(recording, "ncc")
    scores = ms.evaluate(ds, result)
    print(f"{len(ds.images)} pulses, {len(found[0])} events; F1 {scores.detection.f1:.3f}, RMS z {scores.detection.rmse_z_um:.2f} um")


if __name__ == "__main__":
    main()
