"""Models that misbehave: named, with the function and the state, and nothing of ours breaks."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commands import Answer

from armgpi import errors, validate
from armgpi.validation import worker

ARM = "double_pendulum"

#: What a model does -> its text, and what the error must say.
BAD = {
    "raises": (
        "def gravity(q):\n    return 1 / 0",
        "raises ZeroDivisionError: division by zero (model.py, line 2)",
    ),
    "raises on import": ("import nothing_of_that_name", "raises ModuleNotFoundError"),
    "syntax": ("def gravity(q:\n    pass", "raises SyntaxError"),
    "wrong shape": ("def gravity(q):\n    return [1.0, 2.0, 3.0]", "returns shape (3,), expected (2,)"),
    "a vector for a matrix": ("def mass_matrix(q):\n    return q", "returns shape (2,), expected (2, 2)"),
    "ragged": ("def mass_matrix(q):\n    return [[1.0, 2.0], [3.0]]", "returns no array of numbers"),
    "NaN": ("def gravity(q):\n    return q * float('nan')", "returns NaN"),
    "infinity": ("def gravity(q):\n    return q + float('inf')", "returns infinity"),
    "nothing": ("def gravity(q):\n    pass", "returns nothing (None)"),
    "text": ("def gravity(q):\n    return ['a', 'b']", "returns no real numbers"),
    "complex": ("def gravity(q):\n    return q * 1j", "returns no real numbers"),
    "chance": (
        "import random\ndef gravity(q):\n    return q + random.random()",
        "is not deterministic",
    ),
    "changes its input": (
        "def gravity(q):\n    q[0] = 0.0\n    return q",
        "changes its argument q in place",
    ),
    "slow": ("import time\ndef gravity(q):\n    time.sleep(10)\n    return q", "took longer than 0.5 s"),
    "swallows interrupts": (
        "def gravity(q):\n  while True:\n    try:\n      pass\n    except BaseException:\n      pass",
        "took longer than 0.5 s",
    ),
    "recursion": ("def gravity(q):\n    return gravity(q)", "raises RecursionError"),
    "sys.exit": ("import sys\ndef gravity(q):\n    sys.exit(3)", "calls sys.exit(3)"),
    "os._exit": ("import os\ndef gravity(q):\n    os._exit(3)", "ended its Python process with exit code 3"),
    "reads the keyboard": ("def gravity(q):\n    return input()", "raises EOFError"),
    "another n": (
        "import numpy as np\ndef gravity(q):\n    q1, q2, q3 = q\n    return np.array([q1, q2, q3])",
        "has 3 joints, but the robot double_pendulum has 2",
    ),
    "a typo": ("def gravty(q):\n    return q", "is 'gravty' meant to be 'gravity'?"),
    "no function": ("gravity = 3", "gravity must be a function"),
    "two models": (
        "class A:\n    def gravity(self, q): return q\nclass B:\n    def gravity(self, q): return q",
        "has several models (A, B)",
    ),
    "arguments": (
        "class A:\n    def __init__(self, m): pass\n    def gravity(self, q): return q",
        "cannot be made without arguments",
    ),
    "closes files": (
        "import os\ndef gravity(q):\n    os.closerange(3, 99)\n    return q",
        "closes file descr",
    ),
    "replaces builtins": (
        "import builtins\nbuiltins.len = builtins.zip = None\ngravity = abs",
        "breaks the Pyth",
    ),
    "replaces NumPy": ("import numpy\nnumpy.asarray = None\ngravity = abs", "returns no array of numbers"),
    "masks signals": (
        "import signal\nsignal.pthread_sigmask(signal.SIG_BLOCK, range(1, 65))\n"
        "def gravity(q):\n    while True: pass",
        "took longer than 0.5 s",
    ),
    "an alarm": (
        "import os, signal\ndef gravity(q):\n    os.kill(os.getpid(), signal.SIGALRM)",
        "ended its Python process by SIGALRM",
    ),
    "too much": ("def gravity(q):\n    return [0.0] * 20000", "returns 20000 numbers"),
    "no words": (
        "class E(Exception):\n    def __str__(self):\n        raise self\ndef gravity(q):\n    raise E",
        "raises E (model.py, line 5)",
    ),
    "unknown symbol": (
        "from sympy import *\nq1, q2, m = symbols('q1 q2 m')\ngravity = Matrix([m * cos(q1), q2])",
        "has the symbol m",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_model_is_named_with_what_it_did(name: str, tmp_path: Path) -> None:
    text, message = BAD[name]
    path = tmp_path / "model.py"
    path.write_text(text, encoding="utf-8")
    start = time.monotonic()
    with pytest.raises(errors.ModelError) as caught:
        validate(path, ARM, time_limit=0.5)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert caught.value.model == str(path)
    assert time.monotonic() - start < 60.0


def test_an_object_is_watched_as_a_file_is() -> None:
    def gravity(q: np.ndarray) -> np.ndarray:
        time.sleep(10.0)
        return q

    with pytest.raises(errors.ModelError, match="took longer"):
        validate({"gravity": gravity}, ARM, time_limit=0.3)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("missing.py", "there is no such file"),
        ("no_such_module", "there is no such file or module"),
        (".hidden", "there is no such file or module"),
        ("armgpi.paper.arm:Nothing", "has no 'Nothing'"),
        (object(), "has none of the functions"),
    ],
)
def test_what_is_no_model_is_refused(model: object, message: str) -> None:
    with pytest.raises(errors.ModelError, match=message):
        validate(model, ARM)


def test_reading_a_model_has_a_limit_that_the_option_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "endless.py"
    path.write_text("while True:\n    pass\n", encoding="utf-8")
    monkeypatch.setattr(worker, "LOADING_LEAST", 0.1)
    with pytest.raises(errors.ModelError, match=r"took longer than 0\.6 s to read; allow more") as caught:
        validate(path, ARM, time_limit=0.05)
    assert caught.value.remedies == (errors.Remedy("time_limit"),)


def test_expressions_in_another_encoding_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "latin.sympy"
    path.write_bytes(b"# \xe9\ngravity = Matrix([q1, q2])\n")
    with pytest.raises(errors.ModelError, match="is no text in UTF-8"):
        validate(path, ARM)


def test_what_a_model_prints_is_kept_off_the_screen_and_noted(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "loud.py"
    path.write_text("def gravity(q):\n    print('hello')\n    return 0 * q\n", encoding="utf-8")
    report = validate(path, ARM)
    assert "hello" not in "".join(capfd.readouterr())
    assert any("prints" in note for note in report.notes)


def test_the_command_ends_with_2_and_no_traceback(cli: Callable[..., Answer], tmp_path: Path) -> None:
    path = tmp_path / "model.py"
    path.write_text(BAD["raises"][0], encoding="utf-8")
    done = cli("validate", path, "--robot", ARM)
    assert done.code == 2
    assert done.err.startswith(f"error: {path}: gravity: raises ZeroDivisionError")
    assert "Traceback" not in done.err + done.out


def test_a_model_that_forks_leaves_no_copies_that_answer(tmp_path: Path) -> None:
    path = tmp_path / "forks.py"
    # Never more than three times, should the copies live on.
    text = """
import os
_calls = 0
def gravity(q):
    global _calls
    _calls += 1
    if _calls <= 3:
        if os.fork():
            open(r"{file}", "a").write("parent\\n")
    return 0 * q
"""
    path.write_text(text.replace("{file}", str(tmp_path / "who")), encoding="utf-8")
    report = validate(path, ARM)
    assert not report.agrees
    assert (tmp_path / "who").read_text(encoding="utf-8").split() == ["parent"] * 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gravity = Matrix([zoo * q1, q2])", "gravity divides by zero"),
        ("gravity = Matrix([q1 * v1, q2])", "gravity has the symbol v1, but it is a function of q alone"),
    ],
)
def test_expressions_that_mean_nothing_are_named(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "model.sympy"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(errors.ModelError, match=message):
        validate(path, ARM)
