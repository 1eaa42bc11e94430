"""`python -m microsig`: the `microsig` command."""

from ._command import main

main()
