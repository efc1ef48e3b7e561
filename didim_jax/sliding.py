"""A short step of a drive whose Coulomb friction is solved together with the step, so that it can truly hold at rest.

A sign as sharp as that of a real drive is too stiff for an explicit method: below some 0.1 mm/s it would hop around
rest instead of sticking. Here the impulse of Coulomb friction is the one that the velocity at the end of the step asks
for; everything else is advanced by the midpoint rule. Sticking then costs nothing, and has a derivative.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from ._types import Scalar
from .chain import Chain, Grip, Held, State
from .effects import acts_once_per_sample


class Sliding(eqx.Module):
    """Midpoint rule with implicit Coulomb friction, second order in sliding.

        v' = rubbed(v + h/2 a), x' = x + h/2 f                     at the beginning of the step, q' = q + h/2 v
        v  = rubbed(v + h a'),  q  = q + h (v_old + v_new) / 2     with the forces in the middle

    References: Acary, Brogliato, *Numerical Methods for Nonsmooth Dynamical Systems*, 2008, chapter 10 (time stepping).
    """

    def step(self, chain: Chain, t: Array, h: Scalar, state: State, held: Held) -> State:
        """State after h seconds from t on. Effects that act once per sample stand still."""
        rates, grip = chain.free(t, state, held)
        middle = _moved(chain, state, rates, 0.5 * h)
        y = chain.plant.with_speeds(middle.plant, *_rubbed(chain, middle.plant, grip, 0.5 * h))
        middle = State(y, middle.effects)
        rates, grip = chain.free(t + 0.5 * h, middle, held)
        end = _moved(chain, state, rates, h)
        y = chain.plant.with_speeds(end.plant, *_rubbed(chain, end.plant, grip, h))
        # Positions drift by the mean of both speeds: at rest they stay.
        at, speed = state.plant[0::2], 0.5 * (state.plant[1::2] + y[1::2])
        y = jnp.stack([jnp.stack([q + h * v, w]) for q, v, w in zip(at, speed, y[1::2], strict=True)]).reshape(-1)
        return State(y, end.effects)


def _moved(chain: Chain, state: State, rates: State, h: Scalar) -> State:
    effects = (
        x if acts_once_per_sample(effect) else jax.tree.map(lambda x, rate: x + h * rate, x, rate)
        for effect, x, rate in zip(chain.effects, state.effects, rates.effects, strict=True)
    )
    return State(state.plant + h * rates.plant, tuple(effects))


def _rubbed(chain: Chain, y: Array, grip: Grip, h: Scalar) -> tuple[Array, Array]:
    """Speeds of both sides, m/s, after Coulomb friction has acted for h seconds."""
    _, v1, _, v2 = chain.plant.sides(y)
    one, two = (
        rubbed(v + grip.slide, h * jnp.maximum(force, 0.0) / mass, v_eps) - grip.slide
        for v, force, mass, v_eps in zip((v1, v2), grip.force, grip.mass, grip.v_eps, strict=True)
    )
    return one, two


def rubbed(v: Array, k: Array, v_eps: Scalar) -> Array:
    """The w with w + k tanh(w / v_eps) = v: speed left (m/s) when friction takes up to k (m/s) of v.

    One Newton step from the answer for a sign that is straight up to v_eps; it is exact far from v_eps, and continuous.
    """
    straight = v * v_eps / (v_eps + k)
    w = jnp.where(jnp.abs(v) <= v_eps + k, straight, v - k * jnp.sign(v))
    s = jnp.tanh(w / v_eps)
    return w - (w + k * s - v) / (1 + k / v_eps * (1 - s * s))
