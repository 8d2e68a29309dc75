"""Entry point of ``python -m fenics_ehd.cli``."""

from fenics_ehd.cli.main import main

main()
