"""From xacro, a language of programs that write URDFs, to the URDF: by the packages xacrodoc and xacro.

Expanding runs what the file says: it evaluates expressions, and reads the files that are included. So it is
done when asked for, never by loading, and in a process of its own with bounded time and memory.
"""

from __future__ import annotations

import json
import math
import os
import re
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from armgpi.errors import UrdfError, import_extra
from armgpi.robot import markup

#: What an expansion may take: time [s], and memory [bytes]. The largest of the makers takes some 5 s.
SECONDS = 60
MEMORY = 2 * 1024**3
#: How much of a message is repeated [characters].
_SAID = 400
#: What the other process does: a job comes in as JSON, and a result goes out so.
_WORKER = """
import sys
sys.path[:] = [folder for folder in sys.path if folder]  # a json.py of the current folder is not ours
import contextlib, json, os
job = json.load(sys.stdin)
with contextlib.suppress(ImportError, OSError, ValueError):
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (job["memory"], job["memory"]))
    resource.setrlimit(resource.RLIMIT_CPU, (job["seconds"], job["seconds"] + 1))
answer = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)  # xacro prints warnings
class Arguments(dict):  # values by name; it notes which names the file declares or reads
    names = set()
    def __contains__(self, name):
        self.names.add(name)
        return super().__contains__(name)
    def __getitem__(self, name):
        self.names.add(name)
        return super().__getitem__(name)
try:
    from xacrodoc import XacroDoc, packages
    packages.look_in(job["packages"])
    arguments = Arguments(job["arguments"])
    document = XacroDoc.from_file(job["path"], subargs=arguments)
    text = document.to_urdf_string(use_protocols=False, paths_relative_to=job["folder"])
    size = len(text.encode())
    result = {"text": text} if size <= job["largest"] else {"size": size}
    result["names"] = sorted(map(str, arguments.names))
except BaseException as error:
    inner = getattr(error, "exc", None) or error
    result = {"error": f"{type(inner).__name__}: {inner}"}
    if isinstance(inner, MemoryError):
        result = {"memory": job["memory"]}
json.dump(result, answer)
answer.close()
"""


def expand(
    path: str | os.PathLike[str],
    arguments: Mapping[str, str] | None = None,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    folder: str | os.PathLike[str] = ".",
) -> str:
    """Return the text of the URDF that a xacro file writes.

    Args:
        path: of the file; packages are found from there upwards.
        arguments: of the file (`<xacro:arg>`), name -> value.
        package_dirs: folders in which packages are.
        folder: in which the URDF will be: names of meshes are relative to it.

    Raises:
        MissingPackage: when xacrodoc is not installed.
        UrdfError: when it cannot be expanded, or does not have an argument; it says why.
    """
    import_extra("xacrodoc", "xacro")
    source = Path(path)
    markup.read_file(source)  # refuses what is no text file
    job = {
        "path": str(source.absolute()),
        "arguments": dict(arguments or {}),
        "packages": [str(Path(each).absolute()) for each in package_dirs],
        "folder": str(Path(folder).absolute()),
        "memory": MEMORY,
        "seconds": SECONDS,
        "largest": markup.MAX_BYTES,
    }
    try:
        done = subprocess.run(
            [sys.executable, "-c", _WORKER],
            input=json.dumps(job),
            capture_output=True,
            text=True,
            timeout=2 * SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise UrdfError(source, f"cannot be expanded: it takes more than {2 * SECONDS} s") from None
    try:
        result = json.loads(done.stdout)
    except json.JSONDecodeError:
        raise UrdfError(source, f"cannot be expanded: {_death(done.returncode)}") from None
    if "text" in result:
        text = str(result["text"])
        if not re.search(r"<link[\s/>]", text):
            said = "it writes no <link>, as a file of macros or constants; expand the file that uses them"
            raise UrdfError(source, said)
        _check_names(source, arguments or {}, result["names"])
        return text
    if "size" in result:
        said = f"its URDF has {result['size']} bytes, more than the {markup.MAX_BYTES} allowed"
    elif "memory" in result:
        said = f"it takes more than {MEMORY // 2**30} GiB"
    else:
        said = _said(result["error"])
    raise UrdfError(source, f"cannot be expanded: {said}")


def _check_names(source: Path, given: Mapping[str, str], names: Sequence[str]) -> None:
    """Refuse an argument that a file neither declares nor reads: its value would have changed nothing."""
    for name in given:
        if name not in names:
            has = f"it has {', '.join(names)[:_SAID]}" if names else "it has none"
            raise UrdfError(source, f"has no argument {name!r}; {has}")


def _death(code: int) -> str:
    """Return how the other process ended when it wrote no result: its exit code, or minus a signal."""
    if code == -getattr(signal, "SIGXCPU", math.nan):
        return f"it takes more than {SECONDS} s of the processor"
    if code < 0:
        return f"the process that expands it was ended by signal {-code} without a result"
    return f"the process that expands it ended with code {code} and no result"


def _said(error: str) -> str:
    """Return in one line why xacro refuses a file, and what helps."""
    text = " ".join(error.split())[:_SAID]
    kind, _, rest = text.partition(": ")
    last = rest.rpartition(" ")[2]
    if kind == "PackageNotFoundError":
        return f"the package {last!r} is not found; give the folder that has it (--package-dir FOLDER)"
    if kind == "ArgException":
        return f"its argument {last!r} has no default; give it as {last}:=VALUE"
    if kind == "FileNotFoundError":
        return f"it includes {last}, which is not there; perhaps an argument names it (NAME:=VALUE)"
    return text
