"""Friction ladder by AIC: the nominal inverse model, and the same with one friction or environment law more.

AIC = n log(energy left) + 2 parameters, n the samples in the band divided by their autocorrelation factor; the least
one decides, the nominal model's included. It knows offset, cable spring and the friction laws that are functions of
position and velocity; whatever else a machine has is given one of those names, or none. At most one effect.
"""

from didim_jax.machine import Machine
from didim_jax.recording import Recording

from .answer import FALSE_PRECISION, Answer, weigh
from .dictionary import friction, left_by
from .inverse import Inverse, inverse

NONE = 0.05
"""Share of the energy that must go besides what AIC asks. Of 0, 0.03, 0.05, 0.1 ... 0.6 the middle of those that get
most of 73 open cases right (25; AIC alone, with 0, 22: it names something on three of seven nominal drives)."""


def answer(recording: Recording, machine: Machine, *, fitted: Inverse | None = None) -> Answer:
    """The law of least AIC. `fitted` saves fitting the nominal inverse model again."""
    x = fitted or inverse(recording, machine)
    candidates = friction(x)
    left: dict[str, float] = {}
    penalty: dict[str, float] = {}
    n = len(x.residual) / FALSE_PRECISION
    for c, share in zip(candidates, left_by(candidates, x.residual, x.basis), strict=True):
        if c.effect not in left or share < left[c.effect]:
            left[c.effect], penalty[c.effect] = share, float(c.parameters)
    return weigh(left, n, NONE, penalty)
