"""Opens exports, images and a release with the programs they are intended for, in a separate environment, and writes README.md:

    python3 validation/exports/run.py [--out target/exports] [--imagej ij.jar]

The command is $MICROSIG, or the release build, which is built if necessary. ImageJ needs `java`, a JDK.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent.parent / "results"))
from records import built, environment  # noqa: E402

# Its displacements are nonuniform.
SCENARIO = """(
    name: "exported",
    seed: 3,
    optics: (pixel_dim_x: 256, pixel_dim_y: 192),
    motion: flow(field: lamb_oseen()),
    particles: (number: count(12)),
    timing: sequence(frames: 20, dt_s: 0.002),
)"""
FORMATS = "isbi trackpy defocustracker trackmate-spots napari flo openpiv".split()


def call(*command):
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("target/exports"))
    parser.add_argument("--imagej", metavar="ij.jar", help="open images with ImageJ too")
    options = parser.parse_args()
    microsig, python = os.environ.get("MICROSIG") or built("microsig"), environment(HERE / "requirements.txt")
    with tempfile.TemporaryDirectory() as place:
        place = Path(place)
        scenario, dataset, exports, release = place / "exported.ron", place / "dataset", place / "exports", place / "release"
        scenario.write_text(SCENARIO)
        exports.mkdir()
        call(microsig, "generate", "--quiet", scenario, "--out", dataset)
        for name in FORMATS:
            call(microsig, "export", dataset, "--format", name, "--out", exports / name)
        call(microsig, "release", "--quiet", dataset, "--out", release, "--creator", "Doe, Jane")
        table = "| what | opened with | found |\n|---|---|---|\n" + call(python, HERE / "export.py", dataset, exports, str(6.45 / 10))
        table += call(python, HERE / "release.py", release / "public")
        if options.imagej:
            images = dataset / "images"
            show = ["java", "-Djava.awt.headless=true", "-cp", options.imagej, HERE / "ImageScale.java"]
            table += call(*show, images / "frame_00000.tif", images)
    page = (HERE / "page.md").read_text().replace("{out}", str(options.out)).replace("{table}", table.rstrip())
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "README.md").write_text(page)
    print(page)


if __name__ == "__main__":
    main()
