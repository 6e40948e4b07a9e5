"""Vector arithmetic of the generated code: the same bits in every lane, and errors within what is stated."""

from __future__ import annotations

import ctypes
from functools import cache
from importlib.resources import files

import numpy as np
import numpy.typing as npt
import pytest

from armgpi.codegen import build

Array = npt.NDArray[np.float64]

WIDTHS = (1, 4, 8)
#: Functions of one number, and what each is in C.
UNARY = ("sin", "cos", "rint", "floor", "abs", "sign", "sqrt", "log", "exp")
#: Functions of three numbers a, b and c.
TERNARY = {
    "min": "v_min(a, b)",
    "max": "v_max(a, b)",
    "less": "v_number(v_lt(a, b))",
    "less_equal": "v_number(v_le(a, b))",
    "equal": "v_number(v_eq(a, b))",
    "not_equal": "v_number(v_ne(a, b))",
    "not": "v_number(v_not(v_lt(a, b)))",
    "and": "v_number(v_lt(a, b) & v_lt(b, c))",
    "or": "v_number(v_lt(a, b) | v_lt(b, c))",
    "only": "v_only(v_lt(a, b), c)",
    "select": "v_select(v_lt(a, b), b, c)",
    "any": "v_set((double)(v_any(v_lt(a, b)) != 0))",
}
ODD = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, -5e-324, 2.2250738585072014e-308, 1e300, -1e300])


@cache
def library(lanes: int) -> ctypes.CDLL:
    bodies = {name: f"v_{name}(a)" for name in UNARY} | TERNARY
    loops = [
        f"void f_{name}(const double *x, const double *y, const double *z, double *out, int64_t n) {{"
        " for (int64_t i = 0; i < n; i += LANES) { V a, b, c; memcpy(&a, x + i, sizeof a);"
        " memcpy(&b, y + i, sizeof b); memcpy(&c, z + i, sizeof c);"
        f" const V r = {body}; memcpy(out + i, &r, sizeof r); }} }}"
        for name, body in bodies.items()
    ]
    text = (files("armgpi.codegen") / "lanes.h").read_text()
    return build.library("\n".join([f"#define LANES {lanes}", text, *loops]))


def run(lanes: int, name: str, x: Array, y: Array | None = None, z: Array | None = None) -> Array:
    """Return the values of a function by so many lanes; the numbers are padded to whole vectors."""
    size = -(-len(x) // 8) * 8
    given = (x, x if y is None else y, x if z is None else z)
    arrays = [np.resize(np.ascontiguousarray(part), size) for part in given]
    out = np.empty(size)
    pointers = [ctypes.c_void_p(part.ctypes.data) for part in (*arrays, out)]
    getattr(library(lanes), f"f_{name}")(*pointers, ctypes.c_int64(size))
    return out[: len(x)]


def bits(x: Array) -> npt.NDArray[np.int64]:
    """Return the bits of numbers, those of all NaNs alike."""
    return np.where(np.isnan(x), np.nan, x).view(np.int64)


def angles() -> Array:
    """Return angles of all sizes up to 1e6, and those beside multiples of pi / 4, the hardest ones."""
    rng = np.random.default_rng(0)
    count = 100_000
    sizes = 10.0 ** rng.uniform(-12.0, 6.0, count) * rng.choice([-1.0, 1.0], count)
    wide = rng.uniform(-1e6, 1e6, count)
    multiples = rng.integers(-1_270_000, 1_270_000, count) * (np.pi / 4.0)
    beside = [np.nextafter(multiples, way) for way in (-np.inf, np.inf)]
    return np.concatenate([sizes, wide, multiples, *beside, multiples + rng.normal(0.0, 1e-9, count)])


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sines_are_as_right_as_is_stated(name: str) -> None:
    if np.finfo(np.longdouble).eps > 1e-18:
        pytest.skip("this machine has no numbers longer than a double")
    x = angles()
    # The C library reduces a long double by a pi as long as it takes: right to 1e-19.
    exact = getattr(np, name)(x.astype(np.longdouble))
    for lanes in WIDTHS:
        wrong = np.abs(run(lanes, name, x) - exact).max()
        assert wrong < 1.6e-16, f"{lanes} lanes: {float(wrong):.3g}"


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sines_of_what_is_no_number_are_none(name: str) -> None:
    x = np.array([np.inf, -np.inf, np.nan])
    for lanes in WIDTHS:
        assert np.isnan(run(lanes, name, x)).all()
    # A neighbour that is no number changes nothing.
    mixed = np.array([0.1, np.nan, 0.2, np.inf, 0.3, -np.inf, 0.4, 0.5])
    np.testing.assert_array_equal(run(8, name, mixed)[[0, 2, 4, 6, 7]], run(1, name, mixed[[0, 2, 4, 6, 7]]))


@pytest.mark.parametrize("name", [name for name in UNARY if name not in ("sin", "cos")])
def test_functions_of_one_number_are_numpys(name: str) -> None:
    rng = np.random.default_rng(1)
    halves = rng.integers(-1000, 1000, 1000) / 2.0
    wide = 10.0 ** rng.uniform(-300.0, 300.0, 2000) * rng.choice([-1.0, 1.0], 2000)
    edges = np.array([2.0**k + d for k in (50, 51, 52, 53) for d in (-1.0, -0.5, 0.0, 0.5, 1.0)])
    x = np.concatenate(
        [ODD, halves, np.nextafter(halves, np.inf), wide, edges, -edges, rng.normal(size=2000)]
    )
    with np.errstate(all="ignore"):
        expected = getattr(np, name)(x)
    # exp and log are the C library's: both are within one unit in the last place of what is right.
    ulps = 2 if name in ("exp", "log") else 0
    for lanes in WIDTHS:
        got = run(lanes, name, x)
        np.testing.assert_array_equal(np.isnan(got), np.isnan(expected))
        good = np.isfinite(expected)
        np.testing.assert_array_equal(got[~good], expected[~good])
        wrong = np.abs(got[good] - expected[good])
        assert (wrong <= ulps * np.spacing(np.abs(expected[good]))).all()


@pytest.mark.parametrize("name", TERNARY)
def test_functions_of_several_numbers_are_numpys(name: str) -> None:
    grid = np.array([0.0, -0.0, 1.0, -1.0, 2.5, np.inf, -np.inf, np.nan])
    a, b, c = (part.ravel() for part in np.meshgrid(grid, grid, grid, indexing="ij"))
    less = a < b
    expected = {
        "min": np.minimum(a, b),
        "max": np.maximum(a, b),
        "less": less,
        "less_equal": a <= b,
        "equal": a == b,
        "not_equal": a != b,
        "not": ~less,
        "and": less & (b < c),
        "or": less | (b < c),
        "only": np.where(less, c, 0.0),
        "select": np.where(less, b, c),
    }
    for lanes in WIDTHS:
        got = run(lanes, name, a, b, c)
        groups = less.reshape(-1, lanes).any(axis=1).repeat(lanes)
        np.testing.assert_array_equal(got, expected.get(name, groups).astype(float))


@pytest.mark.parametrize("name", [*UNARY, *TERNARY])
def test_every_lane_of_every_width_gives_the_same_bits(name: str) -> None:
    if name == "any":
        return  # it looks at all lanes of a vector
    rng = np.random.default_rng(2)
    a, b, c = (np.concatenate([ODD, rng.normal(0.0, 10.0 ** rng.uniform(-3, 6, 4000))]) for _ in range(3))
    expected = bits(run(1, name, a, b, c))
    for lanes in (4, 8):
        for shift in range(lanes):
            moved = [np.roll(part, shift) for part in (a, b, c)]
            np.testing.assert_array_equal(np.roll(bits(run(lanes, name, *moved)), -shift), expected)


def test_no_product_is_fused_with_a_sum() -> None:
    # GCC 12 makes one instruction of this pair whatever -ffp-contract says, unless told not to make vectors.
    a = np.array([1.0 + 2.0**-30, 1.0 + 2.0**-30])
    parts = (a, a, np.array([1.0, -1.0]), np.empty(2))
    pair = build.library(
        "void pair(const double *restrict a, const double *restrict b, const double *restrict c,"
        " double *restrict y) { y[0] = a[0] * b[0] - c[0]; y[1] = a[1] * b[1] + c[1]; }"
    )
    pair.pair(*(ctypes.c_void_p(part.ctypes.data) for part in parts))
    np.testing.assert_array_equal(parts[-1], a * a - 1.0)
