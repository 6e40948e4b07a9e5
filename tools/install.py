"""Run `pip install` with what is given, and print one line for each package, and how long it took.

pip alone says too much, and with --quiet nothing for minutes. When it fails, its last lines are printed.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time

#: Lines of pip that are shown, with what is said instead.
_SHOWN = (
    (re.compile(r"Collecting ([A-Za-z0-9._-]+)"), "  {}"),
    (re.compile(r"Obtaining (\S+)"), "  {}"),
    (
        re.compile(r"Installing collected packages: (.*)"),
        "  unpacking these packages; this takes as long again ...",
    ),
)
#: Lines that are printed when pip fails.
_TAIL = 15


def main() -> int:
    """Run pip and return its exit code."""
    command = [sys.executable, "-m", "pip", "install", "--progress-bar", "off", *sys.argv[1:]]
    began = time.monotonic()
    lines: list[str] = []
    shown: set[str] = set()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            lines.append(line)
            for pattern, text in _SHOWN:
                found = pattern.match(line.strip())
                said = text.format(found[1]) if found else ""
                if said and said not in shown:
                    shown.add(said)
                    print(said, flush=True)
    if process.returncode:
        print("".join(lines[-_TAIL:]), file=sys.stderr)
    else:
        print(f"  done after {time.monotonic() - began:.0f} s", flush=True)
    return process.returncode


if __name__ == "__main__":
    sys.exit(main())
