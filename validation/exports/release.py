"""Checks the metadata of a release with the programs that will read it; prints a table row for each."""

import json
import sys
import zipfile
from importlib.metadata import version
from pathlib import Path

public = Path(sys.argv[1])


def row(what, tool, found):
    print(f"| {what} | {tool} | {found} |", flush=True)


def citation():
    from cffconvert import Citation

    cff = Citation((public / "CITATION.cff").read_text())
    cff.validate()
    row("CITATION.cff", f"cffconvert {version('cffconvert')}: validate", cff.as_apalike().strip())


def packages():
    from frictionless import Package, validate

    report = validate(str(public / "datapackage.json"))
    errors = report.flatten(["message"])
    assert report.valid, errors[:5]
    row("datapackage.json of the release", f"frictionless {version('frictionless')}: validate", f"{len(report.tasks)} resources, sizes and hashes agree")
    for archive in sorted(public.glob("*.zip")):
        folder = public.parent / "unpacked"
        zipfile.ZipFile(archive).extractall(folder)
        report = validate(str(folder / archive.stem / "datapackage.json"))
        errors = report.flatten(["message"])
        assert report.valid, (archive, errors[:5])
        tables = [t for t in report.tasks if t.type == "table"]
        row(f"datapackage.json of {archive.name}", f"frictionless {version('frictionless')}: validate",
            f"{len(report.tasks)} resources, of them {len(tables)} tables whose columns and types agree")


def croissant():
    import mlcroissant

    data = mlcroissant.Dataset(str(public / "croissant.json"))
    issues = data.metadata.ctx.issues
    assert not issues.errors, issues.errors
    records = data.records("val")
    first = next(iter(records))
    text = {k: v for k, v in first.items() if k.split("/")[-1] in ("frame", "track", "x_px", "z_um")}
    row("croissant.json", f"mlcroissant {version('mlcroissant')}: validated, records read", str({k: float(v) for k, v in text.items()}))


def zenodo():
    form = json.loads((public / ".zenodo.json").read_text())
    needed = {"title", "upload_type", "description", "creators", "license", "access_right"}
    assert needed <= form.keys()
    row(".zenodo.json", "json", "all required keys of a deposit of a dataset")


citation()
packages()
croissant()
zenodo()
