"""Step 3: all parameters at once, from masses and stiffness that are wrong by up to 60 % (paper, section V.D)."""

from pathlib import Path

import numpy as np
import xarray as xr

from didim_jax.identify import PlantParameters, Stopping
from didim_jax.identify.least_squares import Problem
from didim_jax.identify.three_step import FLEXIBLE_HZ, STEP_3
from didim_jax.params import names
from didim_jax.plant import CoulombViscous, FlexibleDrive, RigidDrive

from .config import Config
from .job import DAMPED, DIDIM, EXACT, Job, Method, count, run
from .twin import Twin

TOLERANCE = 0.02
"""Of M1, M2 and K12."""

DIDIM_TOLERANCE = 0.1
"""The same for DIDIM, which is biased near a flexible mode: its columns take the motion for given."""

MASSES = ("M1", "M2", "K12")

METHODS = (EXACT, DAMPED, DIDIM)

_STOPPING = Stopping(tolerance=1e-4, max_iterations=60)


def free(method: Method, twin: Twin) -> tuple[str, ...]:
    """Parameters that a method estimates: for DIDIM friction is one, on the motor side (section VI.E)."""
    every = names(twin.truth)
    return every if method.bounded else tuple(n for n in every if n not in ("Fv2", "Fc2"))


def problem(method: Method, twin: Twin, *, at_rest: bool = True) -> Problem:
    """What a method minimises."""
    template = twin.truth
    if not method.bounded:
        none = CoulombViscous(0.0, 0.0)
        template = FlexibleDrive(template.M1, none, template.M2, none, template.K12, 0.0)
    parametrisation = PlantParameters.of(template, free(method, twin), bounded=method.bounded)
    return parametrisation, (twin.trial(template, FLEXIBLE_HZ, at_rest=at_rest),)


def start(method: Method, twin: Twin, rigid: RigidDrive, off: np.ndarray) -> np.ndarray:
    """Theta from M1, M2 and K12 off by `off` (n, 3), relative; friction as step 1 has it, on the motor (eq. 27).

    DIDIM's columns do not care where friction starts (eq. 30 has zero): its simulations do, a little.
    """
    friction = {"Fv1": float(rigid.friction.Fv), "Fc1": float(rigid.friction.Fc)}  # type: ignore[attr-defined]
    theta = np.zeros((len(off), len(free(method, twin))))
    for column, name in enumerate(free(method, twin)):
        if name in MASSES:
            theta[:, column] = twin.true[name] * (1 + off[:, MASSES.index(name)])
        else:
            theta[:, column] = friction.get(name, 0.0)
    return theta


def target(twin: Twin) -> dict[str, float]:
    """The true M1, M2 and K12."""
    return {name: twin.true[name] for name in MASSES}


def maps(config: Config, twin: Twin, rigid: RigidDrive, out: Path) -> dict[str, xr.Dataset]:
    """One map a method; all of them begin with the same draws."""
    n = config.share(config.global_draws, twin.law)
    draws = np.random.default_rng(config.seed).uniform(-config.global_off, config.global_off, (n, 3))
    return {method.name: _map(config, twin, rigid, method, draws, out) for method in METHODS}


def _map(config: Config, twin: Twin, rigid: RigidDrive, method: Method, draws: np.ndarray, out: Path) -> xr.Dataset:
    off = draws if method.bounded else draws[: config.share(config.global_didim_draws, twin.law)]
    starts = start(method, twin, rigid, off)
    one = problem(method, twin)
    job = Job(
        name=f"step3_{method.slug}_{twin.law}",
        method=method,
        problem=one,
        starts=starts,
        target=target(twin),
        tolerance=TOLERANCE if method.bounded else DIDIM_TOLERANCE,
        stopping=_STOPPING if method.bounded else STEP_3,
        key=twin.key,
        unstable=twin.unstable([one[0].plant(theta) for theta in starts]),
        batch=4 if method.bounded else 2,
    )
    return run(job, out).assign(off=(("lane", "of"), off)).assign_coords(of=list(MASSES))


def ranges(lanes: xr.Dataset) -> dict[str, object]:
    """What `ranges.json` says of one map."""
    worst = np.abs(lanes["off"].values).max(axis=1)
    unstable = lanes["unstable"].values
    said: dict[str, object] = {"all starts": count(lanes), "stable loop at the start": count(lanes, ~unstable)}
    for limit in (0.1, 0.2, 0.4):
        said[f"every error below {100 * limit:g} %"] = count(lanes, worst < limit)
    return said
