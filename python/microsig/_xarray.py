"""Displacement fields on grids as xarray, in the conventions of pivpy; the only module that needs xarray."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import xarray

    from ._table import Table


def of_field(table: Table, displacement: str | None, plane_um: float | None) -> xarray.Dataset:
    """See :meth:`Table.to_xarray`."""
    import xarray

    found = [c[: -len("dx_px")] for c in table if c.endswith("dx_px") and c[: -len("x_px")] + "y_px" in table]
    if not found or "x_px" not in table or "y_px" not in table:
        raise ValueError(f"{table.name}: expected a displacement field, with x_px, y_px and columns such as central_dx_px, central_dy_px")
    kinds = [prefix.rstrip("_") for prefix in found]
    kind = ("central" if "central" in kinds else kinds[0]) if displacement is None else displacement
    if kind not in kinds:
        raise ValueError(f"displacement = {displacement!r}: expected one of {', '.join(kinds)}")
    if "z_um" in table and plane_um is None and len(np.unique(table["z_um"])) > 1:
        listed = ", ".join(f"{z:g}" for z in np.unique(table["z_um"]))
        raise ValueError(f"plane_um = None: expected one of the planes of the field, um: {listed}")
    if "z_um" in table and plane_um is not None:
        planes = np.unique(table["z_um"])
        table = table[table["z_um"] == planes[np.argmin(np.abs(planes - plane_um))]]
    prefix = kind + "_" if kind else ""
    x, column = np.unique(table["x_px"], return_inverse=True)
    y, row = np.unique(table["y_px"], return_inverse=True)
    pair = table["pair"] if "pair" in table else np.zeros(len(table), np.int64)
    t, layer = np.unique(pair, return_inverse=True)
    at = (row, column, layer)
    count = np.zeros((len(y), len(x), len(t)), np.int64)
    np.add.at(count, at, 1)
    if count.max(initial=0) > 1:
        raise ValueError(f"{table.name}: several vectors at one node of the grid; expected one")
    parts = {"u": f"{prefix}dx_px", "v": f"{prefix}dy_px"}
    if f"{prefix}dz_um" in table:
        parts["w"] = f"{prefix}dz_um"
    variables = {}
    for name, source in parts.items():
        values = np.full(count.shape, np.nan)
        values[at] = table[source]
        variables[name] = (("y", "x", "t"), values)
    chc = np.isfinite(variables["u"][1]) & np.isfinite(variables["v"][1])
    for name in ("mask", "flag"):
        if name in table:
            # 0: fluid, a valid vector.
            valid = np.zeros(count.shape, bool)
            valid[at] = table[name] == 0
            chc &= valid
    variables["chc"] = (("y", "x", "t"), chc.astype(float))
    dataset = xarray.Dataset(variables, coords={"x": x, "y": y, "t": np.where(t < 0, 0, t).astype(float)})
    for name in ("x", "y", "u", "v"):
        dataset[name].attrs["units"] = "pix"
    dataset["t"].attrs["units"] = "frame"
    for name, standard in (("u", "u_velocity"), ("v", "v_velocity"), ("chc", "validity_flag")):
        dataset[name].attrs["standard_name"] = standard
    if "w" in variables:
        dataset["w"].attrs["units"] = "um"
    # Displacements: the time between images is one frame.
    dataset.attrs.update(delta_t=1.0, files=[table.name], pivpy_schema_version="1", displacement=kind or "reported")
    return dataset
