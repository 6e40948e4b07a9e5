"""Write what --help says of declared parameters, from the classes, into armgpi/cli/declared.json.

Usage:
    python tools/options.py [FILE]
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from armgpi.cli import declared


def main() -> None:
    """Write the file: a line for each module and option."""
    found = declared.read_classes()
    lists = {name: ",\n".join(map(json.dumps, getattr(found, name))) for name in ("modules", "options")}
    text = (
        f'{{"modules": [\n{lists["modules"]}\n],\n"names": {json.dumps(found.names)},\n'
        f'"options": [\n{lists["options"]}\n]}}\n'
    )
    file = sys.argv[1] if len(sys.argv) > 1 else Path(declared.__file__).with_name("declared.json")
    Path(file).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
