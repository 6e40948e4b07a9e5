"""The log of an arm: one format for hardware, two processes and simulation; read, refused, replayed."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import Answer

from armgpi import GPI, Bezier, Encoder, RigidBodyPlant, Robot, Supervised, Supervisor, Waypoints, simulate
from armgpi.errors import NameNotFound, ParameterError, RolloutError
from armgpi.hardware.export.files import record
from armgpi.hardware.realtime import Injected, run
from armgpi.identification.logs import read_log
from armgpi.loop import log as logs
from armgpi.loop import rollout as rollouts
from armgpi.loop.log import Event

ARM = Robot.load("anthropomorphic3")
MOVE = Bezier(ARM.middle(), ARM.middle() + 0.3, duration=0.2)
PLANT = Encoder(RigidBodyPlant(ARM), 16)


def law(rate: float | None = None) -> Supervised:
    return Supervised(GPI(ARM, 1e-3), Supervisor(torque_rate=rate, missed=20))


def lossy() -> logs.ArmLog:
    """The log of a loop over a wire that loses a tenth of the datagrams, and its samples' torques."""
    found = run(PLANT, law(1000.0), MOVE, 0.3, injected=Injected(loss=0.1, seed=3), clock="simulated").log
    assert found is not None
    return found


def test_a_file_gives_back_every_bit(tmp_path: Path) -> None:
    there = lossy()
    again = logs.read(logs.write(there, tmp_path / "a.armlog"))
    assert again.header == dict(there.header)
    assert again.rows.tobytes() == there.rows.tobytes()
    # The layout that the module's docstring has, read by hand.
    content = (tmp_path / "a.armlog").read_bytes()
    assert content[:8] == b"ARMGPILG"
    version, length = struct.unpack_from("<II", content, 8)
    assert version == 1
    header = json.loads(content[16 : 16 + length])
    size = 32 + 8 * 3 * (len(header["inputs"]) + 2)
    assert len(content) == 16 + length + size * len(there.rows)
    row = there.rows[7]
    number, event, status, _, _, elapsed, unused = struct.unpack_from("<Q6I", content, 16 + length + 7 * size)
    assert (number, event, status, elapsed, unused) == (row["number"], 0, row["status"], row["elapsed"], 0)
    first = struct.unpack_from("<3d", content, 16 + length + 7 * size + 32)
    np.testing.assert_array_equal(first, row["q_measured"])


def test_a_log_of_a_wire_that_loses_datagrams_replays_to_the_bit() -> None:
    there = lossy()
    assert (there.samples["elapsed"] > 1).any()
    assert np.isfinite(there.samples["applied"]).all()
    played = logs.replay(there, law(1000.0))
    assert (played.samples, played.first, played.status) == (len(there.samples), None, None)
    np.testing.assert_array_equal(played.difference, 0.0)


def test_a_replay_finds_another_torque_and_another_law() -> None:
    there = lossy()
    rows = there.rows.copy()
    rows["tau"][40, 1] += 1e-12
    assert logs.replay(there._replace(rows=rows), law(1000.0)).first == rows["number"][40]
    other = Supervised(GPI(ARM.scaled_inertia(1.01), 1e-3), Supervisor(torque_rate=1000.0, missed=20))
    assert logs.replay(there, other).difference.max() > 1e-6


def test_a_fault_is_in_the_log_and_replays() -> None:
    """A reference that steps stops the arm; status and reason are those of the replay."""
    step = Waypoints([ARM.middle(), ARM.middle() + 0.5], [1e-3], 0.1)
    there = run(PLANT, law(), step, 0.3, clock="simulated").log
    assert there is not None
    assert there.fault is not None
    assert "REFERENCE" in there.fault
    assert logs.to_rollout(there, ARM)["status"] == rollouts.Status.STOPPED
    played = logs.replay(there, law())
    assert (played.first, played.status) == (None, None)


def test_a_reset_replays(tmp_path: Path) -> None:
    controller = law()
    writer = logs.LogWriter(ARM.joint_names, 1e-3, ("q_measured", "q_ref"), 100)
    rest = np.zeros(3)
    from armgpi import Measurement, Target

    def given(k: int) -> tuple[Any, Any]:
        q = ARM.middle() + 1e-5 * k
        return Measurement(q), Target(ARM.middle() + (np.nan if k == 20 else 0.0), rest, rest)

    state = controller.init(*given(0))
    writer.take(0, *given(0), rest, event=Event.INIT, elapsed=0)
    for k in range(40):
        if k == 30:
            state = controller.reset(*given(k), state)
            writer.take(k, *given(k), rest, event=Event.RESET, elapsed=0)
        tau, state = controller.step(*given(k), state)
        status, reason, joint = (int(x[0]) for x in state.supervisor[:3])
        writer.take(k, *given(k), tau, report=(status, reason, joint))
    played = logs.replay(logs.read(logs.write(writer.log(), tmp_path / "r.armlog")), law())
    assert (played.samples, played.first, played.status) == (40, None, None)


def test_a_full_memory_keeps_the_newest_rows_and_cannot_be_replayed() -> None:
    there = lossy()
    writer = logs.LogWriter(ARM.joint_names, 1e-3, ("q_measured", "q_ref"), 50)
    from armgpi import Measurement, Target

    for row in there.samples:
        q = row["q_measured"]
        writer.take(int(row["number"]), Measurement(q), Target(q, q, q), row["tau"])
    kept = writer.log()
    np.testing.assert_array_equal(kept.rows["number"], there.samples["number"][-50:])
    with pytest.raises(RolloutError, match="does not begin with the start"):
        logs.replay(kept, law())


def test_a_log_of_another_arm_or_rate_is_not_replayed() -> None:
    there = lossy()
    ur5 = Robot.from_xml(
        (Path(__file__).parents[2] / "urdf" / "anthropomorphic3.urdf").read_text().replace("q3", "q4")
    )
    with pytest.raises(NameNotFound, match="q3"):
        logs.replay(there, Supervised(GPI(ur5, 1e-3)))
    with pytest.raises(ParameterError, match=r"dt = 0\.001"):
        logs.replay(there, Supervised(GPI(ARM, 2e-3)))


def test_a_log_is_a_rollout_for_reports_and_identification(tmp_path: Path) -> None:
    """What a simulation recorded and what its log says of it are the same."""
    controller = Supervised(GPI(ARM, 1e-3))
    run_ = simulate(PLANT, controller, MOVE, 0.25, backend="numpy", progress=False)
    there = logs.read(logs.write(record(PLANT, controller, MOVE, 0.25), tmp_path / "s.armlog"))
    again = logs.to_rollout(there, ARM)
    for name in ("q_measured", "q_ref", "v_ref", "tau_command"):
        np.testing.assert_array_equal(again[name].values, run_[name].values[:-1])
    np.testing.assert_array_equal(again["q"].values, run_["q_measured"].values[:-1])
    assert rollouts.load(rollouts.save(again, tmp_path / "again.nc")).equals(again)
    mine, theirs = read_log(tmp_path / "s.armlog", ARM), read_log(run_, ARM)
    np.testing.assert_array_equal(mine.q, theirs.q[:-1])
    limit = ARM.limits.effort
    np.testing.assert_array_equal(np.clip(mine.tau, -limit, limit), theirs.tau[:-1])
    twice = there.rows.copy()
    twice["number"][-1] = twice["number"][-2]
    with pytest.raises(RolloutError, match="increasing times"):
        logs.to_rollout(there._replace(rows=twice), ARM)
    short = [there._replace(rows=there.rows[: len(there.rows) - len(there.samples) + n]) for n in (1, 2)]
    assert logs.to_rollout(short[1], ARM).sizes["time"] == 2
    with pytest.raises(RolloutError, match="at least two samples"):
        logs.to_rollout(short[0], ARM)


GOOD = {"joints": ["a"], "dt": 1e-3, "inputs": ["q_measured", "q_ref"]}


def content(header: Any, rows: bytes = b"", version: int = 1, length: int | None = None) -> bytes:
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return b"ARMGPILG" + struct.pack("<II", version, len(text) if length is None else length) + text + rows


def one_row(**values: Any) -> bytes:
    row = np.zeros(2, logs.row_type(("q_measured", "q_ref"), 1))
    for name, value in values.items():
        row[name][0] = value
    return row.tobytes()


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (b"", "no log of an arm"),
        (b"ARMGPILG", "no log of an arm"),
        (b"time,q_a\n", "no log of an arm"),
        (content(GOOD, version=2), "format 2, expected 1; read it with"),
        (content(GOOD, length=1 << 31), "header of 2147483648 bytes is not whole"),
        (content(GOOD, length=len(json.dumps(GOOD)) + 1), "bytes is not whole"),
        (content(b"{"), "no JSON"),
        (content(b"[" * 100000), "no JSON"),
        (content(b"\xff\xfe"), "no JSON"),
        (content([1]), "no JSON"),
        (content({"joints": ["a"]}), "no JSON with joints"),
        (content({**GOOD, "joints": []}), "joints"),
        (content({**GOOD, "joints": "a"}), "joints"),
        (content({**GOOD, "joints": [1]}), "joints"),
        (content({**GOOD, "joints": ["a"] * 5000}), "joints"),
        (content({**GOOD, "dt": 0}), "dt in its header"),
        (content({**GOOD, "dt": True}), "dt in its header"),
        (content({**GOOD, "dt": 10**400}), "dt in its header"),
        (content(b'{"joints": ["a"], "dt": NaN, "inputs": []}'), "dt in its header"),
        (content({**GOOD, "inputs": ["q_ref", "q_measured"]}), "inputs"),
        (content({**GOOD, "inputs": ["q_measured"]}), "inputs"),
        (content({**GOOD, "inputs": {"q_measured": 1, "q_ref": 2}}), "inputs"),
        (content(GOOD, one_row(event=3)), "row 0: event is 3"),
        (content(GOOD, one_row(status=5)), "row 0: status is 5"),
        (content(GOOD, one_row(reason=77)), "row 0: reason is 77"),
        (content(GOOD, one_row(joint=1)), "row 0: joint is 1"),
        (content(GOOD, one_row(tau=np.nan)), "row 0: tau"),
        (content(GOOD, one_row(number=9)), "row 1: number is 0 after 9"),
        (content(GOOD, one_row(number=2**63)), "number"),
    ],
)
def test_a_file_that_is_no_log_is_refused_in_a_line(bad: bytes, said: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.armlog"
    path.write_bytes(bad)
    with pytest.raises(RolloutError, match=said) as refused:
        logs.read(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_log_that_was_cut_off_keeps_its_whole_rows(tmp_path: Path) -> None:
    there = lossy()
    path = tmp_path / "cut.armlog"
    path.write_bytes(logs.pack(there)[:-5])
    np.testing.assert_array_equal(logs.read(path).rows["number"], there.rows["number"][:-1])


def test_damage_is_an_error_of_ours_or_another_log(tmp_path: Path) -> None:
    """Bytes changed at random: read, or refused in a line; what is read is within its bounds."""
    good = logs.pack(lossy())
    rng = np.random.default_rng(5)
    path = tmp_path / "d.armlog"
    refused = 0
    for _ in range(300):
        data = bytearray(good)
        for place in rng.integers(0, min(len(data), 2000), 1 + rng.integers(4)):
            data[place] = rng.integers(256)
        path.write_bytes(data)
        try:
            there = logs.read(path)
        except RolloutError:
            refused += 1
        else:
            assert np.isfinite(there.tau).all()
            assert there.fault is None or isinstance(there.fault, str)
    assert refused > 30


def by_hand(**columns: Any) -> logs.ArmLog:
    """A log of the arm whose rows are those numbers, 2 ms apart."""
    rows = np.zeros(len(columns["number"]), logs.row_type(("q_measured", "q_ref"), 3))
    for name, values in columns.items():
        rows[name] = values
    header = {"joints": list(ARM.joint_names), "dt": 2e-3, "inputs": ["q_measured", "q_ref"]}
    return logs.ArmLog(header, rows)


def test_a_log_begins_and_ends_with_its_samples_and_tells_its_first_fault() -> None:
    q, numbers = np.random.default_rng(0).normal(size=(5, 3)), [7, 8, 10, 11, 13]
    there = by_hand(number=numbers, q_measured=q, reason=[0, 0, 5, 8, 4], joint=[0, 1, 2, 1, 0])
    assert there.fault == f"0.02 s: REFERENCE ({ARM.joint_names[2]})"
    stopped, whole = (logs.to_rollout(each, ARM) for each in (there, by_hand(number=numbers, q_measured=q)))
    times = 2e-3 * np.array([0, 1, 3, 4, 6])
    for found in (stopped, whole):
        np.testing.assert_allclose(found["time"], times)
        np.testing.assert_allclose(found["v"], np.gradient(q, times, axis=0))
    told = ("status", "t_end", "fault", "fault_joint", "t_fault")
    assert [float(stopped[name]) for name in told] == pytest.approx([3, 6e-3, 5, 2, 6e-3])
    assert [float(whole[name]) for name in told[:4]] == pytest.approx([0, 12e-3, 0, -1])
    assert np.isnan(whole["t_fault"])


def test_samples_become_rows_after_a_start_with_the_first() -> None:
    rng = np.random.default_rng(1)
    inputs = {name: rng.normal(size=(4, 3)) for name in logs.INPUTS}
    tau, reports = rng.normal(size=(4, 3)), np.arange(12).reshape(4, 3)
    rows = logs.of_samples(ARM.joint_names, 1e-3, inputs, tau, reports).rows
    for name, values in {**inputs, "tau": tau}.items():
        np.testing.assert_array_equal(rows[name][1:], values)
        np.testing.assert_array_equal(rows[name][0], 0.0 * tau[0] if name == "tau" else values[0])
    told = np.array([rows[name] for name in ("number", "event", "elapsed")]).T
    np.testing.assert_array_equal(told, [[0, 1, 0], [0, 0, 1], [1, 0, 1], [2, 0, 1], [3, 0, 1]])
    np.testing.assert_array_equal([rows[name][1:] for name in ("status", "reason", "joint")], reports.T)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"event": [0, 3, 4, 0]}, "row 1: event is 3, expected below 3"),
        ({"tau": [[0], [0], [np.nan], [np.nan]]}, "row 2: tau"),
        ({"number": [4, 6, 5, 3]}, "row 2: number is 5 after 6"),
        ({"number": [0, 0, 0, 2**53]}, None),
        ({"number": [0, 0, 0, 2**53 + 2]}, "beyond 2^53"),
    ],
)
def test_the_first_of_damaged_rows_is_named(columns: Any, said: str | None, tmp_path: Path) -> None:
    path = logs.write(by_hand(**{"number": [0, 1, 2, 3], **columns}), tmp_path / "a.armlog")
    if said is None:
        assert logs.read(path).samples["number"][-1] == 2**53
    else:
        with pytest.raises(RolloutError, match=re.escape(said)):
            logs.read(path)


def test_a_file_and_its_header_may_be_as_long_as_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = logs.write(by_hand(number=[]), tmp_path / "a.armlog")
    size = path.stat().st_size
    monkeypatch.setattr(logs, "_LARGEST", size)
    monkeypatch.setattr(logs, "_LONGEST", size - 16)
    assert len(logs.read(path).rows) == 0
    for name in ("_LARGEST", "_LONGEST"):
        with monkeypatch.context() as smaller:
            smaller.setattr(logs, name, getattr(logs, name) - 1)
            with pytest.raises(RolloutError):
                logs.read(path)
    path.write_bytes(path.read_bytes()[:8] + struct.pack("<II", 1, 0))
    with pytest.raises(RolloutError, match="no JSON"):
        logs.read(path)


# The command.


def test_the_command_says_what_a_log_is_and_replays_an_export(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    pytest.importorskip("casadi", reason="casadi writes the C")
    options = ("--t-final", "0.2", "--controller", "gpi_auto", "--encoder-bits", "12")
    code, out, err = cli("export", "anthropomorphic3", *options, "-o", tmp_path / "c")
    assert code == 0, out + err
    file = tmp_path / "c" / "log.armlog"
    code, out, err = cli("log", file, "--replay", tmp_path / "c", "--csv", tmp_path / "log.csv")
    assert code == 0, out + err
    assert "200 samples" in out
    assert "the same torques to the bit in 200 samples" in out
    head, *rows = (tmp_path / "log.csv").read_text().splitlines()
    assert head.startswith("time,q_q1,q_q2,q_q3,")
    assert len(rows) == 200
    pytest.importorskip("matplotlib")
    code, out, err = cli("log", file, "--replay", tmp_path / "c", "--plot", tmp_path / "force.png")
    assert code == 0, out + err
    assert (tmp_path / "force.png").read_bytes().startswith(b"\x89PNG")
    assert f"wrote {tmp_path / 'force.png'}" in err
    same = tmp_path / "same.png"
    code, out, err = cli("log", file, "--replay", tmp_path / "c", "--plot", same, "--csv", same)
    assert (code, out) == (2, "")
    assert "--csv: is the same file as --plot" in err
    assert not same.exists()
    code, out, err = cli("log", file, "--plot", tmp_path / "none.png")
    assert code == 2
    assert err.splitlines() == [
        "error: command line: --plot: requires --replay FOLDER: the force is estimated by its robot"
    ]
    there = logs.read(file)
    given = {name: values[:1] for name, values in there.inputs.items()}
    one = logs.write(logs.of_samples(ARM.joint_names, 1e-3, given, there.tau[:1]), tmp_path / "one.armlog")
    code, out, err = cli("log", one, "--replay", tmp_path / "c", "--plot", tmp_path / "none.png")
    assert code == 2
    assert "--plot: needs a log of two samples at least" in err
    facts = json.loads(cli("log", file, "--json")[1])
    assert facts["missed"] == 0
    assert facts["fault"] is None
    # Another law: exit code 1, and which joint.
    shorter = ("--t-final", "0.2", "--controller", "gpi")
    code, out, err = cli("run", "anthropomorphic3", *shorter, "--out", tmp_path / "other")
    assert code == 0, out + err
    code, out, _ = cli("log", file, "--replay", tmp_path / "other" / "experiment.yaml")
    assert code == 1
    assert "apart" in out


def test_a_bad_log_is_one_line(cli: Callable[..., Answer], tmp_path: Path) -> None:
    (tmp_path / "bad.armlog").write_bytes(b"nothing")
    for arguments in (("log", tmp_path / "bad.armlog"), ("log", tmp_path / "none.armlog")):
        code, out, err = cli(*arguments)
        assert code == 2
        assert out == ""
        assert len(err.strip().splitlines()) == 1
