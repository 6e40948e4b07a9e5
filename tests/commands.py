"""What a command of armgpi answers, and scripts in forks of this process."""

from __future__ import annotations

import os
import sys
import tempfile
import traceback
import warnings
from pathlib import Path
from typing import Any, NamedTuple


class Answer(NamedTuple):
    """How a call of `armgpi` ended, and what it wrote."""

    code: int
    out: str
    err: str


def fork_script(text: str, *arguments: object, folder: Path, warn: Any = "default") -> Answer:
    """Run a script as `python` would, in a fork of this process, which has imported most of what it needs.

    Args:
        text: the script.
        arguments: in `sys.argv` after its name.
        folder: where it runs; it imports the modules there, not those that this process has by their names.
        warn: what becomes of warnings, as after `-W`.
    """
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        sys.stdout.flush()
        if not (child := os.fork()):
            code: Any = 1
            try:
                for stream, number in ((out, 1), (err, 2)):
                    os.dup2(stream.fileno(), number)
                sys.stdout, sys.stderr = out, err
                for path in folder.glob("*.py"):
                    sys.modules.pop(path.stem, None)
                os.chdir(folder)
                sys.path.insert(0, str(folder))
                sys.argv = ["script.py", *map(str, arguments)]
                warnings.resetwarnings()
                warnings.simplefilter(warn)
                exec(compile(text, "script.py", "exec", dont_inherit=True), {"__name__": "__main__"})
                code = 0
            except SystemExit as end:
                code = end.code or 0
                if not isinstance(code, int):
                    print(code, file=sys.stderr)
                    code = 1
            except BaseException:
                traceback.print_exc()
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        for stream in (out, err):
            stream.seek(0)
        return Answer(code, out.read(), err.read())
