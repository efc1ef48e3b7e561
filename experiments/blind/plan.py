"""Which cases a study has: strata, evenly spread over effects, noise, encoder and model; their names tell nothing."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from didim_jax.config import CONFIG

STRATA = ("single", "small", "large", "none", "numerics", "alias", "two", "three", "outside", "poor")

ALIAS = "drive_gain"
"""Absorbed exactly by the base parameters: the honest answer is `none`."""

TWINS = (
    {"offset", "asymmetric_coulomb"},
    {"amplifier_lag", "time_delay"},
    {"cogging", "encoder_periodic_error"},
    {"cogging", "transmission_error"},
    {"encoder_periodic_error", "transmission_error"},
    {"velocity_gain", "velocity_filter"},
)
"""Effects that a motor-side record often cannot tell apart: either may be answered as the other where both are said."""


def with_twins(effect: str) -> set[str]:
    """The effect and its twins."""
    return {effect}.union(*(pair for pair in TWINS if effect in pair))


CONTROLLER = {"position_gain", "velocity_gain", "velocity_filter"}

FLEXIBLE_ONLY = {
    "backlash",
    "base_flexibility",
    "coupling_damping",
    "cubic_stiffness",
    "load_dependent_friction",
    "second_flexible_mode",
    "transmission_error",
    "x_position_stiffness",
    "x_relaxation",
}
"""Effects that need a coupling to act in: never asked of a rigid machine."""


@dataclass(frozen=True, config=CONFIG)
class Config:
    """How many cases of each stratum, and of what kind."""

    seed: int | None = Field(None, ge=0, description="of the plan; not given: drawn, and kept with the answers")
    workers: int = Field(ge=1, description="processes that make cases side by side")
    single: int = Field(ge=0, description="cases with one effect of typical size")
    small: int = Field(ge=0, description="cases with one small effect")
    large: int = Field(ge=0, description="cases with one large effect")
    none: int = Field(ge=0, description="cases without any effect")
    numerics: int = Field(ge=0, description="cases without effect: another smoothing, step and sub-sample timing")
    alias: int = Field(ge=0, description="cases with a wrong drive gain alone")
    two: int = Field(ge=0, description="cases with two effects")
    three: int = Field(ge=0, description="cases with three effects")
    outside: int = Field(ge=0, description="cases with an effect of no catalogue")
    poor: int = Field(ge=0, description="cases with one effect that is hardly excited")
    small_size: float = Field(gt=0, description="of the typical size")
    large_size: float = Field(gt=0, description="of the typical size")
    load_encoder: float = Field(ge=0, le=1, description="share of cases with a load encoder")
    low_noise: float = Field(ge=0, le=1, description="share of cases with little noise")
    high_noise: float = Field(ge=0, le=1, description="share of cases with much noise")
    rigid: float = Field(ge=0, le=1, description="share of cases with a rigid nominal plant, as far as effects allow")


@dataclasses.dataclass(frozen=True)
class Planned:
    """A case to make: a name that says nothing, its stratum, and what to wish of the simulator."""

    case: str
    stratum: str
    wish: dict[str, Any]


def draw(config: Config, seed: int, effects: Sequence[str], outside: Sequence[str]) -> list[Planned]:
    """The whole plan, by name of the case. The names are a random permutation: they tell nothing of the stratum."""
    rng = np.random.default_rng(seed)
    cases = [(stratum, wish) for stratum in STRATA for wish in _stratum(config, stratum, effects, outside, rng)]
    names = [f"case-{k + 1:04d}" for k in rng.permutation(len(cases))]
    named = zip(names, cases, strict=True)
    return sorted((Planned(name, stratum, wish) for name, (stratum, wish) in named), key=lambda planned: planned.case)


def _stratum(
    config: Config, stratum: str, effects: Sequence[str], outside: Sequence[str], rng: np.random.Generator
) -> list[dict[str, Any]]:
    n = getattr(config, stratum)
    chosen = _effects(stratum, n, effects, outside, rng)
    encoders = _shared((True, False), (config.load_encoder, 1 - config.load_encoder), n, rng)
    usual = 1 - config.low_noise - config.high_noise
    noises = _shared(("low", "usual", "high"), (config.low_noise, usual, config.high_noise), n, rng)
    models = _models([not FLEXIBLE_ONLY & set(some) for some in chosen], config.rigid, rng)
    size = {"small": config.small_size, "large": config.large_size}.get(stratum, 1.0)
    return [
        {
            "effects": some,
            "size": size,
            "model": model,
            "load_encoder": encoder,
            "noise": noise,
            "excitation": "poor" if stratum == "poor" else "usual",
            "numerics": stratum == "numerics",
            "seed": int(rng.integers(2**63)),
        }
        for some, encoder, noise, model in zip(chosen, encoders, noises, models, strict=True)
    ]


def _effects(
    stratum: str, n: int, effects: Sequence[str], outside: Sequence[str], rng: np.random.Generator
) -> list[tuple[str, ...]]:
    """What each case of a stratum holds."""
    catalogue = [effect for effect in effects if effect != ALIAS]
    if stratum in ("none", "numerics"):
        return [()] * n
    if stratum == "alias":
        return [(ALIAS,)] * n
    if stratum in ("two", "three"):
        return _combinations(catalogue, {"two": 2, "three": 3}[stratum], n, rng)
    return [(effect,) for effect in _evenly(outside if stratum == "outside" else catalogue, n, rng)]


def _evenly[T](values: Sequence[T], n: int, rng: np.random.Generator) -> list[T]:
    """n of them, each as often as the others to within one, in random order."""
    rounds = (rng.permutation(len(values)) for _ in itertools.count())
    return [values[k] for k in itertools.islice(itertools.chain.from_iterable(rounds), n)] if n else []


def _combinations(catalogue: Sequence[str], size: int, n: int, rng: np.random.Generator) -> list[tuple[str, ...]]:
    """n combinations of effects of which each can be told from the others."""
    out: list[tuple[str, ...]] = []
    while len(out) < n:
        some = tuple(str(name) for name in rng.choice(catalogue, size, replace=False))
        if compatible(some):
            out.append(some)
    return out


def compatible(effects: Sequence[str]) -> bool:
    """Whether no two of them are twins, or twins by acting on the same control law."""
    return all(set(pair) not in TWINS and not set(pair) <= CONTROLLER for pair in itertools.combinations(effects, 2))


def _shared[T](values: Sequence[T], shares: Sequence[float], n: int, rng: np.random.Generator) -> list[T]:
    """n values, each by its share to within one, in random order."""
    edges = np.round(np.cumsum(shares) * n).astype(int)
    counts = np.diff(edges, prepend=0)
    listed = [value for value, count in zip(values, counts, strict=True) for _ in range(count)]
    return [listed[k] for k in rng.permutation(n)]


def _models(allowed: Sequence[bool], share: float, rng: np.random.Generator) -> list[str]:
    """Rigid for a share of all, among those that may be."""
    free = [k for k, may in enumerate(allowed) if may]
    rigid = set(rng.permutation(free)[: round(share * len(allowed))].tolist())
    return ["rigid" if k in rigid else "flexible" for k in range(len(allowed))]
