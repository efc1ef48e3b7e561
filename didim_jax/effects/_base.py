"""An effect: one term on one block of the loop, with its own state if it needs one, and nothing at its null."""

import abc
import dataclasses
import enum
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from .._types import Scalar


class Block(enum.Enum):
    """Where on the loop an effect acts, and what its contribution means there."""

    CONTROLLER = "controller"
    """V added to the control law's output, once per sample."""
    ACTUATOR = "actuator"
    """N added to the force that the drive makes of its command."""
    MOTOR_SIDE = "motor side"
    """N on the motor-side mass."""
    COUPLING = "coupling"
    """N added to the coupling's force on the motor side, taken from the load side."""
    LOAD_SIDE = "load side"
    """N on the load-side mass."""
    SENSOR = "sensor"
    """m added to the measured motor position, once per sample."""
    BASE = "base"
    """m/s2 of the frame that carries the axis: both masses feel its opposite."""
    ENVIRONMENT = "environment"
    """N on the load-side mass, from outside the machine."""


SAMPLED = frozenset({Block.CONTROLLER, Block.SENSOR})
"""Blocks that act once per controller sample; the others act at every instant unless an effect says otherwise."""


def _zero() -> Any:
    """A signal that is zero unless given."""
    return eqx.field(converter=jnp.asarray, default=0.0)


class Signals(eqx.Module):
    """What an effect may look at; what does not exist where it acts is zero.

    Positions (m) and velocities (m/s) of both sides, force of the coupling on the motor side (N), command held by the
    drive (V), and what reaches this effect along the chain: position (m), volts, or motor force (N). Then the plant's
    own friction: smooth sign of each side's velocity, Coulomb part, the same without its sign, what the effects before
    this one add to that, viscous part (N). Then deflection (m) and stiffness (N/m) of the coupling. Then the drive: its
    force (N), gain (N/V), the sample's beginning and length (s). Then the law's position and velocity terms (V).
    """

    q1: Array
    v1: Array
    q2: Array
    v2: Array
    coupling: Array
    command: Array
    incoming: Array
    s1: Array = _zero()
    s2: Array = _zero()
    coulomb1: Array = _zero()
    coulomb2: Array = _zero()
    level1: Array = _zero()
    level2: Array = _zero()
    grip1: Array = _zero()
    grip2: Array = _zero()
    viscous1: Array = _zero()
    viscous2: Array = _zero()
    deflection: Array = _zero()
    stiffness: Array = _zero()
    force: Array = _zero()
    gain: Array = _zero()
    held_since: Array = _zero()
    dt: Array = _zero()
    law_position: Array = _zero()
    law_velocity: Array = _zero()


class Forces(eqx.Module):
    """What an effect adds to the mechanics at one instant, when it acts on more than its own block.

    N on the motor side, N in the coupling (on the motor side, taken from the load side), N on the load side, m/s2 of
    the frame, kg on the load side. Then what it does to the friction that holds at rest: N added to the Coulomb
    friction of the motor side and of the load side, without its sign, and m/s added to the velocity at which both rub.
    """

    motor: Scalar = 0.0
    coupling: Scalar = 0.0
    load: Scalar = 0.0
    frame: Scalar = 0.0
    payload: Scalar = 0.0
    grip_motor: Scalar = 0.0
    grip_load: Scalar = 0.0
    slide: Scalar = 0.0


@dataclasses.dataclass(frozen=True)
class Bench:
    """What is known before a diagnosis, for effects that need it: the machine's numbers and the record's ranges.

    `lead` m per turn, `limit` V, `gain` N/V, `dt` s, stroke from `q_low` to `q_high` m, `duration` s, the recorded
    `volts`, the encoder's `grid` (m) if it is coarser than documented, and `disturbance`: the force (N, per sample) on
    the axis that the nominal plant leaves unexplained.
    """

    lead: float = 0.0025
    limit: float = np.inf
    gain: float = 1.0
    dt: float = 1e-3
    q_low: float = 0.0
    q_high: float = 0.1
    duration: float = 10.0
    volts: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(1))
    grid: float = 0.0
    disturbance: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(1))

    @property
    def middle(self) -> float:
        """Middle of the stroke, m."""
        return 0.5 * (self.q_low + self.q_high)

    @property
    def half_stroke(self) -> float:
        """Half of the stroke, m."""
        return max(0.5 * (self.q_high - self.q_low), 1e-6)


@dataclasses.dataclass(frozen=True)
class Probe:
    """A trial of an effect away from its null: the sizes that make it act, and the shape that they act with."""

    sizes: Mapping[str, float]
    shape: Mapping[str, float] = dataclasses.field(default_factory=dict)
    linear: bool = True
    """Whether twice the size does about twice as much; a threshold does not, and is searched from the probe itself."""


class AbstractEffect(eqx.Module):
    """One term on one block of the loop; exactly nothing at its null.

    An instance with its default values is at its null. Class attributes say what a reader of a list wants to know:
    `equation`, `size` to expect on an EMPS-like axis, `twins` that a motor-side record can hardly tell apart, `source`.
    """

    block: eqx.AbstractClassVar[Block]
    name: ClassVar[str] = ""
    """Name in results; the class's own name in lower case unless given."""
    equation: ClassVar[str] = ""
    size: ClassVar[str] = ""
    twins: ClassVar[tuple[str, ...]] = ()
    source: ClassVar[str] = ""
    sampled: ClassVar[bool] = False
    """Acts on the held command once per sample (ACTUATOR): exact, and cheaper than at every instant."""
    least: ClassVar[Mapping[str, float]] = MappingProxyType({})
    """Sizes that every machine has a little of, by parameter: an effect no larger is not worth a name."""
    own_to_record: ClassVar[tuple[str, ...]] = ()
    """Parameters that another record of the same machine may have different: a phase lost at power-off, a clock."""

    def init(self, signals: Signals) -> Any:
        """Own state at the first sample: any tree of arrays; none by default."""
        return ()

    @abc.abstractmethod
    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array | Forces, Any]:
        """(contribution, change of x) at time t (s).

        The contribution's unit is the block's; an effect of the mechanics may return `Forces` instead. The change is
        dx/dt for effects that act at every instant, and the next x for those that act once per sample: controller,
        sensor, and `sampled` ones.
        """

    @classmethod
    def at(cls, bench: Bench) -> "AbstractEffect":
        """The effect at its null on this machine; override it where a setting comes from the bench."""
        return cls()

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        """Where to look for this effect: by default each parameter at its typical size, all others at the null."""
        return tuple(
            Probe({f.name: float(f.metadata["param"]["scale"])})
            for f in dataclasses.fields(self)
            if "param" in f.metadata
        )

    @classmethod
    def label(cls) -> str:
        """Name of the effect in results and on the command line."""
        return cls.name or cls.__name__.lower()


def acts_once_per_sample(effect: AbstractEffect | type[AbstractEffect]) -> bool:
    """Whether the effect's state moves from sample to sample instead of continuously."""
    return effect.sampled or effect.block in SAMPLED
