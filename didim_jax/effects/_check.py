"""What an effect must be before it may join the others: a term that is nothing at its defaults, and differentiable."""

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..params import pack, parameters, unpack
from ._base import SAMPLED, AbstractEffect, Bench, Block, Forces, Signals, acts_once_per_sample


def fault(kind: type[AbstractEffect]) -> str | None:
    """What is wrong with a class of effects, as the end of a sentence that begins with its name; None where nothing is.

    It is tried at its defaults, as `at(Bench())` makes it, in a few motions.
    """
    if not isinstance(getattr(kind, "block", None), Block):
        return "says nothing of where it acts; give it a class attribute such as block = Block.LOAD_SIDE"
    if kind.sampled and kind.block is not Block.ACTUATOR and kind.block not in SAMPLED:
        return f"is sampled, which only effects of the actuator may choose, but acts on the {kind.block.value}"
    try:
        effect = kind.at(Bench())
    except Exception as error:
        return f"cannot be made at its defaults, and every field needs one: {_words(error)}"
    try:
        for t, signals in _motions(kind.block):
            if wrong := _wrong(effect, t, signals):
                return wrong
    except Exception as error:
        return f"fails at its defaults: {_words(error)}"
    return None


def _wrong(effect: AbstractEffect, t: Array, signals: Signals) -> str | None:
    x = effect.init(signals)
    made, change = effect(t, x, signals)
    if isinstance(made, Forces) and acts_once_per_sample(effect):
        return "acts once per sample, where it adds one number, not Forces"
    parts = [np.asarray(part) for part in jax.tree.leaves(made)]
    if any(part.shape != () for part in parts):
        return f"adds an array of shape {next(p.shape for p in parts if p.shape)}, where one number is expected"
    if _shapes(change) != _shapes(x):
        return "returns a change of its state that has not the state's shape"
    if any(part != 0 for part in parts):  # a nan as well
        size = next(float(part) for part in parts if part != 0)
        return f"adds {size:.3g} at its defaults; they must be its null, where it adds nothing"
    chosen = parameters(effect)

    def contribution(theta: Array) -> list[Array]:
        again = unpack(effect, theta, chosen)
        return [jnp.asarray(part, dtype=float) for part in jax.tree.leaves(again(t, x, signals)[0])]

    slopes = np.array(jax.jacfwd(contribution)(pack(effect)) if chosen else np.zeros((1, 0)))
    for p, finite in zip(chosen, np.isfinite(slopes).all(axis=0), strict=True):
        if not finite:
            return f"has no finite derivative by {p.name} at its null"
    return None


def _motions(block: Block) -> Iterator[tuple[Array, Signals]]:
    """Forward, backward, and at rest, at three times; forces, volts and friction as a drive of 100 kg has them."""
    for t, v in ((0.7, 0.05), (6.3, -0.11), (0.0, 0.0)):
        q, command = 0.08 + 0.3 * v, 30 * v
        force, delta, s = 35.15 * command, 1e-3 * v, np.tanh(v / 1e-3)
        both = {"s": s, "coulomb": 10 * s, "level": 10.0, "viscous": 100 * v}
        numbers = {f"{name}{side}": value for side in "12" for name, value in both.items()} | {
            "q1": q,
            "v1": v,
            "q2": q + delta,
            "v2": 1.001 * v,
            "coupling": 9e5 * delta,
            "command": command,
            "incoming": {Block.SENSOR: q, Block.CONTROLLER: command}.get(block, force),
            "deflection": delta,
            "stiffness": 9e5,
            "force": force,
            "gain": 35.15,
            "held_since": t,
            "dt": 1e-3,
            "law_position": 1.4 * command,
            "law_velocity": -0.4 * command,
        }
        arrays: dict[str, Any] = {name: jnp.asarray(value, dtype=float) for name, value in numbers.items()}
        yield jnp.asarray(t), Signals(**arrays)


def _shapes(tree: object) -> tuple[object, list[tuple[int, ...]]]:
    return jax.tree.structure(tree), [np.shape(leaf) for leaf in jax.tree.leaves(tree)]


def _words(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}".rstrip(".: ")
