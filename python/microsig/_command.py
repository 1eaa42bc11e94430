"""The `microsig` command, installed with the package."""

from __future__ import annotations

import sys

from . import _microsig


def main() -> None:
    """Run the `microsig` command with the arguments of this process and exit with its code."""
    sys.exit(_microsig.command(["microsig", *sys.argv[1:]]))
