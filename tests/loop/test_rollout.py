"""Rollouts on disk: written whole, read back identical, and refused when they are anything else."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from armgpi import GPI, Bezier, RigidBodyPlant, Robot, RobotBatch, Status, Step, load, save, simulate
from armgpi.errors import RolloutError
from armgpi.loop import logs
from armgpi.loop.rollout import FORMAT, describe_end, load_variables

ARM = Robot.load("anthropomorphic3")
MOVE = Bezier([0.0, 0.0, 0.0], [0.4, 0.3, -0.2], duration=0.3)


def make(batch: int | None = None, **options: object) -> xr.Dataset:
    plant = RigidBodyPlant(ARM, Step([0.1, 0.0, 0.2], onset=0.05))
    q0 = np.zeros(3) if batch is None else np.zeros((batch, 3))
    return simulate(plant, GPI(ARM, 1e-3), MOVE, 0.1, q0=q0, **options)


def fallen() -> xr.Dataset:
    """A rollout of two that diverged: full of NaN from its end on."""
    controller = GPI(ARM, 1e-3, effort=[[30.0, 30.0, 15.0], [0.02, 0.02, 0.02]])
    return simulate(RigidBodyPlant(ARM), controller, MOVE, 0.3, divergence=0.2)


ROLLOUTS: dict[str, Callable[[], xr.Dataset]] = {
    "single": make,
    "batch": lambda: make(3),
    "thinned, with signals": lambda: make(record_every=7, signals=True),
    "diverged": fallen,
    "robot per rollout": lambda: simulate(
        RigidBodyPlant(RobotBatch([ARM, ARM.with_limits(effort=5.0)])), GPI(ARM, 1e-3), MOVE, 0.05
    ),
}


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save(make(), tmp_path_factory.mktemp("rollout") / "rollout.nc")


@pytest.mark.parametrize("kind", ROLLOUTS)
def test_what_is_read_is_identical_to_what_was_written(kind: str, tmp_path: Path) -> None:
    rollout = ROLLOUTS[kind]()
    back = load(save(rollout, tmp_path / "a.nc"))
    xr.testing.assert_identical(back, rollout)  # values, dimensions, coordinates and attributes
    for name, variable in rollout.variables.items():
        assert back[name].dtype == variable.dtype, name
        assert back[name].values.tobytes() == variable.values.tobytes(), name
    assert list(back.sizes) == list(rollout.sizes)


def test_writing_does_not_change_the_rollout(tmp_path: Path) -> None:
    rollout = make()
    before = rollout.copy(deep=True)
    save(rollout, tmp_path / "a.nc")
    assert rollout.identical(before)


def test_the_same_run_makes_the_same_file_byte_by_byte(tmp_path: Path) -> None:
    first = save(make(2), tmp_path / "a.nc").read_bytes()
    time.sleep(1.1)  # HDF5 keeps times in whole seconds, where it keeps any
    (tmp_path / "elsewhere").mkdir()
    assert save(make(2), tmp_path / "elsewhere" / "b.nc").read_bytes() == first


def test_a_file_is_replaced_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    target = tmp_path / "a.nc"
    target.write_text("something else")
    assert save(make(), str(target)) == target
    assert load(str(target)).identical(make())
    assert list(tmp_path.iterdir()) == [target]


def test_a_failed_write_leaves_the_old_file_and_no_partial_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = save(make(), tmp_path / "a.nc")
    before = target.read_bytes()

    def fail_half_way(path: Path, content: bytes) -> None:
        with path.open("wb") as file:
            file.write(content[: len(content) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fail_half_way)
    with pytest.raises(RolloutError, match=r"a\.nc: cannot be written: No space left"):
        save(make(), target)
    assert target.read_bytes() == before
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("where", ["missing/a.nc", "file/a.nc", "."])
def test_a_place_that_cannot_be_written_to_is_named(where: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(RolloutError, match="cannot be written") as refused:
        save(make(), tmp_path / where)
    assert str(tmp_path / where) in str(refused.value)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


# Reading what is no rollout.


def refused(path: Path) -> str:
    with pytest.raises(RolloutError) as error:
        load(path)
    text = str(error.value)
    assert str(path) in text
    assert "\n" not in text
    with pytest.raises(RolloutError) as without_xarray:
        load_variables(path, ("time", "q"))
    assert str(without_xarray.value) == text
    return text


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    assert "does not exist" in refused(tmp_path / "none.nc")
    assert "it is a folder" in refused(tmp_path)


@pytest.mark.parametrize(
    "content", [b"", b"\x89HDF\r\n\x1a\n", b"CDF\x01", b"PK\x03\x04", b"{}", b"\0" * 4096]
)
def test_what_is_no_netcdf_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    path.write_bytes(content)
    assert "not a readable NetCDF" in refused(path)


def test_a_netcdf_of_somebody_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    xr.Dataset({"q": ("time", np.zeros(3))}).to_netcdf(path, engine="h5netcdf")
    assert f"expected {FORMAT}; read it with" in refused(path)


@pytest.mark.parametrize("found", [FORMAT + 1, "1", [1, 2]])
def test_a_rollout_of_another_format_is_refused(found: object, tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    make().assign_attrs(armgpi_format=found).to_netcdf(path, engine="h5netcdf")
    assert f"expected {FORMAT}; read it with" in refused(path)


@pytest.mark.parametrize(
    ("damage", "named"),
    [
        (lambda whole: whole.assign_attrs(provenance="{"), "provenance is no JSON"),
        (lambda whole: whole.assign_attrs(provenance="[]"), "provenance is empty"),
        (lambda whole: whole.assign_coords(time=whole["time"].values[::-1]), "times do not increase"),
        (lambda whole: whole.assign_coords(time=np.arange(whole.sizes["time"]) // 2.0), "do not increase"),
        (
            lambda whole: whole.assign_coords(time=np.full(whole.sizes["time"], np.nan)),
            "times do not increase",
        ),
        (lambda whole: whole.assign(status=whole["status"] + 9), "status is"),
    ],
)
def test_a_rollout_that_cannot_be_is_refused(
    damage: Callable[[xr.Dataset], xr.Dataset], named: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.nc"
    damage(make()).to_netcdf(path, engine="h5netcdf")
    assert named in refused(path)


@pytest.mark.parametrize("lost", ["q", "tau", "status", "effort"])
def test_a_rollout_that_lacks_something_is_refused(lost: str, tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    make().drop_vars(lost).to_netcdf(path, engine="h5netcdf")
    assert refused(path).endswith(f"lacks {lost}")


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(0.0, 0.999))
def test_a_file_that_was_cut_is_refused(saved: Path, tmp_path: Path, share: float) -> None:
    content = saved.read_bytes()
    path = tmp_path / "cut.nc"
    path.write_bytes(content[: int(share * len(content))])
    assert "not a readable NetCDF" in refused(path)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_samples_are_never_read_as_if_they_were_whole(
    saved: Path, tmp_path: Path, data: st.DataObject
) -> None:
    content = bytearray(saved.read_bytes())
    at = data.draw(st.integers(0, len(content) - 1))
    content[at] ^= data.draw(st.integers(1, 255))
    path = tmp_path / "damaged.nc"
    path.write_bytes(content)
    try:
        rollout = load(path)
        variables = load_variables(path, ("q", "tau"))
    except RolloutError:
        return
    # The flipped byte was one that nothing depends on, or it is in labels, which carry no checksum.
    whole = load(saved)
    for name in ("q", "v", "tau", "q_ref"):
        np.testing.assert_array_equal(rollout[name], whole[name])
    for name, variable in variables.items():
        np.testing.assert_array_equal(variable.values, whole[name])


@pytest.mark.parametrize("kind", ROLLOUTS)
def test_variables_that_are_read_without_xarray_are_those_that_xarray_reads(
    kind: str, tmp_path: Path
) -> None:
    path = save(ROLLOUTS[kind](), tmp_path / "a.nc")
    whole = xr.load_dataset(path, engine="h5netcdf")
    names = [str(name) for name in whole.variables]
    variables = load_variables(path, [*names, "never recorded"])
    assert [*variables] == names
    for name, (dimensions, values) in variables.items():
        assert dimensions == whole[name].dims
        np.testing.assert_array_equal(values, whole[name].values)


def test_numbers_that_are_stored_scaled_are_not_read_as_they_are_stored(saved: Path, tmp_path: Path) -> None:
    path = tmp_path / "packed.nc"
    packed = {"tau": {"dtype": "i4", "scale_factor": 1e-3, "_FillValue": -(2**31)}}
    load(saved).to_netcdf(path, engine="h5netcdf", encoding=packed)
    with pytest.raises(RolloutError, match="'tau' is stored scaled"):
        load_variables(path, ("tau",))


# What a rollout says of itself.


def test_provenance_holds_the_hash_of_the_urdf_and_survives_the_disk(saved: Path) -> None:
    made = json.loads(load(saved).attrs["provenance"])
    source = Path(made["plant"]["robot"]["source"])
    assert made["plant"]["robot"]["sha256"] == hashlib.sha256(source.read_bytes()).hexdigest()
    assert made["controller"]["gains"]["type"] == "FixedGains"
    assert made["t_final"] == 0.1
    assert all(made["versions"].values())


def test_every_sampled_variable_has_a_name_and_units() -> None:
    rollout = make()
    for name in ("q", "v", "q_ref", "v_ref", "q_measured", "tau_command", "tau", "disturbance"):
        assert rollout[name].dims == ("time", "joint")
        assert {"long_name", "units"} <= set(rollout[name].attrs)
    assert list(rollout["joint"].values) == list(ARM.joint_names)
    assert rollout["time"].attrs["units"] == "s"
    assert list(rollout["status"].attrs["flag_meanings"].split()) == [s.name.lower() for s in Status]


def test_ends_are_told_in_words() -> None:
    assert describe_end(make()) == ["finished"]
    held, fell = describe_end(fallen())
    assert held == "finished"
    assert fell.startswith("diverged at 0.")


def test_netcdf_tools_other_than_ours_can_read_the_file(saved: Path, tmp_path: Path) -> None:
    import h5py

    copy = shutil.copy(saved, tmp_path / "copy.h5")
    with h5py.File(copy) as file:
        np.testing.assert_array_equal(file["q"][...], make()["q"])
        assert file["q"].attrs["units"] == "rad"


def test_a_log_for_other_tools_has_each_rollout_until_it_ends_in_the_order_of_times(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng, times = np.random.default_rng(3), np.array([0.0, 0.5, 1.25])
    names = ("q", "v", "tau", "q_ref", "v_ref", "q_measured")
    run = xr.Dataset(
        {name: (("rollout", "time", "joint"), rng.normal(size=(2, 3, 2))) for name in names},
        coords={"time": times, "joint": ["a", "b"], "label": ("rollout", ["gpi", "pid"])},
    )
    run["q"][1, 2] = np.nan  # the second ends before
    series = logs._series(run)
    for i, (label, end) in enumerate((("gpi", 3), ("pid", 2))):
        for entity, states in logs._STATES.items():
            if not any(name in run for name in states):
                continue
            at, fields = series[f"{label}/{entity}"]
            assert len(fields) == sum(name in run for name in states if name)
            np.testing.assert_array_equal(at, times[:end])
            for field, name in zip(logs._FIELDS, states, strict=False):
                if name in run:
                    np.testing.assert_array_equal(fields[field], run[name].values[i, :end])
    reader = pytest.importorskip("mcap.reader")
    whole = reader.make_reader(io.BytesIO(logs._mcap(series, ["a", "b"])))
    read = [
        (message.log_time, channel.topic, json.loads(message.data))
        for _, channel, message in whole.iter_messages(log_time_order=False)
    ]
    assert [stamp for stamp, *_ in read] == sorted(stamp for stamp, *_ in read)
    assert {stamp for stamp, *_ in read} == {0, 500_000_000, 1_250_000_000}
    assert len(read) == sum(len(at) for at, _ in series.values())
    for stamp, topic, message in read:
        at, fields = series[topic.removeprefix("/")]
        assert message["timestamp"] == {"sec": stamp // 10**9, "nsec": stamp % 10**9}
        assert all(
            message[field] == values[at == stamp / 1e9][0].tolist() for field, values in fields.items()
        )
    sent: dict[str, Any] = {}
    stream = SimpleNamespace(
        memory_recording=lambda: SimpleNamespace(drain_as_bytes=lambda: b""),
        send_columns=lambda name, clock, columns: sent.update({name: (clock[0], columns)}),
    )
    fake = SimpleNamespace(
        RecordingStream=lambda *_, **__: stream,
        TimeColumn=lambda _, duration: duration,
        Scalars=SimpleNamespace(columns=lambda scalars: scalars),
    )
    monkeypatch.setitem(sys.modules, "rerun", fake)
    logs._rerun(series, ["a", "b"])
    for name, (at, fields) in series.items():
        for field, values in fields.items():
            for j, joint in enumerate("ab"):
                np.testing.assert_array_equal(sent[f"{name}/{field}/{joint}"], (at, values[:, j]))
