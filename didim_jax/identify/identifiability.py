"""What a record can tell, said before the fit: a bound on every parameter, and the combinations that stay open.

References: paper, eq. 14; C. R. Rao, 1945, H. Cramer, 1946.
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..errors import InputError
from ..params import Parameter, select
from ..plant import AbstractPlant, RigidDrive
from ..statistics import cramer_rao
from .flexible_mode import mode_parameters
from .least_squares import DIVERGED, exact_columns, linear_system
from .parametrisation import PlantParameters
from .trial import Trial

SUPPOSED_RESIDUAL = 0.05
"""Residual for which bounds are stated, relative to the motor force: about what the paper's tables report."""

WEAK_PERCENT = 20.0
"""A bound above this is called weak."""

VISIBLE = 0.1
"""Least share of the rigid model's residual energy that a mode must explain before its parameters are given."""


@dataclasses.dataclass(frozen=True)
class Identifiability:
    """Bounds at a supposed drive, for a residual of a supposed size.

    `bound_percent`: smallest relative standard deviation that each parameter can have, (n_theta,).
    `directions`: the combinations that the record gives worst, in words, worst first.
    `verdict`: one sentence for a person; `lost`: parameters that this record cannot give, and that are not given.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    bound_percent: np.ndarray
    directions: tuple[str, ...]
    verdict: str
    lost: tuple[str, ...] = ()


def bounds(plant: AbstractPlant, names: Sequence[str], trials: tuple[Trial, ...]) -> Identifiability:
    """Cramer-Rao bounds at a supposed plant; the initial state of every record is unknown too.

    A parameter below a tenth of its typical size counts with that size: a percentage of nothing says nothing.
    """
    chosen = select(plant, names)
    parametrisation = PlantParameters(plant, chosen, False)
    theta = parametrisation.start()
    z = jnp.concatenate([parametrisation.encode(theta), jnp.zeros(sum(t.n_start for t in trials))])
    r, J = linear_system(z, (parametrisation, trials), exact_columns)
    Y = np.concatenate([np.asarray(t.observed) for t in trials])
    if not (np.isfinite(J).all() and np.abs(r).max() < DIVERGED * np.abs(Y).max()):
        supposed = ", ".join(f"{p.name} = {value:.3g} {p.unit}" for p, value in zip(chosen, theta, strict=True))
        raise InputError(
            f"the closed loop of the supposed drive is unstable ({supposed}): "
            "correct mass_apriori (kg), or the gains of controller and drive, in machine.toml."
        )
    scale = np.array([p.scale for p in chosen])
    size = np.where(np.abs(theta) > 0.1 * scale, np.abs(theta), scale)
    relative = np.array(J)
    relative[:, : len(chosen)] *= size / scale  # columns per relative change of theta
    sigma = SUPPOSED_RESIDUAL * float(np.sqrt(np.mean(Y**2)))
    covariance = cramer_rao(relative, sigma)[: len(chosen), : len(chosen)]
    bound = 100 * np.sqrt(np.diag(covariance))
    weak = [p.name for p, b in zip(chosen, bound, strict=True) if not b < WEAK_PERCENT]
    said = f"a residual of {100 * SUPPOSED_RESIDUAL:g} % of the motor force"
    verdict = (
        f"This record gives {_join(weak)} only weakly (bound above {WEAK_PERCENT:g} % for {said})."
        if weak
        else f"This record gives all {len(chosen)} parameters (bounds up to {np.max(bound):.2g} % for {said})."
    )
    said_of = tuple(p.name for p in chosen), tuple(p.unit for p in chosen)
    return Identifiability(*said_of, bound, _in_words(covariance, chosen), verdict)


def _in_words(covariance: np.ndarray, chosen: Sequence[Parameter]) -> tuple[str, ...]:
    """The two combinations with the largest spread: which parameters trade against which, and by how much."""
    spread, axes = np.linalg.eigh(covariance)
    said = []
    for k in np.argsort(-spread)[:2]:
        axis = axes[:, k] * np.sign(axes[np.argmax(np.abs(axes[:, k])), k])
        parts = [p for p in np.argsort(-np.abs(axis)) if abs(axis[p]) > 0.3]
        up = [chosen[p].name for p in parts if axis[p] > 0]
        down = [chosen[p].name for p in parts if axis[p] < 0]
        trade = f"{_join(up)} against {_join(down)}" if down else _join(up) + (" together" if len(up) > 1 else " alone")
        said.append(f"{trade}: {100 * np.sqrt(max(spread[k], 0)):.2g} %")
    return tuple(said)


def _join(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


@dataclasses.dataclass(frozen=True)
class ModeScan:
    """The criterion norm(rho)/norm(Y) over mass ratio and mode (Hz), (n_lam, n_f_n), beside the rigid drive's."""

    lam: np.ndarray
    f_n: np.ndarray
    cost: np.ndarray
    rigid_cost: float

    @property
    def best(self) -> tuple[float, float]:
        """(lam, f_n) of the lowest finite cost."""
        i, j = np.unravel_index(np.nanargmin(np.where(np.isfinite(self.cost), self.cost, np.nan)), self.cost.shape)
        return float(self.lam[i]), float(self.f_n[j])

    @property
    def explained(self) -> float:
        """Share of the rigid drive's residual energy that the best flexible one explains."""
        return 1 - float(np.nanmin(self.cost) / self.rigid_cost) ** 2

    @property
    def visible(self) -> bool:
        """Whether the record shows a flexible mode at all."""
        return self.explained > VISIBLE

    @property
    def lowest_possible_hz(self) -> float:
        """Lowest mode that some mass ratio allows without a criterion 10 % above the rigid drive's."""
        allowed = np.any(self.cost < 1.1 * self.rigid_cost, axis=0)
        return float(self.f_n[np.argmax(allowed)]) if allowed.any() else float("nan")


LAM_GRID = np.linspace(0.15, 0.9, 6)
F_N_GRID = np.geomspace(8.0, 100.0, 14)


def scan_modes(
    rigid: RigidDrive,
    rigid_cost: float,
    trials: tuple[Trial, ...],
    lam: np.ndarray = LAM_GRID,
    f_n: np.ndarray = F_N_GRID,
) -> ModeScan:
    """Simulate every record for a grid of modes with the rigid drive's totals, in one batch.

    References: paper, eq. 26-27 (which drives are tried) and 28 (over which range).
    """
    family = mode_parameters(rigid)
    grid = jnp.asarray([(a, b) for a in lam for b in f_n])
    squares = sum(_costs(family, trial, grid) for trial in trials)
    norm = np.linalg.norm(np.concatenate([np.asarray(t.observed) for t in trials]))
    cost = np.sqrt(np.asarray(squares)).reshape(len(lam), len(f_n)) / norm
    return ModeScan(np.asarray(lam), np.asarray(f_n), np.where(np.isfinite(cost), cost, np.inf), rigid_cost)


@eqx.filter_jit
def _costs(family: eqx.Module, trial: Trial, grid: Array) -> Array:
    def cost(theta: Array) -> Array:
        r = trial.predict(family.plant(theta), jnp.zeros(trial.n_start)) - trial.observed  # type: ignore[attr-defined]
        return r @ r

    return jax.lax.map(cost, grid, batch_size=16)


def hidden_mode(scan: ModeScan, chosen: Sequence[Parameter]) -> Identifiability:
    """The statement for a record that shows no flexible mode: nothing of the flexible model is given apart."""
    verdict = (
        "This record cannot give M2 and K12 apart: no flexible mode shows in it. "
        f"The best one explains {100 * max(scan.explained, 0):.1f} % of what the rigid model leaves "
        f"({100 * VISIBLE:g} % is the least that counts), and any drive whose mode lies above about "
        f"{scan.lowest_possible_hz:.0f} Hz fits as well as a rigid one. Excite the mode (a chirp through it), or use "
        "the rigid model."
    )
    lost = tuple(p.name for p in chosen)
    return Identifiability(lost, tuple(p.unit for p in chosen), np.full(len(lost), np.inf), (), verdict, lost)
