"""`python -m modlhmp`."""

from modlhmp.cli import main

main()
