"""``python -m armgpi.cli``."""

from armgpi.cli import main

main()
