"""What a rollout was made from: read back as it was written, alone, joined or damaged."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from armgpi import GPI, Hold, PIDInversion, RigidBodyPlant, Robot, simulate
from armgpi.config.experiment import join
from armgpi.errors import RolloutError
from armgpi.loop.provenance import Provenance, versions

ARM = Robot.load("anthropomorphic3")
RUNS = {
    name: simulate(RigidBodyPlant(ARM), controller, Hold(ARM.middle()), 0.01)
    for name, controller in (("gpi", GPI(ARM, 1e-3)), ("pid", PIDInversion(ARM, 1e-3)))
}


def test_a_rollout_says_what_it_was_made_from() -> None:
    found = Provenance.from_rollout(RUNS["gpi"])
    assert found.labels == ()
    assert found.first is found.of("gpi") is found
    assert found.measurement == "Measurement"
    assert found.backend == "numpy"
    assert found.robot["sha256"] == ARM.provenance["sha256"]
    assert found.robot["source"] == str(ARM.provenance["source"])
    assert found.controller == json.loads(json.dumps(GPI(ARM, 1e-3).describe()))
    assert found.reference == json.loads(json.dumps(Hold(ARM.middle()).describe()))
    assert found.versions == versions()
    assert found.at("divergence") == 10.0


def test_joined_rollouts_say_it_by_label() -> None:
    found = Provenance.from_rollout(join(RUNS))
    assert found.labels == ("gpi", "pid")
    for label, run in RUNS.items():
        assert found.of(label) == Provenance.from_rollout(run)
    assert found.of("pid").measurement == "FullState"
    assert found.first == found.of("gpi")


def test_a_label_may_be_any_word() -> None:
    found = Provenance.from_rollout(join({"plant": RUNS["gpi"], "measurement": RUNS["pid"]}))
    assert set(found.labels) == {"plant", "measurement"}
    assert found.of("measurement").measurement == "FullState"


@pytest.mark.parametrize("text", [None, "", "{", "[]", "{}", "3", "null"])
def test_what_is_no_provenance_is_refused(text: str | None) -> None:
    attrs = {} if text is None else {"provenance": text}
    with pytest.raises(RolloutError, match=r"its provenance is (no JSON|empty)"):
        Provenance.from_rollout(xr.Dataset(attrs=attrs))


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text() | st.floats(),
    lambda parts: st.lists(parts, max_size=3) | st.dictionaries(st.text(), parts, max_size=3),
    max_leaves=10,
)


@given(st.dictionaries(st.text(), PLAIN, min_size=1, max_size=4))
def test_json_goes_there_and_back(data: dict[str, Any]) -> None:
    def finite(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: finite(item) for key, item in value.items()}
        if isinstance(value, list):
            return [finite(item) for item in value]
        return str(value) if isinstance(value, float) and not math.isfinite(value) else value

    for indent in (None, 1):
        text = Provenance(data).to_json(indent)
        assert json.loads(text) == finite(data)
        assert Provenance.from_rollout(xr.Dataset(attrs={"provenance": text})).data == finite(data)


@given(st.dictionaries(st.sampled_from(["plant", "measurement", "versions", "a"]), PLAIN, min_size=1))
def test_damaged_data_ends_in_a_default_or_in_an_error_of_ours(data: dict[str, Any]) -> None:
    found = Provenance(data).first
    assert dict(found.robot) is not None
    assert dict(found.versions) is not None
    assert dict(found.reference) == {}
    assert found.backend == "unknown"
    if isinstance(data.get("measurement"), str):
        assert found.measurement == data["measurement"]
    elif not Provenance(data).labels:
        with pytest.raises(RolloutError, match="does not record how it was made"):
            _ = found.measurement
