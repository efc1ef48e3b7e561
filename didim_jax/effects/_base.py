"""An effect: one term on one block of the loop, with its own state if it needs one, and nothing at its null."""

import abc
import enum
from typing import Any

import equinox as eqx
from jax import Array


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
"""Blocks that act once per controller sample; the others act at every instant."""


class Signals(eqx.Module):
    """What an effect may look at.

    Positions (m) and velocities (m/s) of both sides, force of the coupling on the motor side (N), command held by the
    drive (V), and the force (N) or position (m) that reaches this effect along the chain.
    """

    q1: Array
    v1: Array
    q2: Array
    v2: Array
    coupling: Array
    command: Array
    incoming: Array


class AbstractEffect(eqx.Module):
    """One term on one block of the loop; exactly nothing at its null."""

    block: eqx.AbstractClassVar[Block]

    def init(self, signals: Signals) -> Any:
        """Own state at the first sample: any tree of arrays; none by default."""
        return ()

    @abc.abstractmethod
    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        """(contribution, change of x) at time t (s).

        The contribution's unit is the block's. The change is dx/dt for blocks that act at every instant, and the next x
        for the controller and the sensor, which act once per sample.
        """
