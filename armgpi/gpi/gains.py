"""Gains of the GPI law: three tuning parameters per joint, fixed or adapted on line."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

from armgpi.base.arrays import Array
from armgpi.base.parameter import Parametrised, PerJoint, again, parameter, with_parameters
from armgpi.control.sizes import common_batch
from armgpi.registry import Context


class Tuning(NamedTuple):
    """Tuning parameters of the desired polynomial (eq. 24), arrays that broadcast over the joints.

    Attributes:
        omega_c: natural frequency [rad/s].
        zeta_c: damping ratio [-].
        p_c: real pole [rad/s].
    """

    omega_c: Array
    zeta_c: Array
    p_c: Array


class Betas(NamedTuple):
    """Coefficients of the error polynomial s^5 + beta4 s^4 + ... + beta0 (eqs. 20, 21, 25).

    Attributes:
        beta0: of s^0 [1/s^5], shape as the tuning.
        beta1: of s [1/s^4].
        beta2: of s^2 [1/s^3].
        beta3: of s^3 [1/s^2].
        beta4: of s^4 [1/s].
    """

    beta0: Array
    beta1: Array
    beta2: Array
    beta3: Array
    beta4: Array


def betas(tuning: Tuning) -> Betas:
    """Return the gains that place the error dynamics on (s^2 + 2 zeta w s + w^2)^2 (s + p), eq. 25.

    Args:
        tuning: w = omega_c, zeta = zeta_c and p = p_c, arrays that broadcast over the joints.

    Returns:
        beta0 to beta4, of the shape that the tuning broadcasts to.
    """
    w, z, p = tuning
    w2 = w * w
    damping = z * w
    four = 4.0 * damping
    product = p * four
    return Betas(
        beta0=p * w2 * w2,
        beta1=w2 * (w2 + product),
        beta2=w2 * (four + 2.0 * p) + product * damping,
        beta3=2.0 * w2 + four * damping + product,
        beta4=four + p,
    )


class GainStep(NamedTuple):
    """Result of one step of the gains.

    Attributes:
        tuning: the tuning parameters to use now.
        state: the next state.
    """

    tuning: Tuning
    state: Any


class Gains(Parametrised, ABC):
    """Where the tuning parameters of a GPI controller come from.

    Attributes:
        adaptive: whether they change; when they do not, the controller works its gains out once.
        batch: number of rollouts that they are for, None when they fit any.
        config_name: in experiment files, the `type` of a GPI controller with such gains; None for none.
    """

    config_name: ClassVar[str | None] = None

    adaptive: bool = True
    batch: int | None = None

    def __post_init__(self) -> None:
        """Check what does not depend on the joints; :meth:`prepare` checks the rest."""
        self.check_parameters(only=lambda each: not each.per_joint)

    @classmethod
    def chosen(cls, context: Context) -> dict[str, Any]:
        """Return what an experiment takes for `chosen` parameters in a `context`, by their names."""
        return {}

    @abstractmethod
    def prepare(self, joint_names: Sequence[str], dt: float) -> Gains:
        """Return these gains checked and shaped for a robot.

        Args:
            joint_names: names of the n joints, for messages.
            dt: sample time [s].
        """

    @abstractmethod
    def init(self, e: Array) -> Any:
        """Return the state before the first sample.

        Args:
            e: the first tracking error q - q* [rad or m], shape (n,) or (batch, n).

        Returns:
            The state that :meth:`step` takes; None for gains without one.
        """

    @abstractmethod
    def step(self, e: Array, learn: Array, state: Any) -> GainStep:
        """Return the tuning for the tracking error `e`.

        Args:
            e: tracking error q - q* [rad or m], shape (n,) or (batch, n).
            learn: 1 where something may be learned from this sample, 0 where not (saturated torque).
            state: from :meth:`init` or the step before.
        """

    @abstractmethod
    def nominal(self) -> Tuning:
        """Return the tuning at rest, to check margins with."""

    def signals(self, state: Any) -> Mapping[str, Array]:
        """Return inner signals worth recording, name -> array (..., n), of a `state`; none by default."""
        return {}

    def describe(self) -> Mapping[str, Any]:
        """Return the parameters as plain data."""
        return {name: value.tolist() for name, value in self.nominal()._asdict().items()}


@with_parameters
class Quadratics(Gains):
    """Gains of which the natural frequency and the damping ratio are declared."""

    omega_c: Any = parameter(
        "natural frequency",
        unit="rad/s",
        least=0.0,
        above=True,
        per_joint=True,
        key="omega",
        log=True,
        search=(1.0, 200.0),
        slider=(1.0, 100.0),
    )
    zeta_c: Any = parameter(
        "damping ratio",
        default=1.0,
        least=0.0,
        above=True,
        per_joint=True,
        key="zeta",
        log=True,
        search=(0.3, 3.0),
        slider=(0.3, 2.0),
    )


@with_parameters
class Poles(Quadratics):
    """Gains of which the real pole is declared as well."""

    p_c: Any = parameter(
        "real pole",
        unit="rad/s",
        default=None,
        least=0.0,
        above=True,
        per_joint=True,
        key="p",
        log=True,
        search=(1.0, 200.0),
        slider=(1.0, 100.0),
    )


@with_parameters
class FixedGains(Poles):
    """Tuning parameters that do not change: numbers, or arrays of shape (n,) or (batch, n).

    Attributes:
        omega_c: natural frequency [rad/s].
        zeta_c: damping ratio [-].
        p_c: real pole [rad/s]; omega_c when not given.
    """

    adaptive = False
    config_name: ClassVar[str | None] = "gpi"

    omega_c: PerJoint = again(chosen="what sample time and delay allow")
    zeta_c: PerJoint = again(default=1.0)
    p_c: PerJoint = again(default=None, none="omega", follows="omega_c")

    def __post_init__(self) -> None:
        """Let the pole follow omega_c when it is not given."""
        super().__post_init__()
        self.fill("p_c", self.omega_c)
        self._tuning = Tuning(self.omega_c, self.zeta_c, self.p_c)

    @classmethod
    def chosen(cls, context: Context) -> dict[str, Any]:
        """Return the default bandwidth; see :meth:`Gains.chosen`."""
        return {"omega_c": context.omega_c}

    def prepare(self, joint_names: Sequence[str], dt: float) -> FixedGains:
        """Return the gains as arrays over the joints; see :meth:`Gains.prepare`.

        Raises:
            ArrayError: when a value is not positive or a shape does not fit.
        """
        gains = self.with_values()
        gains.check_parameters(joint_names)
        gains._tuning = Tuning(gains.omega_c, gains.zeta_c, gains.p_c)
        gains.batch = common_batch(*gains._tuning)
        return gains

    def init(self, e: Array) -> None:
        """Return no state; see :meth:`Gains.init`."""

    def step(self, e: Array, learn: Array, state: None) -> GainStep:
        """Return the fixed tuning, (..., n); see :meth:`Gains.step`."""
        return GainStep(self._tuning, None)

    def nominal(self) -> Tuning:
        """Return the fixed tuning."""
        return self._tuning
