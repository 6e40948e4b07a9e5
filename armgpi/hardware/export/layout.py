"""C as text: bodies, tables, structs and the elementary functions that the emitter's C calls."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from armgpi.hardware.export.names import plain

#: The emitter's elementary functions on one number; {R} is its type, {F} ends literals, {f} functions.
#: Booleans are uint32_t, on which & and | work in C99 as they do on the masks of `lanes.h`.
_ELEMENTARY = {
    "v_lt": "static inline uint32_t v_lt({R} a, {R} b) { return (a < b) ? 1U : 0U; }",
    "v_le": "static inline uint32_t v_le({R} a, {R} b) { return (a <= b) ? 1U : 0U; }",
    "v_eq": "static inline uint32_t v_eq({R} a, {R} b) { return ((a <= b) && (a >= b)) ? 1U : 0U; }",
    "v_ne": "static inline uint32_t v_ne({R} a, {R} b) { return ((a <= b) && (a >= b)) ? 0U : 1U; }",
    "v_and": "static inline uint32_t v_and(uint32_t a, uint32_t b) { return a & b; }",
    "v_or": "static inline uint32_t v_or(uint32_t a, uint32_t b) { return a | b; }",
    "v_not": "static inline uint32_t v_not(uint32_t m) { return (m != 0U) ? 0U : 1U; }",
    "v_only": "static inline {R} v_only(uint32_t m, {R} x) { return (m != 0U) ? x : 0.0{F}; }",
    "v_select": "static inline {R} v_select(uint32_t m, {R} x, {R} y) { return (m != 0U) ? x : y; }",
    "v_number": "static inline {R} v_number(uint32_t m) { return (m != 0U) ? 1.0{F} : 0.0{F}; }",
    # NaN on either side comes out, so that the supervision finds it.
    "v_min": "static inline {R} v_min({R} a, {R} b) { return ((a < b) || !(a >= a)) ? a : b; }",
    "v_max": "static inline {R} v_max({R} a, {R} b) { return ((b < a) || !(a >= a)) ? a : b; }",
    "v_lower": "static inline {R} v_lower({R} a, {R} b) { return (b < a) ? b : a; }",
    "v_upper": "static inline {R} v_upper({R} a, {R} b) { return (a < b) ? b : a; }",
    "v_abs": "static inline {R} v_abs({R} x) { return fabs{f}(x); }",
    "v_sin": "static inline {R} v_sin({R} x) { return sin{f}(x); }",
    "v_cos": "static inline {R} v_cos({R} x) { return cos{f}(x); }",
    "v_sqrt": "static inline {R} v_sqrt({R} x) { return sqrt{f}(x); }",
    "v_exp": "static inline {R} v_exp({R} x) { return exp{f}(x); }",
    "v_log": "static inline {R} v_log({R} x) { return log{f}(x); }",
    "v_tan": "static inline {R} v_tan({R} x) { return tan{f}(x); }",
    "v_tanh": "static inline {R} v_tanh({R} x) { return tanh{f}(x); }",
    "v_atan": "static inline {R} v_atan({R} x) { return atan{f}(x); }",
    "v_fmod": "static inline {R} v_fmod({R} x, {R} y) { return fmod{f}(x, y); }",
    "v_floor": "static inline {R} v_floor({R} x) { return floor{f}(x); }",
    "v_rint": "static inline {R} v_rint({R} x) { return rint{f}(x); }",
    "v_sign": (
        "static inline {R} v_sign({R} x)\n"
        "{\n    return (x > 0.0{F}) ? 1.0{F} : ((x < 0.0{F}) ? -1.0{F} : 0.0{F});\n}"
    ),
}
_ANY_NONZERO = """
/* Tell whether any of so many numbers is not zero. */
static uint32_t any_nonzero(const armgpi_real_t x[], uint32_t count)
{
    uint32_t i;
    uint32_t found = 0U;

    for (i = 0U; i < count; ++i) {
        if ((x[i] < 0.0{F}) || (x[i] > 0.0{F})) {
            found = 1U;
        }
    }
    return found;
}"""


def elementary(body: str, ending: str) -> str:
    """Return the elementary functions that some C calls; `ending` is that of its literals, "" or "F"."""
    known = {**_ELEMENTARY, "any_nonzero": _ANY_NONZERO}
    real = {"R": "armgpi_real_t", "F": ending, "f": ending.lower()}
    # No more than these: an unused static function is a warning, and warnings are errors (make strict).
    used = [text for name, text in known.items() if re.search(rf"\b{name}\(", body)]
    return "\n".join(fill_text(text, real) for text in used) + "\n"


def block(lines: Sequence[str], arguments: Sequence[str]) -> str:
    """Return the body of a function; arguments that it does not need are named as such."""
    text = "\n".join(lines)
    # A law has the same arguments in `init` and `step`, and -Wextra warns of those without use.
    unused = [f"(void){name};" for name in arguments if not re.search(rf"\b{name}\b", text)]
    return "{\n" + "".join(f"    {line}\n" for line in [*lines, *unused]) + "}\n"


def fill_text(text: str, values: Mapping[str, str]) -> str:
    """Return a text of C, which is full of braces, with {names} replaced."""
    # Neither str.format nor Template: C is full of {}, and $ is the templates'.
    for key, value in values.items():
        text = text.replace(f"{{{key}}}", value)
    return text


def comma_lines(items: Iterable[str]) -> str:
    """Return lines with commas between them."""
    return ",\n".join(items)


def members(fields: Sequence[tuple[str, str]]) -> str:
    """Return members of a struct with their comments in a column."""
    width = max((len(member) for member, _ in fields), default=0)
    return "".join(f"    {member:{width}} /* {remark} */\n" for member, remark in fields)


def rows(numbers: Sequence[str], joints: Sequence[str]) -> str:
    """Return the entries of a table, with the names of the joints where there is one for each."""
    named = len(numbers) == len(joints)
    commas = [f"{x}," for x in numbers[:-1]] + [numbers[-1]]
    width = max(map(len, commas))
    return "\n".join(
        f"    {x:{width}} /* {plain(name)} */" if named else f"    {x}"
        for x, name in zip(commas, joints if named else commas, strict=True)
    )
