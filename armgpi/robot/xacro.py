"""From xacro, a language of programs that write URDFs, to the URDF: by the packages xacrodoc and xacro.

Expanding runs what the file says: it evaluates expressions, and reads the files that are included. So it is
done when asked for, never by loading, and in a process of its own with bounded time and memory.
"""

from __future__ import annotations

import json
import os
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
import contextlib, json, os, sys
job = json.load(sys.stdin)
with contextlib.suppress(ImportError, OSError, ValueError):
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (job["memory"], job["memory"]))
    resource.setrlimit(resource.RLIMIT_CPU, (job["seconds"], job["seconds"]))
answer = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)  # xacro prints warnings
try:
    from xacrodoc import XacroDoc, packages
    packages.look_in(job["packages"])
    document = XacroDoc.from_file(job["path"], subargs=job["arguments"])
    text = document.to_urdf_string(use_protocols=False, paths_relative_to=job["folder"])
    result = {"text": text}
except BaseException as error:
    inner = getattr(error, "exc", None) or error
    result = {"error": f"{type(inner).__name__}: {inner}"}
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
        UrdfError: when it cannot be expanded; it says why.
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
        result = json.loads(done.stdout[: 2 * markup.MAX_BYTES])
    except (subprocess.TimeoutExpired, json.JSONDecodeError):
        said = f"cannot be expanded within {SECONDS} s and {MEMORY // 2**30} GiB"
        raise UrdfError(source, said) from None
    if "text" not in result:
        raise UrdfError(source, f"cannot be expanded: {_said(result['error'])}")
    return str(result["text"])


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
