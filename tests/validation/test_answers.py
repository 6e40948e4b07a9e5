"""What a model writes into the pipe by which its process answers: data, or one line."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest

from armgpi import validate
from armgpi.errors import ModelError
from armgpi.validation.edits import Change
from armgpi.validation.proofs import Repaired
from armgpi.validation.worker import Worker, _plain_repaired, _read_repaired

MODEL = """
import gc, os, pickle, struct
import numpy as np

gc.unfreeze()

class Answer:
    def __reduce__(self):
        return os.system, ("touch OWNED",)

for each in gc.get_objects():
    if type(each).__name__ == "Line":
        try:
            WRITE
        except OSError:
            pass

def mass_matrix(q):
    return np.eye(3)
"""


@pytest.mark.parametrize(
    "write",
    [
        "each.send(pickle.dumps(Answer()))",
        "each.send(b'garbage')",
        "each.send(b'[true, 3]')",
        "each.send(b'[' * 100_000)",
        "each.send(b'[true, [[1], 2, false, null, []]]')",
        "each._end.sendall(struct.pack('!Q', 2**62))",
    ],
)
def test_what_a_model_writes_is_no_code(write: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "model.py"
    path.write_text(MODEL.replace("WRITE", write))
    begun = time.monotonic()
    with pytest.raises(ModelError), Worker(path, "model.py", 1.0):
        pass
    assert not (tmp_path / "OWNED").exists()
    assert time.monotonic() - begun < 30.0


def test_changes_arrive_as_they_were_sent() -> None:
    change = Change("sign", (1, 2, 1, 3), "a", "-a", "f", "", 3.5, frozenset({"mass_matrix"}))
    found = Repaired((change,), "x = 1", 1, 2, 3, True, {0: {1: 0.5}})
    sent = json.loads(json.dumps(_plain_repaired(found)))
    assert _read_repaired(sent, "x = a") == found
    assert _read_repaired(_plain_repaired(None), "x = a") is None
    with pytest.raises(ValueError):  # noqa: PT011 (a line that the source does not have)
        _read_repaired([[[*sent[0][0][:1], [2, 2, 2, 3], *sent[0][0][2:]]], *sent[1:]], "x = a")


SLOPE = """
import numpy as np


def G(q):
    elbow = 0.4 * np.cos(q[0] + q[1])
    return np.array([1.1 * np.cos(q[0]) + elbow, {share}elbow])


def coriolis(q, v):  # the torque
    return np.array([-v[1] * v[1], v[0] * v[0]])
"""


def test_without_a_robot_gravity_has_to_be_a_slope_and_what_nothing_judges_is_listed(tmp_path: Path) -> None:
    place = tmp_path / "model.py"
    place.write_text(SLOPE.format(share="2 * "))
    report = validate(place)
    assert not report.agrees
    assert "dG/dq symmetric" in report.causes[0].text
    place.write_text(SLOPE.format(share=""))
    report = validate(place)
    assert report.agrees
    (missing,) = report.left_out
    assert missing == "coriolis_torque: no structural property judges it without mass_matrix"
    assert report.verdict().startswith("INCOMPLETE")


def test_a_model_looks_for_no_garbage_in_what_the_program_had_before(tmp_path: Path) -> None:
    # Each search would copy all pages of a large program: naming a line took ten times as long in one.
    many = [[number] for number in range(100_000)]
    path = tmp_path / "model.py"
    path.write_text("import gc\n\ndef potential_energy(q):\n    return float(len(gc.get_objects()))\n")
    with Worker(path, "model.py", 5.0) as worker:
        (seen,) = worker.call("potential_energy", [(np.zeros(1),)])
    assert float(seen) < len(many)
