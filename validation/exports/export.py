"""Opens the exported files and images of a dataset with the programs they are intended for; prints a table row for each."""

import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pandas as pd

dataset, exports = Path(sys.argv[1]), Path(sys.argv[2])
um_per_px = float(sys.argv[3])
truth = pd.read_csv(dataset / "truth" / "tracks.csv")
truth = truth[truth.visible == 1]


def row(what, tool, found):
    print(f"| {what} | {tool} | {found} |", flush=True)


def same(found, expected, most=1e-9):
    found, expected = np.sort(np.asarray(found, float)), np.sort(np.asarray(expected, float))
    assert found.shape == expected.shape, (found.shape, expected.shape)
    assert np.abs(found - expected).max() < most, np.abs(found - expected).max()


def images():
    import tifffile

    path = sorted((dataset / "images").glob("*.tif"))[0]
    with tifffile.TiffFile(path) as tif:
        assert tif.is_imagej
        tags = tif.imagej_metadata
        resolution = tif.pages[0].get_resolution()[0]
    assert tags["unit"] == "um" and abs(1 / resolution - um_per_px) < 1e-9
    found = f"ImageJ metadata {dict(tags)}, {1 / resolution:.6g} um per px"
    row("an image", f"tifffile {tifffile.__version__}", found)


def trackpy():
    import trackpy as tp

    tp.quiet()
    tracks = pd.read_csv(exports / "trackpy")
    same(tracks.x + 1, truth.x_px)
    msd = tp.imsd(tracks, mpp=um_per_px, fps=1 / 0.002, max_lagtime=4)
    drift = tp.compute_drift(tracks)
    linked = tp.link(tracks.drop(columns="particle"), search_range=6, pos_columns=["x", "y"])
    row("trackpy", f"trackpy {tp.__version__}: imsd, compute_drift, link", f"{tracks.particle.nunique()} tracks; imsd of lag 1 "
        f"{np.nanmean(msd.iloc[0]):.4g} um^2; drift over {len(drift)} frames; linked anew: {linked.particle.nunique()} tracks")


def defocustracker():
    table = pd.read_csv(exports / "defocustracker")
    assert list(table.columns) == ["fr", "X", "Y", "Z", "DX", "DY", "DZ", "id", "cm"]
    same(table.X, truth.x_px)
    assert table.Z.between(0, 1).all() and table.id.min() >= 1
    step = table[table.id == table.id.min()].sort_values("fr")
    same(step.DX.iloc[:-1], np.diff(step.X))
    row("DefocusTracker", f"pandas {pd.__version__} (the program needs MATLAB)", f"{len(table)} rows, Z from {table.Z.min():.3f} to {table.Z.max():.3f}")


def trackmate():
    import laptrack

    # As TrackMate's users read it: skip the three additional header lines.
    spots = pd.read_csv(exports / "trackmate-spots", skiprows=[1, 2, 3])
    same(spots.POSITION_X / um_per_px + 1, truth.x_px)
    lap = laptrack.LapTrack(cutoff=9.0)
    found, _, _ = lap.predict_dataframe(spots, coordinate_cols=["POSITION_X", "POSITION_Y"], frame_col="FRAME")
    version = __import__("importlib.metadata", fromlist=["version"]).version("laptrack")
    row("TrackMate spots", f"pandas {pd.__version__}, laptrack {version}", f"{spots.TRACK_ID.nunique()} tracks; linked anew by laptrack: {found.track_id.nunique()}")


def isbi():
    root = ElementTree.parse(exports / "isbi").getroot()
    detections = root.findall("./TrackContestISBI2012/particle/detection")
    same([float(d.get("x")) + 1 for d in detections], truth.x_px)
    for particle in root.findall("./TrackContestISBI2012/particle"):
        frames = [int(d.get("t")) for d in particle]
        assert frames == list(range(frames[0], frames[0] + len(frames)))
    row("ISBI", "ElementTree of Python " + sys.version.split()[0], f"{len(detections)} detections, contiguous tracks")


def napari():
    import napari
    from napari.layers import Tracks

    # napari's own documentation reads tracks like this.
    table = pd.read_csv(exports / "napari")
    layer = Tracks(table[["track_id", "t", "z", "y", "x"]].to_numpy())
    same(layer.data[:, 4] + 1, truth.x_px)
    row("napari", f"napari {napari.__version__}: layers.Tracks", f"{len(layer.data)} points of {len(np.unique(layer.data[:, 0]))} tracks")


def fields():
    import cv2
    import matplotlib

    matplotlib.use("Agg")
    from openpiv import tools

    nodes = pd.read_csv(dataset / "truth" / "field.csv")
    # The plane nearest to z = 0, the lower one of two.
    near = nodes.z_um[nodes.z_um.abs() == nodes.z_um.abs().min()].min()
    nodes = nodes[nodes.z_um == near]
    nodes = nodes[nodes["mask"] == 0] if "mask" in nodes else nodes
    flow = cv2.readOpticalFlow(str(exports / "flo"))
    known = np.abs(flow[..., 0]) < 1e9
    # A node may lie between pixels and is compared with the mean of its neighbors: the field is almost linear
    # there.
    around = [(np.floor(nodes.y_px), np.floor(nodes.x_px)), (np.ceil(nodes.y_px), np.ceil(nodes.x_px))]
    u = np.mean([flow[y.astype(int) - 1, x.astype(int) - 1, 0] for y, x in around], axis=0)
    inner = np.abs(u) < 1e9
    assert inner.mean() > 0.6 and np.abs(u - nodes.central_dx_px)[inner].max() < 0.05, np.abs(u - nodes.central_dx_px)[inner].max()
    least, most = np.nanmin(flow[..., 0][known]), np.nanmax(flow[..., 0][known])
    assert least >= nodes.central_dx_px.min() - 1e-4 and most <= nodes.central_dx_px.max() + 1e-4
    version = __import__("importlib.metadata", fromlist=["version"])
    row(".flo", f"OpenCV {cv2.__version__}: readOpticalFlow", f"{flow.shape}, {known.mean():.1%} known, u from {least:.4f} to {most:.4f} px")

    table = np.loadtxt(exports / "openpiv")
    same(table[table[:, 5] == 0][:, 2], nodes.central_dx_px)
    figure, axes = tools.display_vector_field(str(exports / "openpiv"), scale=50, width=0.0035)
    row("OpenPIV", f"openpiv {version.version('OpenPIV')}: tools.display_vector_field", f"{len(table)} vectors drawn")


images()
trackpy()
defocustracker()
trackmate()
isbi()
napari()
if (exports / "flo").exists():
    fields()
