"""Compare our stubs of public headers with those headers, declaration by declaration.

    python tools/headers.py FOLDER ...

FOLDER is a checkout of ros2_control or libfranka. In a stub file a line `// from <header>` begins what is of
that header, up to the next one or `// end`. A declaration of it that the header does not have, word for word
(spaces and comments apart), is printed; exit code 1. Stubs of others (rclcpp) are not compared.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
STUBS = sorted((ROOT / "tests/hardware/stubs").rglob("*.h*"))
#: What a stub has besides declarations: access, bodies that give something back, and directives.
_OWN = re.compile(r"(public|protected|private) ?:|return\b|#.*")


def words(text: str) -> str:
    """Return a text of C++ without comments, one space between its words."""
    text = re.sub(r"//[^\n]*|/\*.*?\*/", " ", text, flags=re.DOTALL)
    return " ".join(re.findall(r"\w+|[^\w\s]", text))


def declarations(text: str) -> list[str]:
    """Return the declarations of a part of a stub, and the entries of its enumerations, as words."""
    pieces = re.split(r"[{};]", re.sub(r"//[^\n]*", "", text))
    found = []
    for piece in pieces:
        inner = words(re.sub(r"^\s*(public|protected|private):", "", piece.strip()))
        entries = inner.split(" , ") if "(" not in inner and "<" not in inner else [inner]
        found += [entry.removesuffix(" ,").strip() for entry in entries]
    return [entry for entry in found if entry and entry != "," and not _OWN.match(entry)]


def sections(stub: Path) -> list[tuple[str, str]]:
    """Return the headers that a stub file is like, each with its part."""
    parts = re.split(r"// (?:from (\S+)|end)\n", stub.read_text(encoding="utf-8"))
    return [(header, part) for header, part in zip(parts[1::2], parts[2::2], strict=True) if header]


def compare(folder: Path) -> tuple[int, list[str]]:
    """Return how many declarations were compared with the headers below a folder, and those that differ."""
    count, apart = 0, []
    for stub in STUBS:
        for header, part in sections(stub):
            found = [path for path in folder.rglob(Path(header).name) if path.as_posix().endswith(header)]
            if not found:
                continue
            real = words(found[0].read_text(encoding="utf-8"))
            for declaration in declarations(part):
                count += 1
                if declaration not in real:
                    apart.append(f"{header}: {declaration}")
    return count, apart


def main(folders: list[str]) -> int:
    """Compare with each folder and say what differs."""
    bad = not folders
    for name in folders:
        count, apart = compare(Path(name))
        print(f"{name}: {count} declarations compared, {len(apart)} differ")
        for line in apart:
            print(f"  {line}")
        bad = bad or bool(apart) or not count
    return int(bad)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
