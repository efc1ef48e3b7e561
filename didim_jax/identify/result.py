"""What every identification method returns."""

import dataclasses

import numpy as np

from ..plant import AbstractPlant
from ..statistics import Spread


@dataclasses.dataclass(frozen=True)
class IdentificationResult:
    """An estimate and what is needed to judge it; one type for every method.

    `theta`, (n_theta,), in `units`; `plant` is the drive with these parameters.
    `trace` holds every iterate, (n, n_theta), `costs` the criterion norm(rho) / norm(Y) at each.
    `relative_error` is norm(rho) / norm(Y) of the method's own system, as in the paper's tables.
    `gradient_cosine` is the largest cosine between the residual and a column of the Jacobian the method used: near 0
    where its iteration has truly ended, however small the last step. For DIDIM that is not the true gradient.
    `rho`, the method's residual in `rho_unit`, sampled at `rho_dt` (s), is kept for its spectrum.
    `shifts` is how far the fit moved each record's initial state, in typical sizes.
    `steps` are the earlier steps of a procedure that has several.

    References: paper, eq. 13-16.
    """

    method: str
    plant: AbstractPlant
    names: tuple[str, ...]
    units: tuple[str, ...]
    theta: np.ndarray
    spread: Spread
    relative_error: float
    converged: bool
    reason: str
    n_iterations: int
    n_simulations: int
    trace: np.ndarray
    costs: np.ndarray
    rho: np.ndarray
    rho_dt: float
    rho_unit: str = "N"
    gradient_cosine: float = float("nan")
    shifts: tuple[np.ndarray, ...] = ()
    steps: tuple["IdentificationResult", ...] = ()

    @property
    def std(self) -> np.ndarray:
        """Standard deviation where the residual is white (eq. 13-14)."""
        return self.spread.std

    @property
    def std_autocorrelated(self) -> np.ndarray:
        """Standard deviation whatever the spectrum of the residual."""
        return self.spread.std_autocorrelated

    @property
    def rel_std(self) -> np.ndarray:
        """Relative standard deviation, percent: 100 std / abs(theta), NaN for a theta of zero. References: eq. 15."""
        zero = np.abs(self.theta) <= 1e-9 * self.std  # or rounding of one
        return 100 * self.std / np.where(zero, np.nan, np.abs(self.theta))

    @property
    def condition_number(self) -> float:
        """Condition number of the last least squares' matrix, in SI units."""
        return self.spread.condition_number

    def __getitem__(self, name: str) -> float:
        """Value of one parameter. KeyError names those there are."""
        if name not in self.names:
            raise KeyError(f"no parameter {name!r}: {self.method} gave {', '.join(self.names)}.")
        return float(self.theta[self.names.index(name)])
