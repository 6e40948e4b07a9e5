"""Studies: results of two arms or versions are never mixed, and any end leaves what is whole."""

from __future__ import annotations

import json
import os
import platform
import runpy
import shutil
import signal
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sampling import for_search
from test_sweep import RARE, TEXT, called, contents

from armgpi.base import files
from armgpi.codegen import build as compilers
from armgpi.config import build, parse, read
from armgpi.config import experiment as experiments
from armgpi.errors import ArmgpiError, RolloutError
from armgpi.hardware.export import files as exported
from armgpi.health import zoo
from armgpi.loop.rollout import Status
from armgpi.robot import robots
from armgpi.studies import contend, results, sample, study, workers
from armgpi.studies.sample import Sweep

ROOT = Path(__file__).parents[2]
TUNED = """
robot: {name: anthropomorphic3}
controllers: [{type: gpi, rolloff: 1}]
reality:
  sample_time: [0.004]
  delay: [1, 1]
  effort_share: 0.0
  duration: [0.15, 0.3]
  t_final: 0.6
tune: {evaluations: 12, population: 4, scenarios: 1, held_out: 1}
"""
SMALL = TEXT.replace("anthropomorphic3", "arm.urdf")


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sample, "_MOST", 16)


@pytest.fixture
def asked(tmp_path: Path) -> Path:
    """A study of an arm in a file."""
    shutil.copy(robots.locate("anthropomorphic3")[0], tmp_path / "arm.urdf")
    (tmp_path / "study.yaml").write_text(SMALL)
    return tmp_path / "study.yaml"


def sweep(file: Path, out: Path, *more: str) -> Any:
    return called("sweep", str(file), "--rollouts", "40", "--out", str(out), *more)


def test_another_arm_under_the_same_name_is_another_study(
    asked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not sweep(asked, tmp_path / "out")
    before = contents(tmp_path / "out")
    arm = tmp_path / "arm.urdf"
    arm.write_text(arm.read_text().replace('<mass value="', '<mass value="3'))
    capsys.readouterr()
    assert sweep(asked, tmp_path / "out") == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert "holds another study" in said
    assert "the bytes of arm-" in said
    assert contents(tmp_path / "out") == before
    # A chunk of one is not taken for one of the other.
    assert not sweep(asked, tmp_path / "heavy")
    place = Path("chunks", "000001-16.chunk")
    shutil.copy(tmp_path / "out" / place, tmp_path / "heavy" / place)
    assert sweep(asked, tmp_path / "heavy") == 2
    assert "is part of another study" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("delay: 1\n", "delay: 2\n"), "plant.delay: 1 there, 2 here"),
        (("peak_error: 0.01", "peak_error: 0.02"), "peak_error: 0.01 there, 0.02 here"),
        (("t_final: 0.25", "t_final: 0.25\nseed: 4"), "seed: 0 there, 4 here"),
    ],
)
def test_what_differs_is_said(asked: Path, tmp_path: Path, change: tuple[str, str], said: str) -> None:
    Sweep.of(*read(asked)).enter(tmp_path / "out").write("part", np.zeros(1))  # it has begun
    asked.write_text(SMALL.replace(*change))
    with pytest.raises(RolloutError, match=said):
        Sweep.of(*read(asked)).enter(tmp_path / "out")


def test_another_trajectory_or_other_weights_are_another_study(tmp_path: Path) -> None:
    path, file = tmp_path / "path.csv", tmp_path / "study.yaml"
    text = """
robot: {name: anthropomorphic3}
controllers: [{type: network, weights: {omega: [20, 4, 10, 0]}}]
reference: {file: path.csv}
t_final: 0.05
vary: {plant.payload.mass: {uniform: [0.0, 0.3]}}
"""
    rows = [f"{0.01 * k:g},0,{0.3 + 0.001 * k:g},0" for k in range(20)]
    path.write_text("\n".join(["time,q1,q2,q3", *rows]) + "\n")
    file.write_text(text)
    Sweep.of(*read(file)).enter(tmp_path / "out").write("part", np.zeros(1))
    file.write_text(text.replace("20, 4", "20, 5"))
    with pytest.raises(RolloutError, match=r"weights.omega.1: 4.0 there, 5.0 here"):
        Sweep.of(*read(file)).enter(tmp_path / "out")
    file.write_text(text)
    path.write_text(path.read_text().replace("0.301", "0.302"))
    with pytest.raises(RolloutError, match="the bytes of path-"):
        Sweep.of(*read(file)).enter(tmp_path / "out")


def test_three_differences_are_said_and_more_are_hinted_at() -> None:
    there: dict[str, Any] = dict.fromkeys("abcd", 1)
    assert study._differences(there, {**there, "a": 2, "b": 2, "c": 2})[-1] == "c: 1 there, 2 here"
    assert study._differences(there, dict.fromkeys("abcd", 2))[3:] == ["..."]


def test_what_is_left_out_of_the_code_of_a_study_is_there_under_its_name() -> None:
    packages = {path.parent.name for path in (ROOT / "armgpi").glob("*/__init__.py")}
    assert packages > study._SHOWS


def test_other_code_is_refused_unless_it_is_accepted_and_then_marks_its_chunks(
    asked: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert not called("sweep", str(asked), "--rollouts", "16", "--out", str(out))
    other = {**study.code(), "numpy": "1.0.0"}
    monkeypatch.setattr(study, "code", lambda: other)
    sample._read_sweep.cache_clear()
    capsys.readouterr()
    assert sweep(asked, out) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert "1.0.0 here" in said
    assert "--accept-code" in said
    assert not sweep(asked, out, "--accept-code")
    heads = [json.loads(path.read_bytes().split(b"\n")[0]) for path in sorted((out / "chunks").iterdir())]
    assert len({head["code"] for head in heads}) == 2
    assert len({head["study"] for head in heads}) == 1
    assert not sweep(asked, out)
    sample._read_sweep.cache_clear()


def test_sources_of_plugins_and_models_by_name_are_part_of_a_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources = study._sources.__wrapped__
    before = sources()
    (tmp_path / "of_mine").mkdir()
    for name in ("of_mine/__init__.py", "of_mine/cli.py", "alone.py"):
        (tmp_path / name).write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("armgpi.registry.plugins", lambda: ("alone", "of_mine.law"))
    seen = [before, sources()]
    for name in ("of_mine/cli.py", "alone.py"):
        (tmp_path / name).write_text("x = 1")
        seen.append(sources())
    assert len({*seen}) == 4
    (tmp_path / "of_mine/cli.py").write_text("of_mine/d.pyx = 1")
    seen = [sources()]
    (tmp_path / "of_mine/cli.py").write_text("")
    (tmp_path / "of_mine/d.py").write_text("x = 1")  # what is a name is no content
    assert sources() != seen[0]
    nominal = TEXT.replace("omega: 20", "omega: 20, nominal: anthropomorphic3").replace(
        "robot: {name: anthropomorphic3}", "robot: {name: arm.urdf}"
    )
    shutil.copy(robots.locate("anthropomorphic3")[0], tmp_path / "arm.urdf")
    (tmp_path / "study.yaml").write_text(nominal)
    assert "anthropomorphic3" in Sweep.of(*read(tmp_path / "study.yaml")).identity.what["files"]


def test_a_worker_that_lives_on_runs_the_study_that_a_folder_holds_now(asked: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for error in ("0.01", "0.02"):
        shutil.rmtree(out, ignore_errors=True)
        asked.write_text(SMALL.replace("peak_error: 0.01", f"peak_error: {error}"))
        found = Sweep.of(*read(asked))
        sample.run_chunk(found.enter(out).folder, 0, 16)
        assert results.collect(found, found.enter(out), 16).sizes["rollout"] == 16


def test_what_was_removed_of_a_study_is_there_again_and_what_is_old_is_not(
    asked: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert not sweep(asked, out)
    assert not sweep(asked, tmp_path / "few", "--rollouts", "4")
    for path in out.glob("*.urdf"):
        path.unlink()
    (out / "experiment.yaml").unlink()
    assert not sweep(asked, out, "--rollouts", "4")
    few = contents(tmp_path / "few")
    assert few.items() <= contents(out).items()
    assert {path.name for path in (out / "worst").iterdir()} == {
        Path(name).name for name in few if "worst" in name
    }


def test_draws_depend_on_seed_rollout_and_name_alone() -> None:
    whole = Sweep.of(*parse(TEXT, "study.yaml"))
    other = TEXT.replace("omega: 20", "omega: 25").replace("  plant.delay: {choices: [0, 1, 2]}\n", "")
    fewer = Sweep.of(*parse(other, "study.yaml"))
    a = dict(zip(whole.drawn_names, whole.numbers(2, 16).T, strict=True))
    b = dict(zip(fewer.drawn_names, fewer.numbers(2, 16).T, strict=True))
    for name, values in b.items():
        np.testing.assert_array_equal(values, a[name], err_msg=name)
    # Neither on how rollouts are cut into chunks.
    object.__setattr__(fewer, "size", 32)
    np.testing.assert_array_equal(fewer.numbers(1, 16), np.column_stack(list(b.values())))
    again = Sweep.of(*parse(TEXT.replace("t_final", "seed: 1\nt_final"), "study.yaml"))
    assert not np.array_equal(again.numbers(2, 16), whole.numbers(2, 16))


@pytest.mark.parametrize("more", [(), ("--rare", "--rollouts", "100")])
def test_a_folder_runs_anywhere(
    asked: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: tuple[str, ...]
) -> None:
    if more:
        asked.write_text(RARE.replace("anthropomorphic3", "arm.urdf").replace("error: 0.4", "error: 0.1"))
    monkeypatch.chdir(tmp_path)
    assert not sweep(Path("study.yaml"), Path("out"), *more)
    there = tmp_path / "far" / "away"
    shutil.move(tmp_path / "out", there)
    (tmp_path / "arm.urdf").unlink()
    monkeypatch.chdir(there)
    worst = there / "rare" / "worst" if more else there / "worst"
    experiment = build(*read(worst / "01.yaml"))
    assert experiments.run(experiment, "gpi", progress=False).sizes["time"]
    before = contents(there)
    assert not sweep(Path("experiment.yaml"), there, *more)
    assert contents(there) == before


def spoiled(content: bytes, random: np.random.Generator) -> bytes:
    """Return a file that was damaged, cut, filled, or written by somebody else."""
    data = bytearray(content)
    kind, place = random.integers(6), int(random.integers(len(data)))
    if kind == 0:
        data[place] ^= 1 << int(random.integers(8))
    elif kind == 1:
        del data[place:]
    elif kind == 2:
        data[place : place + 1] = bytes(random.integers(256, size=8, dtype=np.uint8))
    elif kind == 3:
        head = data.split(b"\n")[0]
        data[len(head) + 1 :] = bytes(len(data) - len(head) - 1)
    elif kind == 4:
        data = bytearray(b"[" * int(random.integers(1, 5000)))
    else:
        data[place:place] = b'{"shape": [1e30, NaN], "sha256": null}\n'
    return bytes(data)


def damaged(folder: Path, count: int) -> int:
    """Return how many damaged files were refused; none may pass for whole."""
    found = Sweep.of(*parse(TEXT, "study.yaml"))
    found.enter(folder)
    sample.run_chunk(folder, 0, 16)
    random, refused = np.random.default_rng(0), 0
    for place in (found.enter(folder).place(sample.chunk_name(0, 16)), folder / study.IDENTITY):
        whole = place.read_bytes()
        right = results.collect(found, found.enter(folder), 16)
        for _ in range(count):
            place.write_bytes(spoiled(whole, random))
            try:
                again = results.collect(found, found.enter(folder), 16)
            except ArmgpiError:
                refused += 1
            else:
                assert again.identical(right)
        place.write_bytes(whole)
    return refused


def test_a_damaged_file_of_a_study_is_refused(tmp_path: Path) -> None:
    assert damaged(tmp_path, 60) > 100


@pytest.mark.search
def test_any_damaged_file_of_a_study_is_refused(tmp_path: Path) -> None:
    assert damaged(tmp_path, 5000) > 9000


def filled(folder: Path, chunks: int) -> tuple[Sweep, study.Study]:
    """Return a sweep whose chunks have the right draws, and any metrics."""
    whole = Sweep.of(*parse(TEXT, "study.yaml"))
    there, random = whole.enter(folder), np.random.default_rng(0)
    for chunk in range(chunks):
        table = random.uniform(size=(whole.size, len(whole.columns)))
        table[:, : whole.width] = whole.numbers(chunk, whole.size)
        table[:, whole.columns.index("status")] = Status.FINISHED
        there.write(sample.chunk_name(chunk, whole.size), table)
    return whole, there


def test_a_result_takes_as_many_bytes_as_promised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sample, "_MOST", 1024)

    def count_bytes(chunks: int, traced: bool = True) -> Any:
        whole, there = filled(tmp_path / str(chunks), chunks)
        if traced:
            tracemalloc.start()
        found = results.collect(whole, there, chunks * whole.size)
        held = tracemalloc.get_traced_memory()[0]
        results.write(whole, found, results.summary(whole, found), there.folder)
        both = np.array([held, tracemalloc.get_traced_memory()[1]])
        tracemalloc.stop()
        return both

    count_bytes(1, traced=False)  # imports
    held, most = (count_bytes(6) - count_bytes(2)) / (4 * 1024)
    whole = Sweep.of(*parse(TEXT, "study.yaml"))
    bound = 64 + 8 * len(whole.metrics) * whole.robot.n
    assert held <= bound
    assert most <= bound


def test_a_chunk_with_other_draws_is_refused_though_its_hash_is_right(tmp_path: Path) -> None:
    whole, there = filled(tmp_path, 1)
    name = sample.chunk_name(0, whole.size)
    right = there.read(name, (whole.size, len(whole.columns)))
    assert results.collect(whole, there, whole.size).sizes["rollout"] == whole.size
    for column in (1, whole.columns.index("status")):
        wrong = right.copy()
        wrong[3, column] += 0.5
        there.write(name, wrong)
        with pytest.raises(RolloutError, match="other scenarios"):
            results.collect(whole, there, whole.size)


@pytest.mark.slow
def test_an_interrupt_while_results_are_read_leaves_no_lock(tmp_path: Path) -> None:
    whole, there = filled(tmp_path, 1)

    def read(place: int = 0) -> int:
        """Interrupt at a call of xarray's locks and managers of files, and return how many there are."""
        calls = 0

        def trace(frame: Any, event: str, _: Any) -> None:
            nonlocal calls
            if frame.f_code.co_filename.endswith(("backends/locks.py", "backends/file_manager.py")):
                calls += 1
                if calls == place:
                    raise KeyboardInterrupt

        sys.settrace(trace)
        try:
            assert results.collect(whole, there, whole.size)["iae"].values.size
        finally:
            sys.settrace(None)
        return calls

    calls = read()
    for place in np.linspace(1, calls, 6).astype(int):
        with pytest.raises(KeyboardInterrupt):
            read(place)
        assert read() == calls


def test_a_zoo_goes_on_where_it_was_and_refuses_what_is_not_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(zoo, "HORIZON", 0.5)
    arm = tmp_path / "arm.urdf"
    shutil.copy(robots.locate("anthropomorphic3")[0], arm)

    def run(out: str, *more: str) -> Any:
        return called("benchmark", "robots", str(arm), *more, "--out", str(tmp_path / out))

    assert not run("whole", "twodof")
    assert not run("cut")
    place = next((tmp_path / "cut").glob("arm-*.chunk"))
    before = place.stat()
    assert not run("cut", "twodof")
    assert (place.stat().st_ino, place.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")
    assert not called("benchmark", "robots", str(arm), "twodof")
    # The terminal has the same cells in a table of lines.
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for row in (tmp_path / "cut" / "zoo.md").read_text().splitlines()[2:]:
        assert " ".join(row.replace("|", " ").split()) in shown
    # Other draws are another study, a damaged part is refused, and other bytes are another arm.
    assert run("cut", "--seed", "1") == 2
    assert "holds another study (seed: 0 there, 1 here)" in capsys.readouterr().err.splitlines()[-1]
    place.write_bytes(place.read_bytes()[:-8])
    assert run("cut") == 2
    assert "is damaged" in capsys.readouterr().err.splitlines()[-1]
    arm.write_text(f"{arm.read_text()}<!-- another one -->")
    assert not run("cut")
    assert len([*(tmp_path / "cut").glob("arm-*.chunk")]) == 2


def test_what_a_zoo_has_run_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def run() -> dict[str, bytes]:
        options = ("--reality", "geared", "--count", "2", "--out", str(tmp_path))
        assert not called("benchmark", "robots", "anthropomorphic3", *options)
        return contents(tmp_path)

    before = run()
    monkeypatch.setattr("armgpi.health.reality.outcomes", lambda *_, **__: pytest.fail("runs again"))
    assert run() == before


def test_rows_that_are_none_are_refused_though_their_hash_is_right(tmp_path: Path) -> None:
    there = study.Study.enter(tmp_path, study.Identity({}))
    for codes in ([91.0], [np.nan], [np.inf], [300.0], [*b"[[1, 2]]"], [*b"7"], [91.0] * 100_000):
        there.write("rows", np.array(codes))
        with pytest.raises(study.BadPart, match="rows: holds no rows"):
            study.rows(there.part, "rows", lambda x: x, list)


def forked(call: Callable[[Path], Any], out: Path) -> int:
    """Begin a command in a process of its own, where all is imported already, and return its number."""
    if child := os.fork():
        return child
    code: Any = 99
    try:
        with open(os.devnull, "w") as nothing:
            for each in (1, 2):
                os.dup2(nothing.fileno(), each)
        code = call(out) or 0
    except KeyboardInterrupt:  # before or after the command
        code = 128 + signal.SIGINT
    finally:
        os._exit(code)


def end_of(child: int) -> int:
    """Return the exit code of a process; negative where a signal ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


#: What is not the same again: times of steps as they were measured, and the hashes of files with them.
TIMED = ("README.md", "SHA256SUMS")


def assert_same(found: dict[str, bytes], whole: dict[str, bytes]) -> None:
    """Hold the files of two runs against each other: bytes, and of results.nc all that it says."""
    assert set(found) == set(whole)
    assert_part(found, whole)


def assert_part(found: dict[str, bytes], whole: dict[str, bytes]) -> None:
    """Hold the files that are there against those of an unbroken run."""
    for name, content in found.items():
        if name not in TIMED:
            assert content == whole[name], name


def interrupted(call: Callable[[Path], Any], folder: Path, wanted: int) -> None:
    """Send a command signals at random moments, so many in all.

    After each, what is there is a part of what an unbroken run leaves; called again it ends with all of it.
    """
    assert call(folder / "first") in (0, 1, None)  # which imports and compiles
    begun = time.perf_counter()
    ends = end_of(forked(call, folder / "whole"))
    long = time.perf_counter() - begun
    whole, random, count, place = contents(folder / "whole"), np.random.default_rng(0), 0, 0
    codes = {
        signal.SIGINT: (130,),
        signal.SIGTERM: (143, -signal.SIGTERM),
        signal.SIGKILL: (-signal.SIGKILL,),
    }
    signals = random.permutation([*codes])
    while count < wanted:
        number, out = signals[count % 3], folder / str(place)
        child = forked(call, out)
        time.sleep(long * random.uniform())
        os.kill(child, number)
        code = end_of(child)
        count += code != ends
        assert code in (ends, *codes[number]), (code, number)
        assert_part(contents(out), whole)
        if code == ends:
            assert_same(contents(out), whole)
            place += 1
    assert end_of(forked(call, folder / str(place))) == ends
    assert_same(contents(folder / str(place)), whole)


FAST = ["sweep", "rare", "certify", "tune", "zoo"]
COMMANDS = [
    for_search(name) if name in ("tune", "contend") else name for name in (*FAST, "contend", "export")
]


@pytest.fixture
def commands(
    asked: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> dict[str, Callable[[Path], Any]]:
    """What each command does in a folder; small ones, and again it goes on where it can."""
    monkeypatch.setattr(zoo, "HORIZON", 0.5)
    monkeypatch.setattr(contend, "QUICK", contend.Setting(12, 1, 1, 1))
    monkeypatch.setattr(exported, "_TIMING", 0.01)
    rare, tuned = tmp_path / "rare.yaml", tmp_path / "tune.yaml"
    rare.write_text(RARE.replace("anthropomorphic3", "arm.urdf").replace("error: 0.4", "error: 0.1"))
    tuned.write_text(TUNED)
    arm = "anthropomorphic3"

    def tune(out: Path) -> Any:
        resume = ["--resume"] if (out / study.IDENTITY).exists() else []
        return called("tune", str(tuned), "--backend", "numpy", "--out", str(out), *resume)

    return {
        "sweep": lambda out: sweep(asked, out),
        "rare": lambda out: sweep(rare, out, "--rare", "--rollouts", "100"),
        "tune": tune,
        "contend": lambda out: called(
            "benchmark", "controllers", arm, "--quick", "--law", "GPI, roll-off", "--out", str(out)
        ),
        "zoo": lambda out: called("benchmark", "robots", arm, "twodof", "--out", str(out)),
        "certify": lambda out: called(
            *("certify", arm, "--rotor-inertia", "0.1", "--omega", "40"),
            *("--out", str(files.make_folder(out) / "arm.json")),
        ),
        "export": lambda out: called("export", arm, "--out", str(out)),
        "reproduce": lambda out: called("reproduce", "--quick", "--out", str(out)),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_that_is_interrupted_ends_with_the_same_bytes(
    name: str, commands: dict[str, Callable[[Path], Any]], tmp_path: Path
) -> None:
    interrupted(commands[name], tmp_path / name, 3 if name in FAST else 1)


@pytest.mark.search
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", [*COMMANDS, "reproduce"])
def test_many_signals(name: str, commands: dict[str, Callable[[Path], Any]], tmp_path: Path) -> None:
    interrupted(commands[name], tmp_path / name, 6 if name == "reproduce" else 15)  # over a hundred in all


# Clusters.


@pytest.mark.search
def test_a_processor_with_fewer_instructions_writes_the_same_bytes(asked: Path, tmp_path: Path) -> None:
    """As far as one machine can tell: NumPy, OpenBLAS, glibc and the compiler take older processors' code."""
    older = tmp_path / "cc"
    older.write_text('#!/bin/bash\nexec cc "${@/-march=native/-march=x86-64-v2}"\n')
    older.chmod(0o755)
    fewer = {
        "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX2 FMA3",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA",
        **({"CC": str(older), "ARMGPI_LANES": "4"} if platform.machine() == "x86_64" else {}),
        "OPENBLAS_CORETYPE": "Sandybridge",
    }
    for name, more in (("own", {}), ("older", fewer)):
        words = [sys.executable, "-W", "ignore", "-m", "armgpi", "sweep", str(asked), "--rollouts", "40"]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), **more}
        subprocess.run(
            [*words, "--out", str(tmp_path / name)], env=environment, check=True, capture_output=True
        )
    assert contents(tmp_path / "older") == contents(tmp_path / "own")


@contextmanager
def cluster(folder: Path, count: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Give the address of a scheduler, and processes in folders of their own: it, and its workers."""
    pytest.importorskip("distributed")
    code = "import sys; from dask.__main__ import main; sys.argv[0] = 'dask'; main()"
    at = folder / "scheduler.json"
    options = [["scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(at)]]
    options += [
        ["worker", "--scheduler-file", str(at), "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    ] * count
    processes = []
    try:
        for place, each in enumerate(options):
            own = files.make_folder(folder / f"process-{place}")
            command = [sys.executable, "-c", code, *each]
            quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
            processes.append(subprocess.Popen(command, cwd=own, env=environment, **quiet))
        while not at.exists() or not at.read_text():
            time.sleep(0.1)
        yield json.loads(at.read_text())["address"], processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_cluster_whose_workers_stand_elsewhere_writes_the_same_bytes(
    asked: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sample, "_MOST", 4096)  # as in the workers, which are other processes
    monkeypatch.chdir(tmp_path)
    many = ("study.yaml", "--rollouts", "8200")  # 3 chunks
    assert not called("sweep", *many, "--out", "here")
    with cluster(tmp_path, 2) as (address, (scheduler, worker, _)):
        finished: list[int] = []

        def one_lost(*_: Any) -> Any:
            finished.append(1)
            if len(finished) == 2:
                worker.kill()
            return progress(*_)

        progress = workers._task_result
        monkeypatch.setattr(workers, "_task_result", one_lost)
        assert not called("sweep", *many, "--out", "there", "--cluster", address)
        assert worker.poll() is not None
        assert contents(tmp_path / "there") == contents(tmp_path / "here")
        capsys.readouterr()
        finished.clear()

        def none_left(*_: Any) -> Any:
            scheduler.kill()
            return progress(*_)

        monkeypatch.setattr(workers, "_task_result", none_left)
        assert called("sweep", *many, "--out", "cut", "--cluster", address) == 2
        said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
        assert len(said) == 1
        assert "scheduler" in said[0]
    assert_part(contents(tmp_path / "cut"), contents(tmp_path / "here"))
    assert not called("sweep", *many, "--out", "cut")
    assert contents(tmp_path / "cut") == contents(tmp_path / "here")


# Files that are read back, by the fuzzer.


@pytest.fixture(scope="module")
def fuzz(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, int], dict[str, int]]:
    """What counts the ends of damaged files of a kind; those that neither end well nor in one line raise."""
    cases = runpy.run_path(str(ROOT / "tools" / "fuzz.py"))["CASES"]
    folder = tmp_path_factory.mktemp("fuzz")

    def run(kind: str, count: int) -> dict[str, int]:
        ends = {"fine": 0, "refused": 0}
        for seed in range(count):
            try:
                cases[kind](np.random.default_rng(seed), folder)
                ends["fine"] += 1
            except ArmgpiError:
                ends["refused"] += 1
        return ends

    return run


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "kind",
    [
        *("weights", "trajectory", "log", "armlog", "identification", "task", "certificate"),
        *("tune", "zoo", "rare"),
    ],
)
def test_a_damaged_file_that_is_read_back_ends_in_one_line(
    fuzz: Callable[[str, int], dict[str, int]], kind: str
) -> None:
    assert fuzz(kind, 16)["refused"] > 8


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["mjcf", "repaired", "drives", "netcdf", "mcap"])
def test_a_damaged_file_of_a_stranger_is_read_or_ends_in_one_line(
    fuzz: Callable[[str, int], dict[str, int]], kind: str
) -> None:
    pytest.importorskip({"mjcf": "mujoco", "mcap": "mcap"}.get(kind, "numpy"))
    ends = fuzz(kind, 50)
    assert ends["fine"] + ends["refused"] == 50
    assert ends["refused"] > 10


def test_a_file_of_a_study_may_be_as_long_as_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own, part = study.Study.enter(tmp_path, study.Identity({}, {})), np.arange(6.0).reshape(2, 3)
    own.write("part", part)
    head, whole = (path.stat().st_size for path in (own.place("part"), tmp_path / study.IDENTITY))
    monkeypatch.setattr(study, "_HEAD", head - part.nbytes)
    monkeypatch.setattr(study, "_MOST", whole)
    np.testing.assert_array_equal(own.read("part", (2, 3)), part)
    assert study.read_identity(tmp_path)["codes"]
    monkeypatch.setattr(study, "_HEAD", head - part.nbytes - 1)
    monkeypatch.setattr(study, "_MOST", whole - 1)
    with pytest.raises(RolloutError, match="is damaged"):
        own.read("part", (2, 3))
    with pytest.raises(RolloutError, match="is damaged"):
        study.read_identity(tmp_path)


def test_the_compiler_of_a_study_is_told_by_the_first_line_of_its_version(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(compilers, "compiler", lambda: SimpleNamespace(version="gcc 12.2\nCopyright"))
    assert study.code()["compiler"] == "gcc 12.2"
