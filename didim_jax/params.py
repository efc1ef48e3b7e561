"""Physical parameters of a module: declared once on the field, read as one named vector everywhere else.

A module declares each parameter with `param`, and each nested module with `part`. The vector `theta` lists them in
the order of declaration; a nested module's suffix goes between the symbol and its side, so that the friction of the
motor side gives `Fv1`, `Fc1`, or `Fv1_pos` where the friction law is asymmetric.
"""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from ._types import Scalar, Theta


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One physical parameter: its name, SI unit, whether it must stay positive, its typical size and its range."""

    name: str
    unit: str
    positive: bool
    scale: float
    path: tuple[str, ...]
    lower: float = -math.inf
    upper: float = math.inf


def _scalar(value: Scalar) -> Array:
    if isinstance(value, int | float | np.number):
        return jnp.asarray(float(value), dtype=float)  # not weakly typed: a weak type would compile twice
    return value


def param(
    unit: str,
    *,
    positive: bool = False,
    scale: float = 1.0,
    lower: float = -math.inf,
    upper: float = math.inf,
    **kwargs: Any,
) -> Any:
    """Declare a parameter: an array leaf with a unit, a typical size and the range in which it makes sense.

    `positive` ones are fitted as logarithms.
    """
    metadata = {"unit": unit, "positive": positive, "scale": scale, "lower": lower, "upper": upper}
    return eqx.field(converter=_scalar, metadata={"param": metadata}, **kwargs)


def setting(unit: str, **kwargs: Any) -> Any:
    """Declare a traced number that belongs to the computation, not to the machine (so never part of theta)."""
    return eqx.field(converter=_scalar, metadata={"unit": unit}, **kwargs)


def part(suffix: str = "", **kwargs: Any) -> Any:
    """Declare a nested module; `suffix` enters the names of its parameters."""
    return eqx.field(metadata={"suffix": suffix}, **kwargs)


def _with_suffix(name: str, suffix: str) -> str:
    symbol, separator, side = name.partition("_")
    return symbol + suffix + separator + side


def _walk(module: eqx.Module, suffix: str, path: tuple[str, ...]) -> Iterator[Parameter]:
    for field in dataclasses.fields(module):
        here = (*path, field.name)
        if (meta := field.metadata.get("param")) is not None:
            yield Parameter(_with_suffix(field.name, suffix), path=here, **meta)
        elif "suffix" in field.metadata:
            yield from _walk(getattr(module, field.name), suffix + field.metadata["suffix"], here)


def parameters(module: eqx.Module) -> tuple[Parameter, ...]:
    """Every parameter of the module, in the order of theta."""
    return tuple(_walk(module, "", ()))


def names(module: eqx.Module) -> tuple[str, ...]:
    """Names of theta."""
    return tuple(p.name for p in parameters(module))


def select(module: eqx.Module, wanted: Sequence[str]) -> tuple[Parameter, ...]:
    """The parameters with these names, in the module's order. ValueError names an unknown one and those there are."""
    known = parameters(module)
    unknown = set(wanted) - {p.name for p in known}
    if unknown:
        raise ValueError(
            f"{type(module).__name__} has no parameter {', '.join(sorted(unknown))}: "
            f"it has {', '.join(p.name for p in known)}."
        )
    return tuple(p for p in known if p.name in wanted)


def _get(module: eqx.Module, path: tuple[str, ...]) -> Array:
    value: Any = module
    for name in path:
        value = getattr(value, name)
    return value


def pack(module: eqx.Module, chosen: Sequence[Parameter] | None = None) -> Theta:
    """Theta: the values of the chosen parameters (all of them by default), shape (n_theta,)."""
    chosen = parameters(module) if chosen is None else chosen
    return jnp.stack([_get(module, p.path) for p in chosen]) if chosen else jnp.zeros(0)


def unpack[M: eqx.Module](module: M, theta: Theta, chosen: Sequence[Parameter] | None = None) -> M:
    """The module with theta in place of its chosen parameters (all of them by default)."""
    chosen = parameters(module) if chosen is None else chosen
    if not chosen:
        return module
    return eqx.tree_at(lambda m: [_get(m, p.path) for p in chosen], module, [theta[i] for i in range(len(chosen))])


def values(module: eqx.Module) -> dict[str, float]:
    """Name to value, on the host."""
    return {p.name: float(_get(module, p.path)) for p in parameters(module)}
