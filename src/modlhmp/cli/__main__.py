"""`python -m modlhmp.cli`."""

from modlhmp.cli import main

main()
