"""Tables whose columns are NumPy arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from . import _microsig

if TYPE_CHECKING:
    import pandas
    import polars
    import xarray

#: Columns that are pixel coordinates.
_PIXELS = ("x_px", "y_px", "place_x_px", "place_y_px")


class Table(dict[str, NDArray[Any]]):
    """A table of a dataset or of a result: columns are NumPy arrays of equal length.

    It is an immutable dict of its columns, so that ``pandas.DataFrame(table)`` and
    ``polars.DataFrame(table)`` have the same columns and rows; its length is the number of rows.

    ``table["x_px"]`` is a column, ``table[mask]`` or ``table[:10]`` are rows, ``len(table)`` is the number of rows,
    ``table.x_px`` is short for ``table["x_px"]``. Integers are int64 (-1 where missing), numbers float64 (NaN where missing),
    texts are arrays of str.

    Names of columns end in their unit; see also :attr:`units` and :attr:`meanings`. Pixel coordinates have the first
    pixel's center at 1, as on disk; :meth:`origin` gives array indices instead.
    """

    def __init__(
        self,
        columns: Mapping[str, Any],
        *,
        name: str = "table",
        about: str = "",
        columns_about: Mapping[str, tuple[str, str]] | None = None,
        first_pixel: float = 1.0,
    ) -> None:
        """Create a table from one-dimensional columns of equal length; raises ValueError if their lengths differ."""
        arrays: dict[str, NDArray[Any]] = {}
        for column, values in columns.items():
            array = unmasked(values)
            if array.ndim != 1:
                raise ValueError(f"{name}: {column} has shape {array.shape}: expected one dimension")
            arrays[column] = array
        if len({len(array) for array in arrays.values()}) > 1:
            found = ", ".join(f"{column} {len(array)}" for column, array in arrays.items())
            raise ValueError(f"{name}: columns of different lengths: {found}")
        super().__init__(arrays)
        self.name = name
        self.about = about
        self._about = dict(columns_about or {})
        self._first_pixel = float(first_pixel)

    def _with(self, columns: Mapping[str, Any], first_pixel: float | None = None) -> Table:
        return Table(
            columns,
            name=self.name,
            about=self.about,
            columns_about=self._about,
            first_pixel=self._first_pixel if first_pixel is None else first_pixel,
        )

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return list(self)

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns; empty for columns without a unit."""
        return {column: self._about.get(column, ("", ""))[0] for column in self}

    @property
    def meanings(self) -> dict[str, str]:
        """Descriptions of the columns."""
        return {column: self._about.get(column, ("", ""))[1] for column in self}

    @property
    def first_pixel(self) -> float:
        """Coordinate of the first pixel's center in ``x_px``, ``y_px`` and places of stacks: 1 as on disk, or as set by :meth:`origin`."""
        return self._first_pixel

    def __len__(self) -> int:
        return next((len(array) for array in self.values()), 0)

    def __bool__(self) -> bool:
        """Whether there are columns; a table without rows is also true."""
        return bool(self.columns)

    def __getitem__(self, key: Any) -> Any:
        """A column (by name: an array), or rows (by number, mask, slice or indices: a table)."""
        if isinstance(key, str):
            try:
                return super().__getitem__(key)
            except KeyError:
                known = ", ".join(self)
                raise KeyError(f"{self.name} has no column {key}; it has {known}") from None
        if isinstance(key, (int, np.integer)):
            if not -len(self) <= key < len(self):
                raise IndexError(f"{self.name} has no row {key}; it has {len(self)} rows")
            key = slice(int(key), int(key) + 1 or None)
        return self._with({column: array[key] for column, array in self.items()})

    def __getattr__(self, name: str) -> NDArray[Any]:
        if name in self:
            return super().__getitem__(name)
        raise AttributeError(f"no column or attribute {name}")

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError(f"{self.name}: tables are read-only; to_dict() returns a dict that can be changed")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    # Tables are compared by identity: comparing arrays gives arrays.
    __eq__ = object.__eq__
    __ne__ = object.__ne__
    __hash__ = object.__hash__  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        about = {"name": self.name, "about": self.about, "columns_about": self._about, "first_pixel": self._first_pixel}
        return _restored, (self.to_dict(), about)

    def copy(self) -> Table:
        """The table itself, because it cannot be changed."""
        return self

    def origin(self, first_pixel: float) -> Table:
        """The same table with the first pixel's center at ``first_pixel`` (0: array indices ``image[y_px, x_px]``)."""
        shift = float(first_pixel) - self._first_pixel
        moved = {c: array + shift if c in _PIXELS else array for c, array in self.items()}
        return self._with(moved, float(first_pixel))

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """The columns by name."""
        return dict(self.items())

    def to_pandas(self) -> pandas.DataFrame:
        """A pandas DataFrame with the same columns; raises ImportError without pandas."""
        import pandas

        return pandas.DataFrame(self.to_dict())

    def to_polars(self) -> polars.DataFrame:
        """A polars DataFrame with the same columns; raises ImportError without polars."""
        import polars

        return polars.DataFrame(self.to_dict())

    def to_xarray(self, displacement: str | None = None, plane_um: float | None = None) -> xarray.Dataset:
        """A displacement field on a grid in the conventions of pivpy; raises ImportError without xarray.

        :param displacement: ``central``, ``forward``, ``weighted``, ... of ``ds.field``, by default ``central``
        :param plane_um: the plane nearest to this depth, um, if there are several
        :returns: ``u``, ``v`` (px) [, ``w`` (um)] and ``chc`` (1: valid) by (y, x, t); x and y in px, t is the pair
        :raises ValueError: a table that is no field on a grid; no such displacement; several planes
        """
        from . import _xarray

        return _xarray.of_field(self, displacement, plane_um)

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """The table by Arrow's PyCapsule interface, for pyarrow, polars, pandas, DuckDB and others; needs none of them.

        Integers, numbers and texts are int64, float64 and utf8 without nulls: missing values stay -1 and NaN.
        """
        return _microsig.arrow_stream([(column, plain(column, array)) for column, array in self.items()])

    def __repr__(self) -> str:
        shown = min(len(self), 6)
        head = [[_cell(array[row]) for row in range(shown)] for array in self.values()]
        widths = [max(map(len, [name, *cells])) for name, cells in zip(self, head)]
        lines = ["  ".join(name.rjust(width) for name, width in zip(self, widths))]
        for row in range(shown):
            lines.append("  ".join(cells[row].rjust(width) for cells, width in zip(head, widths)))
        lines = [line if len(line) <= 150 else line[:147] + "..." for line in lines]
        return "\n".join([f"{self.name}: {len(self)} rows, {len(self.columns)} columns", *lines])

    def _repr_html_(self) -> str:
        from html import escape

        shown = min(len(self), 8)
        head = "".join(
            f'<th title="{escape(self.meanings[name])}">{escape(name)}</th>' for name in self
        )
        rows = "".join(
            "<tr>" + "".join(f"<td>{escape(_cell(a[row]))}</td>" for a in self.values()) + "</tr>"
            for row in range(shown)
        )
        title = f"<p>{escape(self.name)}: {len(self)} rows, {len(self.columns)} columns</p>"
        return f"{title}<table><tr>{head}</tr>{rows}</table>"


def unmasked(values: Any) -> NDArray[Any]:
    """An array in which masked values are missing: NaN, or empty texts."""
    if not np.ma.is_masked(values):
        return np.asarray(values)
    if values.dtype.kind in "iuf":
        return np.asarray(values.astype(np.float64).filled(np.nan))
    array: NDArray[Any] = np.ma.getdata(values).astype(object)
    array[np.ma.getmaskarray(values)] = None
    return array


def plain(name: str, values: Any) -> NDArray[Any] | list[str]:
    """A column as the compiled part takes it: int64, float64 or texts; ``name`` is that in messages."""
    array = unmasked(values)
    if array.dtype.kind == "c":
        raise ValueError(f"{name} of type {array.dtype}: expected real numbers")
    if array.ndim != 1:
        raise ValueError(f"{name} has shape {array.shape}: expected one dimension")
    if array.dtype.kind in "iub" and array.dtype != np.uint64:
        return array.astype(np.int64)
    if array.dtype.kind in "fu":
        return array.astype(np.float64)
    return ["" if v is None else str(v) for v in array.tolist()]


def _restored(columns: dict[str, Any], about: dict[str, Any]) -> Table:
    """A table from pickle."""
    return Table(columns, **about)


def _cell(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, (float, np.floating)) else str(value)
