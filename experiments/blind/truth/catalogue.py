"""Which effects there are, and how several of them are drawn for one machine."""

from dataclasses import replace

import numpy as np

from . import laws_drive, laws_friction, laws_outside, laws_plant
from .law import Draw, Drawn, Law

LAWS: dict[str, Law] = laws_drive.LAWS | laws_friction.LAWS | laws_plant.LAWS
OUTSIDE_LAWS: dict[str, Law] = laws_outside.LAWS

FLEXIBLE_ONLY: tuple[str, ...] = (
    "coupling_damping",
    "cubic_stiffness",
    "backlash",
    "transmission_error",
    "x_position_stiffness",
    "x_relaxation",
)
"""Effects that need a coupling to act in."""


def refuse(effects: tuple[str, ...], model: str) -> None:
    """Raises ValueError for names that are unknown, said twice, or that this machine has no place for."""
    for name in effects:
        if name not in LAWS and name not in OUTSIDE_LAWS:
            raise ValueError(f"No effect is named {name!r}.")
        if model == "rigid" and name in FLEXIBLE_ONLY:
            raise ValueError(f"{name} needs a coupling, and a rigid machine has none.")
    if len(set(effects)) < len(effects):
        raise ValueError(f"An effect is wished for twice: {', '.join(effects)}.")


def draw_effects(
    seed: int, draw: Draw, effects: tuple[str, ...], size: float, spread: float
) -> tuple[list[Drawn], dict[str, float]]:
    """Every effect with a size and numbers of its own: what the others are does not change them."""
    drawn, factors = [], {}
    for name in effects:
        rng = np.random.default_rng([seed, 10, *name.encode()])
        jitter = np.exp(rng.uniform(np.log(1 - spread), np.log(1 + spread))) if spread else 1.0
        factors[name] = float(size * jitter)
        law = (LAWS | OUTSIDE_LAWS)[name]
        drawn.append(law(replace(draw, rng=rng, factor=factors[name])))
    return drawn, factors
