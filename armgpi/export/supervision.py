"""The supervision of an exported controller: checks of arguments, jumps and frozen sensors, as C."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from armgpi.arrays import Array
from armgpi.export.faults import Bounds
from armgpi.export.layout import filled, rows

# Each check is one function and one call of it, left out whole where it is switched off, so that no code is
# there that never runs. Calls come in the order of the reasons: a NaN is no jump, a jump is not frozen.
_HOLD = """\
    if (state->status == ARMGPI_STATUS_RUN) {
        law_hold(state->q_last, state->tau_fault);
    }
"""
_JUMP = """
/* Return the first joint whose position moved farther than it can in one sample, ARMGPI_N when none did. */
static uint32_t first_jump(const armgpi_state_t *state, const armgpi_real_t q[ARMGPI_N])
{
    uint32_t joint = 0U;

    while ((joint < ARMGPI_N) && (fabs{f}(q[joint] - state->q_last[joint]) <= JUMP[joint])) {
        ++joint;
    }
    return joint;
}
"""
_JUMP_CALL = """\
        if (reason == ARMGPI_REASON_NONE) {
            joint = first_jump(state, q_measured);
            if (joint < ARMGPI_N) {
                reason = ARMGPI_REASON_JUMP;
            }
        }
"""
_FROZEN = """
/* Return the first joint whose position should have changed and did not, ARMGPI_N when none. An arm at rest
   repeats one number as a dead sensor does; so a change is expected only where, since the last one, the
   reference has moved on or the torque has changed by more than the arm's weight explains. */
static uint32_t first_frozen(armgpi_state_t *state, const armgpi_real_t q[ARMGPI_N],
    const armgpi_real_t q_ref[ARMGPI_N], const armgpi_real_t tau[ARMGPI_N])
{
    armgpi_real_t weight[ARMGPI_N];
    uint32_t joint = ARMGPI_N;
    uint32_t i;

    law_hold(q, weight);
    for (i = 0U; i < ARMGPI_N; ++i) {
        const armgpi_real_t excess = tau[i] - weight[i];

        if ((state->first != 0U) || (q[i] < state->q_last[i]) || (q[i] > state->q_last[i])) {
            state->q_ref_mark[i] = q_ref[i];
            state->excess_mark[i] = excess;
            state->frozen_count[i] = 0U;
        } else if ((fabs{f}(q_ref[i] - state->q_ref_mark[i]) <= FROZEN_TRAVEL[i])
            && (fabs{f}(excess - state->excess_mark[i]) <= FROZEN_TORQUE[i])) {
            state->frozen_count[i] = 0U;
        } else {
            ++state->frozen_count[i];
            if ((state->frozen_count[i] >= FROZEN_SAMPLES) && (joint == ARMGPI_N)) {
                joint = i;
            }
        }
    }
    state->first = 0U;
    return joint;
}
"""
_FROZEN_CALL = """\
        if (reason == ARMGPI_REASON_NONE) {
            joint = first_frozen(state, q_measured, q_ref, tau_out);
            if (joint < ARMGPI_N) {
                reason = ARMGPI_REASON_FROZEN;
            }
        }
"""


def supervision(
    bounds: Bounds, inputs: Iterable[str], joints: Sequence[str], ending: str, literal: Callable[[float], str]
) -> dict[str, str]:
    """Return what the source's template needs of the supervision: name -> C.

    Args:
        bounds: the numbers to compare with.
        inputs: names of a step's arguments.
        joints: names of the joints.
        ending: that of literals, "" or "F".
        literal: writes a number.
    """
    return {
        "bounds": _bounds(bounds, joints, literal),
        "checks": _checks(inputs),
        "jump_check": "",
        "jump_call": "",
        **(_jump(ending) if bounds.jump is not None else {}),
        **dict.fromkeys(("frozen_check", "frozen_call", "frozen_init", "frozen_first"), ""),
        **(_frozen(ending, literal(0.0)) if bounds.frozen_samples else {}),
        "hold": _HOLD if bounds.action == "hold" else "",
    }


def _bounds(limits: Bounds, joints: Sequence[str], literal: Callable[[float], str]) -> str:
    """Return the tables of the supervision."""
    parts: list[tuple[str, str, Array]] = []
    # Where there is no limit it is REAL_MAX, beyond which nothing is: no branch is needed.
    if limits.jump is not None:
        parts.append(("JUMP", "Largest change of a position in one sample [rad or m].", limits.jump))
    if limits.frozen_samples:
        travel = "Travel of the reference that asks a position to change [rad or m]."
        torque = "Change of torque less weight that asks a position to change [N m or N]."
        parts += [("FROZEN_TRAVEL", travel, limits.travel), ("FROZEN_TORQUE", torque, limits.torque)]
    texts = [
        f"/* {note} */\nstatic const armgpi_real_t {name}[ARMGPI_N] = {{\n"
        f"{rows([literal(x) for x in values], joints)}\n}};\n"
        for name, note, values in parts
    ]
    if limits.frozen_samples:
        texts.append(
            "/* Samples without a change, while one is asked for, that make a position frozen. */\n"
            f"static const uint32_t FROZEN_SAMPLES = {limits.frozen_samples}U;\n"
        )
    return "\n".join(texts)


def _checks(inputs: Iterable[str]) -> str:
    """Return the tests of arguments for numbers that are not finite."""
    # The first reason stays: what comes after it may follow from it.
    lines: list[str] = []
    for name in inputs:
        reason = "MEASUREMENT" if name.endswith("measured") else "REFERENCE"
        test = [
            f"*joint = first_not_finite({name});",
            "if (*joint < ARMGPI_N) {",
            f"    reason = ARMGPI_REASON_{reason};",
            "}",
        ]
        if lines:
            test = ["if (reason == ARMGPI_REASON_NONE) {", *(f"    {line}" for line in test), "}"]
        lines += [f"    {line}" for line in test]
    return "\n".join(lines)


def _jump(ending: str) -> dict[str, str]:
    """Return the test for positions that jump, and its use."""
    return {"jump_check": filled(_JUMP, {"f": ending.lower()}), "jump_call": _JUMP_CALL}


def _frozen(ending: str, zero: str) -> dict[str, str]:
    """Return the test for positions that do not change, and its uses."""
    return {
        "frozen_check": filled(_FROZEN, {"f": ending.lower()}),
        "frozen_call": _FROZEN_CALL,
        "frozen_init": (
            "            state->q_ref_mark[i] = q_ref[i];\n"
            f"            state->excess_mark[i] = {zero};\n"
            "            state->frozen_count[i] = 0U;\n"
        ),
        "frozen_first": "        state->first = 1U;\n",
    }
