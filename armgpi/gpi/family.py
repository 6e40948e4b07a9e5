"""The family of the GPI law: more or fewer integrators, and a roll-off, by closed forms.

A joint is e'' = v + zeta. Member (m, r) is v = -C(s) e with m integrators and r poles more than it needs:

    C(s) = N(s) / (s^m D(s)),    N of degree m + 1,    D monic of degree 1 + r

N and D are the two ends of one polynomial, s^(m + 2) D(s) + N(s), the characteristic polynomial of the loop:

    (s^2 + 2 zeta_c omega_c s + omega_c^2) (s^2 + 2 zeta_2 omega_2 s + omega_2^2)
        (s + p_c)^(m - 1) (s + p_f)^r

The law of the paper (eqs. 17, 24) is m = 2, r = 0 with equal quadratics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from armgpi.base.arrays import Array, PerJointInput, as_sized_array, check_whole, positive
from armgpi.errors import ParameterError
from armgpi.gpi.gains import Tuning, betas

#: Parameters of a controller that choose the member, in the order of :class:`Member`.
PARAMETERS = ("integrators", "rolloff", "rolloff_ratio", "second_ratio", "second_zeta")


def _positive(value: PerJointInput, name: str) -> Array:
    """Return a parameter as an array of positive numbers."""
    array = as_sized_array(value, name)
    if not positive(array).all():
        raise ParameterError(name, value, "positive")
    return array


class TransferFunction(NamedTuple):
    """C(s) = N(s) / (s^m D(s)), coefficients from the lowest power up.

    Attributes:
        numerator: the m + 2 coefficients of N.
        denominator: the 1 + r coefficients of D below its leading one, which is 1.
    """

    numerator: tuple[Array, ...]
    denominator: tuple[Array, ...]


class PartialFractions(NamedTuple):
    """C(s) = direct + g_1 / s + ... + g_m / s^m + F(s) / D(s).

    Attributes:
        direct: what a step of the error gives at once; None with a roll-off, which gives nothing.
        integrals: g_1 ... g_m.
        numerator: the 1 + r coefficients of F, from the lowest power up.
        denominator: the 1 + r coefficients of D below its leading one, which is 1.
    """

    direct: Array | None
    integrals: tuple[Array, ...]
    numerator: tuple[Array, ...]
    denominator: tuple[Array, ...]


class Member:
    """Which member of the family, and the poles that the tuning does not name: they move with omega_c.

    Attributes:
        integrators: m, 1 to 3: disturbances that are polynomials in time of degree m - 1 leave no error.
        rolloff: r, 0 to 2: by how much the degree of the denominator is above that of the numerator.
        rolloff_ratio: p_f / omega_c [-].
        second_ratio: natural frequency of the second quadratic over omega_c [-]; None for 1.
        second_zeta: its damping ratio [-]; None for the first one's.
    """

    def __init__(
        self,
        integrators: int = 2,
        rolloff: int = 0,
        rolloff_ratio: PerJointInput = 4.0,
        second_ratio: PerJointInput | None = None,
        second_zeta: PerJointInput | None = None,
    ) -> None:
        """Choose a member; ratios are positive numbers, or arrays that broadcast over the joints.

        Raises:
            ParameterError: for a number of integrators or a roll-off that is not in the family, or a ratio
                that is not positive.
            ArrayError: for a ratio that is not a number.
        """
        self.integrators = check_whole(integrators, "integrators", 1, 3)
        # Up to 2 a stable loop implies a stable D (its Routh condition is the loop's first), above not.
        self.rolloff = check_whole(rolloff, "rolloff", 0, 2)
        self.rolloff_ratio = _positive(rolloff_ratio, "rolloff_ratio")
        self.second_ratio = None if second_ratio is None else _positive(second_ratio, "second_ratio")
        self.second_zeta = None if second_zeta is None else _positive(second_zeta, "second_zeta")

    @classmethod
    def chosen_by(cls, given: Mapping[str, Any]) -> Member:
        """Return the member that parameters of a controller choose; others are left alone."""
        return cls(**{name: given[name] for name in PARAMETERS if name in given})

    @property
    def equal(self) -> bool:
        """Whether the two quadratics are one and the same."""
        return self.second_ratio is None and self.second_zeta is None

    @property
    def ratios(self) -> tuple[Array, Array | None, Array | None]:
        """What the poles beyond those of the tuning follow from."""
        return self.rolloff_ratio, self.second_ratio, self.second_zeta

    @property
    def printed(self) -> bool:
        """Whether it is the law of the paper."""
        return self.integrators == 2 and self.rolloff == 0 and self.equal


#: The law of the paper.
PRINTED = Member()


def characteristic(tuning: Tuning, member: Member = PRINTED) -> list[Array]:
    """Return the characteristic polynomial's coefficients from s^0 up, without the leading 1.

    Args:
        tuning: arrays that broadcast over the joints.
        member: of the family.
    """
    omega, zeta, p = tuning
    ordinary = [p] * (member.integrators - 1)
    if member.equal and ordinary:
        product: list[Array] = list(betas(tuning))  # eq. 25
        ordinary = ordinary[1:]
    else:
        product = _quartic(omega, zeta, member)
    for pole in (*ordinary, *[member.rolloff_ratio * omega] * member.rolloff):
        raised = [low + pole * high for low, high in pairwise(product)]
        product = [pole * product[0], *raised, product[-1] + pole]  # times (s + pole)
    return product


def transfer_function(tuning: Tuning, member: Member = PRINTED) -> TransferFunction:
    """Return C(s): the characteristic polynomial is s^(m + 2) D(s) + N(s), so they are its two ends."""
    whole = characteristic(tuning, member)
    size = member.integrators + 2
    return TransferFunction(tuple(whole[:size]), tuple(whole[size:]))


def partial_fractions(tuning: Tuning, member: Member = PRINTED) -> PartialFractions:
    """Return the terms of C(s).

    With G(s) = g_m + g_(m-1) s + ... + g_1 s^(m-1) and the direct term k, N = D G + s^m (F + k D). The
    coefficients below s^m give the g one after the other, those from s^m up give F.
    """
    n, d = transfer_function(tuning, member)
    m = member.integrators
    direct = None if member.rolloff else n[m + 1]
    terms: list[Array] = []  # g_m, g_(m - 1), ...
    for j in range(m):
        terms.append(_less(n[j], d, terms, j) / d[0])
    numerator = []
    for j in range(len(d)):
        rest: Array | float = n[m + j] if m + j < len(n) else 0.0
        if direct is not None:
            rest = rest - direct * d[j]
        numerator.append(_less(rest, d, terms, m + j))
    return PartialFractions(direct, tuple(terms[::-1]), tuple(numerator), d)


def _quartic(omega: Array, zeta: Array, member: Member) -> list[Array]:
    """Return the product of the two quadratic factors."""
    omega_2 = omega if member.second_ratio is None else member.second_ratio * omega
    zeta_2 = zeta if member.second_zeta is None else member.second_zeta
    square, square_2 = omega * omega, omega_2 * omega_2
    twice, twice_2 = 2.0 * zeta * omega, 2.0 * zeta_2 * omega_2
    return [
        square * square_2,
        twice * square_2 + twice_2 * square,
        square + square_2 + twice * twice_2,
        twice + twice_2,
    ]


def _less(rest: Any, d: Sequence[Array], terms: Sequence[Array], power: int) -> Any:
    """Return a coefficient of s^power less that of D times what is known of G."""
    for i, term in enumerate(terms):
        if power - i == len(d):  # D is monic
            rest = rest - term
        elif 0 < power - i < len(d):
            rest = rest - d[power - i] * term
    return rest
