"""Run every benchmark, each in a process of its own, and keep what it printed in build/benchmarks/.

    python benchmarks/all.py [--quick] [--docs]

``--docs`` also puts the pages into docs/benchmarks/.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
ROOT = FOLDER.parent
PAGES = ROOT / "build" / "benchmarks"
DOCS = ROOT / "docs" / "benchmarks"
#: Whether each can be quick.
SCRIPTS = {
    "kernels": True,
    "single": True,
    "batch": True,
    "first_result": True,
    "prepared": True,
    "elastic": True,
    "realistic": True,
    "references": True,
    "tool": True,
    "recording": True,
    "growth": True,
    "float32": True,
    "start": True,
    "sweep": True,
    "validate": True,
    "export": True,
    "supervisor": True,
    "inverse_kinematics": True,
    "derive": False,
}

#: What a newcomer can answer after the first screen of a page, in its source.
NEWCOMER = (
    "<!-- After the first screen a newcomer can answer: What was measured? One table of times, on the\n"
    "machine in its head. What do I type? `python benchmarks/{name}.py`. What is not in it? Other machines;\n"
    "conclusions are in docs/benchmarks.md. -->\n"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a look, not to judge by")
    parser.add_argument("--docs", action="store_true", help="put the pages into docs/benchmarks/ as well")
    options = parser.parse_args()
    failed = [name for name, can in SCRIPTS.items() if not _ran(name, options.quick and can, options.docs)]
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


def _ran(name: str, quick: bool, docs: bool) -> bool:
    """Run one, print and keep its page, and tell whether it succeeded."""
    print(f"\n>>> benchmarks/{name}.py\n", flush=True)
    command = [sys.executable, str(FOLDER / f"{name}.py"), *(["--quick"] if quick else [])]
    lines = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            lines.append(line)
    if process.returncode:
        print(f"benchmarks/{name}.py ended with {process.returncode}", file=sys.stderr)
        return False
    page = "".join(lines).rstrip() + "\n"
    for folder in (PAGES, DOCS) if docs else (PAGES,):
        folder.mkdir(parents=True, exist_ok=True)
        text = NEWCOMER.format(name=name) + page if folder == DOCS else page
        (folder / f"{name}.md").write_text(text, encoding="utf-8")
    return True


if __name__ == "__main__":
    main()
