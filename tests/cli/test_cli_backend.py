"""`--backend`: which one ran, and what it says where there is none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import armgpi
from armgpi.cli import main


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    """Call the command line and return its exit code."""
    monkeypatch.setattr("sys.argv", ["armgpi", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert isinstance(ended.value.code, int)
    return ended.value.code


@pytest.mark.parametrize("command", ["run", "compare"])
def test_backends_agree_and_are_recorded(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = {}
    for backend in ("numpy", "compiled"):
        folder = tmp_path / backend
        code = run(
            *(monkeypatch, command, "anthropomorphic3", "--to", "0.3,0.2,-0.2", "--t-final", 0.3),
            *("--backend", backend, "--out", folder, "--json"),
        )
        assert code == 0
        found[backend] = json.loads(capsys.readouterr().out)
        provenance = json.loads(armgpi.load(folder / "rollout.nc").attrs["provenance"])
        text = json.dumps(provenance)
        assert f'"backend": "{backend}"' in text
    for one, other in zip(found["numpy"], found["compiled"], strict=True):
        for name, values in one["metrics"].items():
            np.testing.assert_allclose(other["metrics"][name], values, rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("command", ["run", "compare", "reproduce"])
def test_a_backend_that_is_none_is_refused(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    robot = () if command == "reproduce" else ("anthropomorphic3",)
    assert run(monkeypatch, command, *robot, "--backend", "fortran") == 2
    said = capsys.readouterr().err
    assert "--backend" in said
    assert "'fortran'" in said
    assert "numpy, compiled, auto" in said
    assert not list(tmp_path.iterdir())
