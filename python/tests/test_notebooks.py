"""The notebooks run from beginning to end; `python/check --notebooks` installs what they need."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import ROOT

NOTEBOOKS = sorted((ROOT / "python/notebooks").glob("*.ipynb"))


@pytest.mark.notebooks
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run(path: Path, tmp_path, monkeypatch):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    if path.stem == "train_detector":
        pytest.importorskip("torch")
        # A few steps: that it runs, not that it learns.
        monkeypatch.setenv("MICROSIG_STEPS", "3")
    if path.stem == "real_recording":
        # A scan that is not part of this repository.
        scan = ROOT.parent / "shared/reference/idpt"
        if not (scan / "scan.tif").exists():
            pytest.skip("the scan is not there")
        monkeypatch.setenv("MICROSIG_SCAN", str(scan))
        pytest.importorskip("pandas"), pytest.importorskip("tifffile")
    if path.stem == "own_tracker":
        pytest.importorskip("trackpy")
    notebook = nbformat.read(path, as_version=4)
    resources = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=900, kernel_name="python3", resources=resources).execute()
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert cells and all(cell.execution_count for cell in cells)


def test_there_are_seven():
    assert len(NOTEBOOKS) == 7
