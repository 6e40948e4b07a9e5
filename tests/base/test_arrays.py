"""What may be given as an array and what may not: nothing doubtful reaches Pinocchio."""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from armgpi.base.arrays import (
    as_float_array,
    as_joint_array,
    as_number,
    check_number,
    check_whole,
    frozen,
    not_negative,
    per_joint,
    positive,
)
from armgpi.errors import ArmgpiError, ArrayError, ParameterError

NAMES = ("shoulder", "elbow")
numbers = st.floats(allow_nan=False, allow_infinity=False)


# --- What is taken -------------------------------------------------------------------------------


@given(npst.arrays(np.float64, npst.array_shapes(min_dims=0, min_side=0), elements=numbers))
def test_a_finite_float64_array_comes_through_as_it_is(array: Any) -> None:
    for same in (array, array.tolist()) if array.size else (array,):
        result = as_float_array(same, "x")
        np.testing.assert_array_equal(result, array, strict=True)
        assert result.flags.c_contiguous


@pytest.mark.parametrize(
    "view",
    [
        np.asfortranarray(np.arange(6.0).reshape(3, 2)),
        np.arange(12.0).reshape(3, 4)[:, ::2],
        np.arange(6.0).reshape(2, 3).T,
        np.broadcast_to(np.array([1.0, 2.0]), (3, 2)),
        np.arange(6.0).reshape(3, 2)[::-1],
    ],
)
def test_an_array_of_any_layout_becomes_contiguous_with_the_same_elements(view: Any) -> None:
    result = as_joint_array(view, "q", NAMES)
    np.testing.assert_array_equal(result, view, strict=True)
    assert result.flags.c_contiguous


@pytest.mark.parametrize(
    "plain",
    [
        [1, 2],
        (1, 2.0),
        range(1, 3),
        [np.float32(1.0), np.int64(2)],
        [np.array(1.0), 2.0],
        [Decimal(1), Fraction(2)],
    ],
)
def test_plain_python_numbers_are_taken(plain: Any) -> None:
    expected = np.array([1.0, 2.0])
    np.testing.assert_array_equal(as_joint_array(plain, "q", NAMES), expected, strict=True)


# --- What is not ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "dtype", ["float32", "float16", ">f8", "int64", "bool", "complex128", "object", "U3"]
)
def test_an_array_of_another_dtype_is_refused_with_the_dtype_and_the_remedy(dtype: str) -> None:
    array = np.ones(2).astype(dtype)
    with pytest.raises(ArrayError, match="expected a native float64 array, got dtype") as caught:
        as_joint_array(array, "q", NAMES)
    assert caught.value.name == "q"
    assert repr(array.dtype.str) in str(caught.value)
    assert "astype(np.float64)" in str(caught.value)


def test_a_big_endian_array_is_refused_because_pinocchio_would_misread_it() -> None:
    array = np.array([1.0, 2.0], dtype=">f8")
    assert not np.array_equal(array.view("<f8"), array)  # what its bytes mean here
    with pytest.raises(ArrayError, match=">f8"):
        as_float_array(array, "x")


@pytest.mark.parametrize(
    "value",
    [
        True,
        np.True_,
        "1.0",
        b"1.0",
        ["1.0", "2.0"],
        [1.0, True],
        [[1.0, 2.0], [3.0, False]],
        [np.True_, 2.0],
        [np.array(True), 2.0],
        [np.array([True, False]), np.array([True, True])],
        [np.array(["1", "2"])],
        [np.complex128(1j), 0.0],
        [1j, 0.0],
        [np.datetime64("2022-01-01"), np.datetime64("2022-01-02")],
        [[1.0, 2.0], [3.0]],
        [1.0, [2.0]],
        [10**400, 0],
        {"shoulder": 1.0},
        {1.0, 2.0},
        (x for x in [1.0, 2.0]),
        object(),
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_holds_no_plain_numbers_is_refused(value: Any) -> None:
    for check in (
        lambda: as_float_array(value, "x"),
        lambda: as_joint_array(value, "x", NAMES),
        lambda: as_number(value, "x"),
        lambda: per_joint(value, "x", NAMES, "any", np.isfinite),
    ):
        with pytest.raises(ArrayError) as caught:
            check()
        assert caught.value.name == "x"
        assert isinstance(caught.value, ArmgpiError)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_refused_with_its_place_and_joint(bad: float) -> None:
    with pytest.raises(ArrayError, match=rf"q\[1\] = {bad} \(joint 'elbow'\)"):
        as_joint_array([0.0, bad], "q", NAMES)
    with pytest.raises(ArrayError, match=rf"q\[2, 0\] = {bad} \(joint 'shoulder'\)"):
        as_joint_array([[0.0, 0.0], [0.0, 0.0], [bad, bad]], "q", NAMES)
    with pytest.raises(ArrayError, match=rf"x\[0\] = {bad}"):
        as_float_array([bad], "x")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_lone_number_that_is_not_finite_is_refused_as_well(bad: float) -> None:
    for value in (bad, np.array(bad), np.float64(bad)):
        with pytest.raises(ArrayError, match=rf"x = {bad}"):
            as_float_array(value, "x")
        with pytest.raises(ArrayError, match=rf"x = {bad}"):
            as_number(value, "x")
        with pytest.raises(ArrayError, match=rf"x = {bad}"):
            per_joint(value, "x", NAMES, "any", np.isfinite)


def test_none_is_no_number() -> None:
    for check in (as_float_array, as_number):
        with pytest.raises(ArrayError):
            check(None, "x")


def test_infinity_passes_where_it_means_no_limit_and_nan_never() -> None:
    limits = as_float_array([1.0, np.inf, -np.inf], "limit", infinite=True)
    np.testing.assert_array_equal(limits, [1.0, np.inf, -np.inf])
    assert as_number(np.inf, "limit", infinite=True) == np.inf
    with pytest.raises(ArrayError, match=r"limit\[1\] = nan"):
        as_float_array([np.inf, np.nan], "limit", infinite=True)


# --- Shapes --------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(), (1,), (3,), (0,), (2, 1), (2, 3), (2, 0), (1, 1, 2)])
def test_a_shape_that_is_neither_a_state_nor_a_batch_is_refused_naming_the_joints(
    shape: tuple[int, ...],
) -> None:
    with pytest.raises(ArrayError) as caught:
        as_joint_array(np.zeros(shape), "q", NAMES)
    for part in ("(2,) or (batch, 2)", "shoulder, elbow", str(shape)):
        assert part in str(caught.value)


@pytest.mark.parametrize("shape", [(2,), (1, 2), (5, 2), (0, 2)])
def test_states_and_batches_of_them_are_taken_also_empty_ones(shape: tuple[int, ...]) -> None:
    assert as_joint_array(np.zeros(shape), "q", NAMES).shape == shape


@pytest.mark.parametrize("shape", [(1,), (2,), (1, 1)])
def test_one_number_is_not_an_array_of_one(shape: tuple[int, ...]) -> None:
    with pytest.raises(ArrayError, match="expected one number"):
        as_number(np.ones(shape), "x")
    assert as_number(np.array(2.0), "x") == as_number(2, "x") == 2.0


# --- Parameters per joint ------------------------------------------------------------------------


@given(
    npst.broadcastable_shapes((4, 2), min_dims=0, max_dims=2, min_side=1).flatmap(
        lambda shape: npst.arrays(np.float64, shape, elements=st.floats(0.5, 2.0))
    )
)
def test_a_parameter_per_joint_broadcasts_as_numpy_would(array: Any) -> None:
    result = per_joint(array, "gain", NAMES, "positive", positive)
    assert result.shape[-1] == len(NAMES)
    assert result.flags.c_contiguous
    np.testing.assert_array_equal(result + np.zeros((4, 2)), array + np.zeros((4, 2)))


@pytest.mark.parametrize("shape", [(3,), (0,), (2, 3), (2, 2, 2), (1, 1, 1)])
def test_a_parameter_that_does_not_fit_the_joints_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ArrayError, match=r"\(2,\) or \(batch, 2\), got"):
        per_joint(np.ones(shape), "gain", NAMES, "positive", positive)


def test_a_parameter_out_of_range_is_refused_with_the_joint_it_is_for() -> None:
    with pytest.raises(ArrayError, match="gain: expected positive values, got 0 for joint 'elbow'"):
        per_joint([[1.0, 2.0], [3.0, 0.0]], "gain", NAMES, "positive", positive)
    with pytest.raises(ArrayError, match="got -1 for joint 'shoulder'"):
        per_joint(-1.0, "gain", NAMES, "zero or positive", not_negative)
    np.testing.assert_array_equal(per_joint(0, "x", NAMES, "zero or positive", not_negative), [0, 0])


@pytest.mark.parametrize("value", [1, 1.0, np.float64(1.0), np.float32(1.0), np.int64(1)])
def test_a_number_of_any_kind_becomes_a_float(value: Any) -> None:
    number = check_number(value, "dt", "positive [s]", open_=True)
    assert type(number) is float
    assert number == 1.0


@pytest.mark.parametrize(
    "value",
    [0.0, -1.0, 2.1, np.nan, np.inf, True, np.True_, "1", None, [1.0], np.array(1.0), 1j, 10**400],
)
def test_a_number_out_of_range_and_what_is_none_are_refused_with_what_was_given(value: Any) -> None:
    with pytest.raises(ParameterError, match=r"^dt must be positive, got") as caught:
        check_number(value, "dt", "positive", highest=2.0, open_=True)
    assert caught.value.name == "dt"
    assert caught.value.value is value


def test_bounds_belong_to_the_range_unless_it_is_open_below() -> None:
    assert check_number(0.0, "x", "any") == 0.0
    assert check_number(2.0, "x", "any", 1.0, 2.0) == 2.0
    with pytest.raises(ParameterError):
        check_number(1.0, "x", "any", 1.0, 2.0, open_=True)


@pytest.mark.parametrize("value", [3, np.int64(3), np.uint8(3)])
def test_a_whole_number_of_any_kind_becomes_an_int(value: Any) -> None:
    assert type(check_whole(value, "k", 3, 3)) is int


@pytest.mark.parametrize("value", [2, 6, 3.0, np.float64(3.0), True, "3", None, [3], 10**400])
def test_a_whole_number_out_of_range_and_what_is_none_are_refused(value: Any) -> None:
    with pytest.raises(ParameterError, match=r"^k must be a whole number, from 3 to 5, got"):
        check_whole(value, "k", 3, 5)


def test_without_a_highest_whole_number_only_the_lowest_is_told() -> None:
    with pytest.raises(ParameterError, match="a whole number, at least 1, got 0"):
        check_whole(0, "k", 1)


def test_what_is_frozen_is_a_copy_that_nobody_can_change() -> None:
    array = np.array([1.0, 2.0])
    kept = frozen(array)
    array[0] = 9.0
    np.testing.assert_array_equal(kept, [1.0, 2.0])
    with pytest.raises(ValueError, match="read-only"):
        kept[0] = 9.0
