"""Runs other programs on a microsig dataset, reads what they write in all conventions, and writes the page of those that fit.

Usage: python3 run.py MICROSIG FIXTURES PAGE"""

import itertools
import json
import subprocess
import sys
import warnings
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pivpy.io
import tifffile
import trackpy
from laptrack import LapTrack
from napari.layers import Points, Tracks
from napari_builtins.io import napari_write_points
from openpiv import pyprocess, tools, windef
from openpiv.settings import PIVSettings

HERE = Path(__file__).resolve().parent
UM_PER_PX = 0.645


def microsig(*words):
    return subprocess.run([MICROSIG, *map(str, words)], check=True, capture_output=True, text=True).stdout


def particles(folder, images, truth):
    """Files of particles: program, how it wrote the file, its name, unit of lengths, other options."""
    trackpy.quiet()
    found = trackpy.batch(images, 5, minmass=400, characterize=False, processes=1)
    # Every seventh track: small files.
    some = trackpy.link(found, 6).query("particle % 7 == 0")
    some.to_csv(folder / "trackpy.csv", index=False)
    yield "trackpy", "`batch`, `link`, `to_csv`", "trackpy.csv", "px", []
    linked, _, _ = LapTrack(cutoff=36).predict_dataframe(some[["frame", "x", "y"]], ["x", "y"], only_coordinate_cols=False)
    linked.to_csv(folder / "laptrack.csv")
    yield "laptrack", "`predict_dataframe` on trackpy's positions, `to_csv`", "laptrack.csv", "px", []
    tracks = Tracks(some[["particle", "frame", "y", "x"]].to_numpy())
    pd.DataFrame(tracks.data, columns=["track_id", "t", "y", "x"]).to_csv(folder / "napari_tracks.csv", index=False)
    yield "napari", "data of a layer of tracks by pandas", "napari_tracks.csv", "px", []
    napari_write_points(str(folder / "napari_points.csv"), Points(some[["frame", "y", "x"]].to_numpy()).data, {})
    yield "napari", "a layer of points, saved", "napari_points.csv", "px", []
    # These programs do not run in Python: true positions in their formats.
    t = truth.query("track % 30 == 0").assign(x=lambda t: (t.x_px - 1) * UM_PER_PX, y=lambda t: (t.y_px - 1) * UM_PER_PX)
    name = ["LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME,RADIUS,VISIBILITY"]
    name += ["Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame,Radius,Visibility", "Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame,R,Visibility"]
    rows = [f"ID{k},{k},{r.track},9.5,{r.x:.4f},{r.y:.4f},{r.z_um:.4f},{r.frame * 0.005},{r.frame},0.8,1" for k, r in enumerate(t.itertuples())]
    text = "\n".join([*name, ",,,(quality),(micron),(micron),(micron),(sec),,(micron),", *rows])
    (folder / "trackmate_spots.csv").write_text(text + "\n")
    yield "TrackMate", "table of spots, as its source code writes it", "trackmate_spots.csv", "um", []
    body = ""
    for _, track in t.groupby("track"):
        spots = "".join(f'    <detection t="{r.frame}" x="{r.x:.4f}" y="{r.y:.4f}" z="{r.z_um:.4f}" />\n' for r in track.itertuples())
        body += f'  <particle nSpots="{len(track)}">\n{spots}  </particle>\n'
    head = f'<Tracks nTracks="{t.track.nunique()}" spaceUnits="micron" frameInterval="0.005" timeUnits="sec" from="TrackMate v7.14.0">'
    (folder / "trackmate_tracks.xml").write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{head}\n{body}</Tracks>\n')
    yield "TrackMate", "exported tracks, as its source code writes them", "trackmate_tracks.xml", "um", []
    table = pd.DataFrame({"fr": t.frame + 1, "X": t.x_px, "Y": t.y_px, "Z": (t.z_um + 5) / 10, "DX": 0, "DY": 0, "DZ": 0, "id": t.track + 1, "cm": 0.9})
    table.to_csv(folder / "defocustracker.csv", index=False, float_format="%.4f")
    yield "DefocusTracker", "dataset as a table, as its source code defines it", "defocustracker.csv", "px", []


def fields(folder, images, dt_s):
    """Files of velocity fields, like `particles`."""
    a, b = (image.astype("int32") for image in images)
    u, v, _ = pyprocess.extended_search_area_piv(a, b, 32, 16, search_area_size=32, sig2noise_method="peak2peak")
    x, y = pyprocess.get_coordinates(a.shape, 32, 16)
    tools.save(folder / "openpiv.txt", x, y, u, v)
    yield "OpenPIV", "`extended_search_area_piv`, `get_coordinates`, `save`", "openpiv.txt", "px", []
    tools.save(folder / "openpiv_up.txt", *tools.transform_coordinates(x, y, u.copy(), v.copy()))
    yield "OpenPIV", "the same after `transform_coordinates`", "openpiv_up.txt", "px", []
    m, s = 1e-6 * UM_PER_PX, dt_s
    tools.save(folder / "openpiv_si.txt", x * m, y * m, u * m / s, v * m / s)
    yield "OpenPIV", "the same, scaled to m and m/s", "openpiv_si.txt", "m, m/s", ["--um-per-px", UM_PER_PX, "--dt", dt_s]
    settings = PIVSettings(windowsizes=(64, 32), overlap=(32, 16), num_iterations=2, sig2noise_validate=False, sig2noise_method=None)
    x, y, u, v, flags = windef.simple_multipass(*images, settings)
    tools.save(folder / "openpiv_windef.txt", x, y, u, v, flags)
    yield "OpenPIV", "`windef.simple_multipass`, `save`", "openpiv_windef.txt", "px", []
    pivpy.io.save_piv(pivpy.io.from_arrays(x, y, u, v, np.ones_like(u)), folder / "pivpy.csv", format="csv")
    yield "pivpy", "OpenPIV's arrays by `from_arrays`, `save_piv` as CSV", "pivpy.csv", "px", ["--format", "openpiv"]


def scored(dataset, path, options):
    """Share of matched particles (1 for a field) and RMS error in the image plane, px; `None` if it is refused."""
    with TemporaryDirectory() as out:
        try:
            microsig("evaluate", dataset, path, "--out", out, "--force", *options)
        except subprocess.CalledProcessError:
            return None
        score = json.loads((Path(out) / "score.json").read_text())
    if score.get("field"):
        return 1, np.hypot(score["field"]["u"]["rms_px"], score["field"]["v"]["rms_px"])
    return score["detection"]["tp"], score["detection"]["rmse_xy_px"]


def row(dataset, folder, program, how, file, unit, given):
    """The conventions in which a file fits best, and the error in the second best."""
    is_field = file.startswith(("openpiv", "pivpy"))
    choices = {"--origin": ORIGINS, "--y": ("down", "up")} | ({} if is_field else {"--frame-base": ("0", "1")})
    tried = {}
    for values in itertools.product(*choices.values()):
        score = scored(dataset, folder / file, [*given, *itertools.chain(*zip(choices, values))])
        if score and score[0]:
            tried[values] = score
    most = max(matched for matched, _ in tried.values())
    (rms, best), (second, other) = sorted((rms, key) for key, (matched, rms) in tried.items() if matched > 0.9 * most)[:2]
    # What the format has by default needs no option.
    needed = dict(zip(choices, best))
    for option in choices:
        rest = {name: value for name, value in needed.items() if name != option}
        if scored(dataset, folder / file, [*given, *itertools.chain(*rest.items())]) == tried[best]:
            needed = rest
    words = " ".join(map(str, [*given, *itertools.chain(*needed.items())]))
    read = f"`{words}`" if words else "no option"
    first = "-" if is_field else best[2]
    return f"| {program} | {how} | `{file}` | {ORIGINS[best[0]]} | {best[1]} | {unit} | {first} | {read} | {rms:.4f} | {second:.4f} (`{other[0]}`) |"


def stacks(folder, images):
    """Whether `microsig import` has the counts of stacks that tifffile writes."""
    for name, options in {"ImageJ hyperstack": {"imagej": True}, "OME-TIFF": {"ome": True}}.items():
        path, out = folder / "stack.tif", folder / "recording"
        tifffile.imwrite(path, np.stack(images), metadata={"axes": "TYX"}, **options)
        microsig("import", "--images", path, "--magnification", "10", "--pixel-size", "6.45", "--out", out, "--force")
        read = [tifffile.imread(p) for p in sorted((out / "images").iterdir())]
        assert np.array_equal(read, images), name
        yield f"| tifffile {version('tifffile')} | {name}, axes TYX | {len(read)} frames, counts equal |"


ORIGINS = {"center0": "(0, 0)", "corner0": "(0.5, 0.5)", "center1": "(1, 1)"}

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    MICROSIG, fixtures, page = (Path(p).resolve() for p in sys.argv[1:])
    fixtures.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as place:
        dataset = Path(place) / "dataset"
        microsig("generate", HERE / "scenario.ron", "--out", dataset, "--quiet")
        images = [tifffile.imread(p) for p in sorted((dataset / "images").iterdir())]
        truth = pd.read_csv(dataset / "truth/tracks.csv").query("visible == 1")
        rows = []
        for program, *rest in itertools.chain(particles(fixtures, images, truth), fields(fixtures, images, 0.005)):
            is_run = program not in ("TrackMate", "DefocusTracker")
            rows.append(row(dataset, fixtures, f"{program} {version(program)}" if is_run else program, *rest))
        text = (HERE / "page.txt").read_text()
        page.write_text(text.replace("{rows}", "\n".join(rows)).replace("{stacks}", "\n".join(stacks(Path(place), images))))
