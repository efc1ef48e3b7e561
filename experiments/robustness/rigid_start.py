"""Step 1: rigid DIDIM at 5 Hz from an a-priori mass of 1 to 10,000 kg (paper, eq. 22; it reports 25 to 1000 kg)."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import xarray as xr

from didim_jax.identify import PlantParameters, Stopping, didim
from didim_jax.identify.three_step import RIGID_HZ
from didim_jax.params import names, unpack
from didim_jax.plant import CoulombViscous, RigidDrive

from .config import Config
from .job import DIDIM, SAFE_DIDIM, Job, Method, count, range_of, run
from .twin import Twin

TOLERANCE = 0.01
"""Of M, Fv and Fc: a lane within it has found the estimate that a start at 100 kg leads to."""

STOPPING = Stopping(tolerance=1e-3)

_MARGIN = 1.25
"""Of the mass: at the very edge the loop is stable without friction, and no longer with it."""

NAMES = ("M", "Fv", "Fc", "offset")


def totals(twin: Twin) -> RigidDrive:
    """The rigid drive that step 1 gives from a good start, to five digits.

    Later steps start from it, and a store knows its own by the starts: the last bits differ from run to run.
    """
    start = _drive(100.0)
    result = didim(start, NAMES, (twin.trial(start, RIGID_HZ),))
    rigid = unpack(start, jnp.asarray([float(f"{value:.5g}") for value in result.theta]))
    assert result.names == names(rigid)
    return rigid


def maps(config: Config, twin: Twin, rigid: RigidDrive, out: Path) -> dict[str, xr.Dataset]:
    """One map without and one with the safeguard, by the method's name."""
    masses = np.geomspace(*config.rigid_mass_kg, config.rigid_starts)
    unstable = twin.unstable([_drive(m) for m in masses])
    lifted = np.array([stable_mass(twin, m) for m in masses])
    given = {DIDIM.name: (DIDIM, masses), SAFE_DIDIM.name: (SAFE_DIDIM, lifted)}
    return {name: _map(config, twin, rigid, m, starts, masses, unstable, out) for name, (m, starts) in given.items()}


def stable_mass(twin: Twin, mass: float) -> float:
    """The mass doubled until the simulated loop around it is stable, with a margin.

    That takes the controller's law, not the machine. A start whose own loop is unstable has no finite simulation, and
    no step control can begin from it.
    """
    while twin.radius(_drive(mass / _MARGIN)) > 1:
        mass *= 2
    return mass


def ranges(lanes: xr.Dataset) -> dict[str, object]:
    """What `ranges.json` says of one map."""
    mass, unstable = lanes["given_mass"].values, lanes["unstable"].values
    inside = (mass >= 10) & (mass <= 1000)
    return {
        "all starts": count(lanes),
        "10 to 1000 kg": count(lanes, inside),
        "unstable loop at the start": count(lanes, unstable),
        "stable loop at the start": count(lanes, ~unstable),
        "unbroken range of M that converges, kg": range_of(lanes, mass, near=100.0),
    }


def _map(
    config: Config,
    twin: Twin,
    rigid: RigidDrive,
    method: Method,
    starts: np.ndarray,
    given: np.ndarray,
    unstable: np.ndarray,
    out: Path,
) -> xr.Dataset:
    template = _drive(100.0)
    theta = np.zeros((len(starts), len(NAMES)))
    theta[:, 0] = starts
    job = Job(
        name=f"step1_{'safe' if method is SAFE_DIDIM else 'didim'}_{twin.law}",
        method=method,
        problem=(PlantParameters.of(template, NAMES, bounded=False), (twin.trial(template, RIGID_HZ),)),
        starts=theta,
        target={"M": float(rigid.M), "Fv": float(rigid.friction.Fv), "Fc": float(rigid.friction.Fc)},  # type: ignore[attr-defined]
        tolerance=TOLERANCE,
        stopping=STOPPING,
        key=twin.key,
        unstable=unstable,
    )
    return run(job, out).assign(given_mass=("lane", given))


def _drive(mass: float) -> RigidDrive:
    return RigidDrive(mass, CoulombViscous(0.0, 0.0), 0.0)
