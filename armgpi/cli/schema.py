"""The command that writes the JSON Schema of experiment files."""

from __future__ import annotations

import json
from pathlib import Path

from armgpi.cli.terminal import say

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {"out --out -o FILE": "File to write; by default it is printed."}


def schema(out: Path | None = None) -> None:
    """Print the JSON Schema of experiment files, which lets editors complete and check them.

    \b
    armgpi schema -o armgpi.schema.json
    # then, as the first line of an experiment file beside it:
    # yaml-language-server: $schema=armgpi.schema.json
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.cli.written import write
    from armgpi.config.json_schema import json_schema

    text = json.dumps(json_schema(), indent=1, ensure_ascii=False)
    if out is None:
        say(text, lines=True)
        return
    write(out, text + "\n", "--out")
    say("first line of an experiment file in the same folder, for editors:")
    say(f"# yaml-language-server: $schema={out.name}")
