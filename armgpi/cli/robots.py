"""The command that lists robots."""

from __future__ import annotations

import typer


def robots() -> None:
    """List the robots that can be loaded by name."""
    from armgpi.robots import EXAMPLE_ROBOT_DATA, names

    found = names()
    for name in found:
        typer.echo(name)
    if not set(EXAMPLE_ROBOT_DATA) & set(found):
        typer.echo("more come with: pip install 'armgpi[robots]'", err=True)
