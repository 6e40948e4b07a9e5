"""What the rule chose is kept by the arm: with the same bits, whole or not at all, and for no other arm."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armgpi import GPI, FixedGains, Robot, RobotBatch, assume_drives
from armgpi.base.cache import RESULTS, keep_result, read_result
from armgpi.gpi.payload import LoadRange
from armgpi.tuning import geared, kept, rule, verdict

DT = 1e-3
UR5 = assume_drives(Robot.load("ur5"))
MOTOR = UR5.with_drives({joint: {"encoder_side": "motor"} for joint in UR5.joint_names})


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, and a process that keeps nothing."""
    monkeypatch.setenv("ARMGPI_CACHE", str(tmp_path / "cache"))
    kept.forget()
    return tmp_path / "cache" / RESULTS


def computed(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return a list that grows by every time the rule is worked out."""
    calls: list[Any] = []
    own = rule._chosen

    def counted(*arguments: Any) -> Any:
        calls.append(arguments)
        return own(*arguments)

    monkeypatch.setattr(rule, "_chosen", counted)
    return calls


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Tell whether two choices have the same names, types and bits."""
    if list(one) != list(other):
        return False
    for name, value in one.items():
        mine, its = (
            np.asarray(getattr(value, "heaviest", value)),
            np.asarray(getattr(other[name], "heaviest", other[name])),
        )
        if type(value) is not type(other[name]) or mine.tobytes() != its.tobytes():
            return False
    return True


@pytest.mark.parametrize(
    ("robot", "given"),
    [
        (UR5, {}),
        (MOTOR, {}),
        (Robot.load("anthropomorphic3"), {}),  # whose payload is chosen as well
        (UR5, {"payload": LoadRange(heaviest=1.0), "rest_dead_zone": 0.0}),
    ],
    ids=["unknown", "motor", "rigid", "given"],
)
def test_what_was_kept_has_the_bits_of_what_is_worked_out(
    cache: Path, monkeypatch: pytest.MonkeyPatch, robot: Robot, given: dict[str, Any]
) -> None:
    calls = computed(monkeypatch)
    plain, _ = rule._chosen(rule._Asked(robot, DT, DT, 16, given))
    first = rule.apply_rule(robot, DT, DT, 16, given).values
    assert len(calls) == 2
    again = rule.apply_rule(robot, DT, DT, 16, given).values  # of the process
    kept.forget()
    from_disk = rule.apply_rule(robot, DT, DT, 16, given).values
    assert len(calls) == 2
    assert len(list(cache.glob("*.json"))) == 1
    for other in (first, again, from_disk):
        assert same(plain, other)


def test_a_verdict_is_kept_too(cache: Path) -> None:
    law = GPI.auto(MOTOR, DT, delay=DT)
    first = verdict.verdict(law, MOTOR, 16)
    kept.forget()
    # As text, which has all digits: some numbers are NaN.
    assert repr(verdict.verdict(law, MOTOR, 16)) == repr(first) == repr(verdict._verdict(law, MOTOR, 16))
    assert isinstance(first.limits, tuple)


@pytest.mark.parametrize("change", ["mass", "bits", "delay", "drives", "constant", "given"])
def test_another_arm_loop_or_constant_is_worked_out_anew(
    cache: Path, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    calls = computed(monkeypatch)
    rule.apply_rule(UR5, DT, DT, 16)
    given: dict[str, Any] = {}
    robot, delay, bits = UR5, DT, 16
    if change == "mass":
        robot = UR5.with_payload(UR5.tip, 1e-6)
    elif change == "drives":
        robot = MOTOR
    elif change == "bits":
        bits = 17
    elif change == "delay":
        delay = 2.0 * DT
    elif change == "constant":
        monkeypatch.setattr(geared, "STABLE_SHARE", 0.8)
    else:
        given = {"rest_dead_zone": 0.0}
    rule.apply_rule(robot, delay=delay, dt=DT, bits=bits, given=given)
    assert len(calls) == 2


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: b"",
        lambda text: text[:-20],
        lambda text: text.replace(b"integrators", b"integratorz"),
        lambda text: b"\xff" * 70,
        lambda text: text.partition(b"\n")[0] + b"\n[[[",
    ],
    ids=["empty", "cut", "changed", "bytes", "not-json"],
)
def test_a_damaged_file_is_ignored_and_written_anew(cache: Path, damage: Any) -> None:
    first = rule.apply_rule(UR5, DT, DT, 16).values
    (file,) = cache.glob("*.json")
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    kept.forget()
    assert same(first, rule.apply_rule(UR5, DT, DT, 16).values)
    assert file.read_bytes() == whole


def test_without_a_cache_the_rule_is_worked_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARMGPI_CACHE", "/dev/null")
    kept.forget()
    calls = computed(monkeypatch)
    first = rule.apply_rule(UR5, DT, DT, 16).values
    kept.forget()
    assert same(first, rule.apply_rule(UR5, DT, DT, 16).values)
    assert len(calls) == 2
    keep_result("0" * 32, 1.0)
    assert read_result("0" * 32) is None


def test_a_cache_that_others_can_write_is_not_read(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rule.apply_rule(UR5, DT, DT, 16)
    cache.chmod(0o777)
    kept.forget()
    calls = computed(monkeypatch)
    rule.apply_rule(UR5, DT, DT, 16)
    assert len(calls) == 1


def test_a_result_is_no_library(cache: Path) -> None:
    """A process without compiled code learns from the cache that there is none."""
    from armgpi.codegen import build

    rule.apply_rule(UR5, DT, DT, 16)
    assert len(list(cache.glob("*.json"))) == 1
    assert build.none_known() or build._loaded


def test_a_result_that_another_thread_drops_is_returned(cache: Path) -> None:
    def compute() -> list[float]:
        kept.forget()
        return [1.0]

    class Dropped(dict[str, Any]):
        """Keeps nothing: as if other threads had put 1024 results in its place."""

        def __setitem__(self, key: str, value: Any) -> None:
            """Keep nothing."""

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kept, "_in_process", Dropped())
        assert kept.remember("test", {"number": 1}, compute, on_disk=False) == [1.0]


def test_many_threads_with_more_results_than_are_kept(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "_MOST", 3)

    def ask(number: int) -> Any:
        return kept.remember("test", {"number": number % 7}, lambda: [number % 7], on_disk=False)

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(ask, range(300))) == [[number % 7] for number in range(300)]
    assert len(kept._in_process) <= 3


def test_the_same_arm_of_a_batch_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = computed(monkeypatch)
    other = UR5.with_payload(UR5.tip, 0.5)
    # Of gains there is no digest, so nothing is kept of these.
    law = GPI.auto(RobotBatch([UR5, UR5, other, UR5]), DT, gains=FixedGains(10.0))
    assert len(calls) == 2
    assert law.robot.n == UR5.n
    calls.clear()
    kept.forget()
    most = np.array([[0.5], [0.5], [1.0]])
    rows = rule.apply_rule(RobotBatch([UR5] * 3), DT, given={"payload": LoadRange(heaviest=most)}).values
    assert len(calls) == 2
    np.testing.assert_array_equal(rows["omega_c"][0], rows["omega_c"][1])
