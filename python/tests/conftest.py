"""What tests share."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

#: A scenario that takes milliseconds.
SMALL = """(
    name: "small",
    optics: (pixel_dim_x: 96, pixel_dim_y: 64),
    motion: flow(field: poiseuille()),
    particles: (number: count(5)),
    timing: pairs(count: 2),
)"""


def command(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Runs the `microsig` command of the package in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "microsig", *map(str, arguments)], capture_output=True, text=True, timeout=300
    )


@pytest.fixture
def golden() -> list[Path]:
    """The golden scenarios."""
    found = sorted((ROOT / "tests/data/golden").glob("*.ron"))
    assert len(found) >= 9
    return found
