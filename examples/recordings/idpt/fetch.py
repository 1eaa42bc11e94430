"""Fetches a real recording and its calibration scan, and imports them.

    python fetch.py OUT

needs git, `microsig` on the PATH, numpy and tifffile. Images: S. MacKenzie, github.com/sean-mackenzie/idpt (MIT license), of
Meas. Sci. Technol. 36 (2025) 056005. The commit's hash is a checksum of all files.
"""

import argparse
import csv
import subprocess
from pathlib import Path

import tifffile

REPOSITORY = "https://github.com/sean-mackenzie/idpt"
COMMIT = "cc415136d573d4f71c0f4e564e7f601c28e8f94a"
IMAGES = "publication/images"
CALIBRATION = "calibration/1umSteps/calib_{}.tif"
TEST = "tests/3X_5umSteps/test_{:02}.tif"

# Heights: settings and alignment of the repository's own evaluation (`publication/settings.py`, `compare_idpt_gdpt.py`).
CALIBRATION_FOCUS_UM = 49.6  # plane K of the scan is at K um; there the calibration particle is in focus
TEST_FOCUS_UM = 68.1  # the same of the test images, which are at 5, 10, 15 um, ..., three frames each
STEP_UM, FRAMES = 5.0, 3
DEPTHS_UM = (-50.0, 55.0)  # heights that the publication evaluates


def fetch(folder, repository):
    """The images at the commit, without the rest of the repository."""
    git = lambda *arguments: subprocess.run(["git", "-C", folder, *arguments], check=True, capture_output=True, text=True).stdout
    if not (folder / ".git").exists():
        folder.mkdir(parents=True)
        git("init", "--quiet")
        git("remote", "add", "origin", repository)
        git("sparse-checkout", "set", "--no-cone", f"/{IMAGES}/", "/LICENSE")
    git("fetch", "--quiet", "--depth", "1", "--filter=blob:none", "origin", COMMIT)
    git("checkout", "--quiet", "--force", "FETCH_HEAD")
    assert git("rev-parse", "HEAD").strip() == COMMIT
    assert not git("status", "--porcelain"), "files differ from those of the commit"


def numbered(images, pattern):
    """Files of a pattern and their numbers, in order."""
    files = [(k, images / pattern.format(k)) for k in range(200)]
    return [(k, file) for k, file in files if file.exists()]


def rows(file, header, table):
    with open(file, "w", newline="") as out:
        csv.writer(out).writerows([header, *table])


def prepare(source, out):
    """The scan as one file, and tables of the heights; the frames of the recording."""
    images = source / IMAGES
    heights = []
    with tifffile.TiffWriter(out / "scan.tif") as scan:
        for plane, file in numbered(images, CALIBRATION):
            pages = tifffile.imread(file)
            for page in pages.reshape(-1, *pages.shape[-2:]):
                scan.write(page, photometric="minisblack", contiguous=True)
                heights.append(round(plane - CALIBRATION_FOCUS_UM, 1))
    rows(out / "z.csv", ["page", "z_um"], enumerate(heights))
    frames = [(file, round(STEP_UM * (k // FRAMES + 1) - TEST_FOCUS_UM, 1)) for k, file in numbered(images, TEST)]
    frames = [(file, z) for file, z in frames if DEPTHS_UM[0] <= z <= DEPTHS_UM[1]]
    rows(out / "planes.csv", ["frame", "z_um"], ((k, z) for k, (_, z) in enumerate(frames)))
    return [file for file, _ in frames]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--repository", default=REPOSITORY, help="a copy of the repository")
    args = parser.parse_args()
    fetch(args.out / "source", args.repository)
    frames = prepare(args.out / "source", args.out)
    subprocess.run(["microsig", "import", "--images", *frames, "--scan", args.out / "scan.tif", "--z", args.out / "z.csv",
                    "--magnification", "10.01", "--pixel-size", "16", "--field", "3", "--truth", args.out / "planes.csv",
                    "--out", args.out / "recording", "--force"], check=True)


if __name__ == "__main__":
    main()
