"""Effects in the motor encoder."""

from typing import Any, ClassVar

import jax.numpy as jnp
from jax import Array

from .._types import Scalar
from ..params import setting
from ._base import AbstractEffect, Block, Signals


class EncoderGrid(AbstractEffect):
    """qm = resolution * round(q / resolution): an encoder that counts; null resolution = 0 (m).

    For making data. The rounding has no derivative, so it never takes part in a fit.
    """

    block: ClassVar[Block] = Block.SENSOR
    resolution: Scalar = setting("m")

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        q = signals.incoming
        counts = self.resolution > 0
        step = jnp.where(counts, self.resolution, 1.0)
        return jnp.where(counts, step * jnp.round(q / step) - q, 0.0), x
