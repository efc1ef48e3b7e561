"""No start at all: random machines, identified from motor force by a coarse scan and the exact method.

Rigid DIDIM gives the totals, a scan of the plane (lam, f_n) the neighbourhood, damped exact steps from its best cells
the drive; full steps on the record's own integration end it. Nothing is known beforehand but machine.toml.
"""

import dataclasses
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from didim_jax.errors import InputError
from didim_jax.identify import ModeScan, PlantParameters, Stopping, Trial, didim, scan_modes, split_rigid
from didim_jax.identify.least_squares import Problem
from didim_jax.identify.three_step import RIGID_HZ
from didim_jax.params import names, values
from didim_jax.plant import CoulombViscous, FlexibleDrive, RigidDrive, split
from didim_jax.reference import Chirp, Dwell, Sequence, Together, Trapezoid
from didim_jax.sweep import Ended, Lanes, least_squares_lanes
from didim_jax.synthesize import synthesize

from .config import Config
from .global_start import MASSES
from .job import DAMPED, EXACT, Method
from .safeguard import damped_from_the_start
from .stability import sampled_radius
from .twin import RECORD, Twin

_CELLS = 4
"""Starts taken from the scan."""

_BAND_HZ = 120.0
"""Twice the paper's: with little load the drive resonates at f_n / sqrt(lam), up to 130 Hz."""

_SAMPLES = 17000

_DAMPED = dataclasses.replace(DAMPED, solver=damped_from_the_start(growth=10.0))

_BEGIN = Stopping(tolerance=1e-3, max_iterations=6)
"""Enough to tell which starts are in the right pit."""

_FINALISTS = 2

_TRIES = 3
"""Times that the next best cells are tried where the end is not one, or has a friction that drives the machine."""

_MIDDLE = Stopping(tolerance=1e-3, max_iterations=10)

_END = Stopping(tolerance=1e-3, max_iterations=40)


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A random machine and what its identification gave. Errors are relative; `seconds` warm, the record at hand."""

    true: dict[str, float]
    lam: float
    f_n_Hz: float
    noise_N: float
    amplitude: float
    estimate: dict[str, float]
    error: float
    converged: bool
    iterations: int
    seconds: float
    processor_seconds: float

    @property
    def right(self) -> dict[str, float]:
        """Relative error of each of M1, M2, K12."""
        return {n: self.estimate[n] / self.true[n] - 1 for n in MASSES}


def identify_all(config: Config, twin: Twin) -> list[Drawn]:
    """Draw and identify every machine, one after the other as they would arrive."""
    draw = np.random.default_rng(config.seed)
    machines = [random_twin(twin, draw, seed) for seed in range(config.twins)]
    _compile(machines[0][0])
    with_progress = track(machines, "machines without a start", console=Console(stderr=True))
    return [_identify(*machine) for machine in with_progress]


def _compile(twin: Twin) -> None:
    """Once through everything that an identification may need, its second try included."""
    without_start(twin)
    problem = (_parametrisation(twin.truth), (twin.trial(twin.truth, _BAND_HZ, method=RECORD),))
    _lanes(_DAMPED, problem, np.array([list(values(twin.truth).values())]), _END, batch=1)


def _parametrisation(template: FlexibleDrive) -> PlantParameters:
    return PlantParameters.of(template, names(template), bounded=True)


def random_twin(twin: Twin, draw: np.random.Generator, seed: int) -> tuple[Twin, dict[str, float]]:
    """A machine with the twin's controller and drive, anything else drawn, and its record of 17 s within 10 V."""
    while True:
        lam, f_n, M = draw.uniform(0.2, 0.9), np.exp(draw.uniform(np.log(10), np.log(60))), draw.uniform(60, 200)
        Fv, Fc, noise = draw.uniform(50, 400), draw.uniform(5, 40), draw.uniform(0.5, 5)
        share = draw.uniform(0.2, 0.8, 2)
        M1, M2, K12 = (float(x) for x in split(M, lam, f_n))
        motor, load = (CoulombViscous(*(s * np.array([Fv, Fc]))) for s in (share, 1 - share))
        plant = FlexibleDrive(M1, motor, M2, load, K12)
        qg = random_reference(draw, twin.machine.controller.sample_time)
        if sampled_radius(plant, twin.machine) > 0.998:  # the rig itself could not run, or would hardly settle
            continue
        amplitude = 1.0
        for _ in range(8):
            try:
                recording = synthesize(
                    twin.machine, plant, qg[0] + amplitude * (qg - qg[0]), force_noise=noise, seed=seed
                )
            except InputError:  # beyond the drive's range
                amplitude *= 0.8
                continue
            drawn = {"noise": noise, "amplitude": amplitude, "lam": lam, "f_n": f_n}
            return dataclasses.replace(twin, truth=plant, recording=recording), drawn


def random_reference(draw: np.random.Generator, dt: float) -> np.ndarray:
    """Reference positions (m), 17 s: the twin's kind of motion, trapezoids and chirps up to 110 Hz, sizes drawn."""
    fast = Trapezoid(draw.uniform(0.06, 0.12), draw.uniform(0.12, 0.22), draw.uniform(1.0, 2.0), dwell=0.1)
    slow = Trapezoid(0.15, draw.uniform(0.05, 0.06), 1.0)
    about_rest = Chirp(draw.uniform(0.02, 0.03), 1.0, draw.uniform(30, 36), 5.5, 2.0, 0.4)
    about_motion = Chirp(draw.uniform(0.8e-4, 1.2e-4), draw.uniform(10, 14), draw.uniform(34, 40), 5.0, 0.0)
    high = Chirp(draw.uniform(0.8e-4, 1.2e-4), 110.0, draw.uniform(28, 34), 3.0, 0.0)
    motion = Sequence((Dwell(0.3), fast, about_rest, Together((slow, about_motion)), high))
    qg = 0.045 + motion.sample(dt)
    return np.pad(qg, (0, max(0, _SAMPLES - len(qg))), mode="edge")[:_SAMPLES]


def _identify(twin: Twin, drawn: dict) -> Drawn:
    begin, processor = time.perf_counter(), time.process_time()
    end, iterations, converged = without_start(twin)
    seconds, processor = time.perf_counter() - begin, time.process_time() - processor
    true = values(twin.truth)
    return Drawn(
        true=true,
        lam=drawn["lam"],
        f_n_Hz=drawn["f_n"],
        noise_N=drawn["noise"],
        amplitude=drawn["amplitude"],
        estimate=end,
        error=max(abs(end[n] / true[n] - 1) for n in MASSES),
        converged=converged,
        iterations=iterations,
        seconds=seconds,
        processor_seconds=processor,
    )


def without_start(twin: Twin) -> tuple[dict[str, float], int, bool]:
    """Theta by name, its iterations, and whether they converged."""
    rough = RigidDrive(twin.machine.mass_apriori, CoulombViscous(0.0, 0.0), 0.0)
    totals = didim(rough, names(rough), (twin.trial(rough, RIGID_HZ),))
    rigid = totals.plant
    assert isinstance(rigid, RigidDrive)
    template = split_rigid(rigid, 0.5, 30.0, friction_share=0.5)
    trial = twin.trial(template, _BAND_HZ)
    cells = best_cells(scan_modes(rigid, 1.0, (trial,)), _CELLS * _TRIES)
    parametrisation = _parametrisation(template)
    iterations, ends = 0, []
    for k in range(_TRIES):
        drives = [split_rigid(rigid, lam, f_n, friction_share=0.5) for lam, f_n in cells[k * _CELLS : (k + 1) * _CELLS]]
        starts = np.array([list(values(drive).values()) for drive in drives])
        end, more, ended = _from_cells(twin, template, parametrisation, trial, starts)
        iterations += more
        possible = ended and all(end[name] >= 0 for name in ("Fv1", "Fc1", "Fv2", "Fc2"))
        ends.append((possible, end))
        if possible:
            break
    # Where no end is a machine the first one is reported, and that it is none.
    possible, end = next((found for found in ends if found[0]), ends[0])
    return end, iterations, possible


def _from_cells(
    twin: Twin, template: FlexibleDrive, parametrisation: PlantParameters, trial: Trial, starts: np.ndarray
) -> tuple[dict[str, float], int, bool]:
    """Damped steps from some cells, the best of them ended by the exact method."""
    problem = (parametrisation, (trial,))
    begun = _lanes(_DAMPED, problem, starts, _BEGIN, batch=2)
    better = np.argsort(_cost(begun))[:_FINALISTS]
    middle = _lanes(_DAMPED, problem, np.asarray(begun.theta)[better], _MIDDLE, batch=1)
    best = int(np.argmin(_cost(middle)))
    near = np.asarray(middle.theta)[best : best + 1]
    exactly = (parametrisation, (twin.trial(template, _BAND_HZ, method=RECORD),))
    ended = _lanes(EXACT, exactly, near, _END, batch=1)
    if ended.ended[0] != Ended.CONVERGED:
        ended = _lanes(_DAMPED, exactly, near, _END, batch=1)
    end = dict(zip(parametrisation.names, np.asarray(ended.theta[0]).tolist(), strict=True))
    iterations = int(begun.n_iterations[better[best]] + middle.n_iterations[best] + ended.n_iterations[0])
    return end, iterations, bool(ended.ended[0] == Ended.CONVERGED)


def _lanes(method: Method, problem: Problem, starts: np.ndarray, stopping: Stopping, batch: int) -> Lanes:
    assert method.columns is not None and method.solver is not None
    return least_squares_lanes(problem, starts, method.columns, method.solver, stopping, batch=batch)


def _cost(lanes: Lanes) -> np.ndarray:
    cost = np.asarray(lanes.cost)
    return np.where(np.isfinite(cost), cost, np.inf)


def best_cells(scan: ModeScan, n: int) -> list[tuple[float, float]]:
    """(lam, f_n) of the n lowest cells that have no lower neighbour; then, if they are fewer, the lowest others."""
    cost = np.pad(scan.cost, 1, constant_values=np.inf)
    around = np.min(
        [np.roll(cost, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)], axis=0
    )[1:-1, 1:-1]
    order = np.lexsort((scan.cost.ravel(), (scan.cost > around).ravel()))[:n]
    return [
        (float(scan.lam[i]), float(scan.f_n[j])) for i, j in zip(*np.unravel_index(order, scan.cost.shape), strict=True)
    ]


def ranges(drawn: list[Drawn], tolerance: float) -> dict[str, object]:
    """What `ranges.json` says."""
    error = np.array([d.error for d in drawn])
    seconds = np.array([d.seconds for d in drawn])
    wrong = [d for d in drawn if not d.error < tolerance]
    return {
        "machines": len(drawn),
        "right": int(np.sum(error < tolerance)),
        "error_percent_median": 100 * float(np.median(error)),
        "error_percent_most": 100 * float(np.max(error)),
        "seconds_median": float(np.median(seconds)),
        "seconds_most": float(np.max(seconds)),
        "processor_seconds_median": float(np.median([d.processor_seconds for d in drawn])),
        "processor_seconds_most": max(d.processor_seconds for d in drawn),
        "under_one_second": int(np.sum(seconds < 1)),
        "wrong": [dataclasses.asdict(d) for d in wrong],
    }


def write(drawn: list[Drawn], out: Path) -> None:
    """All machines as a labelled table in `maps/no_start.zarr`."""
    import xarray as xr

    columns = {f: ("machine", np.array([getattr(d, f) for d in drawn])) for f in ("lam", "f_n_Hz", "noise_N", "error")}
    columns |= {
        f: ("machine", np.array([getattr(d, f) for d in drawn])) for f in ("seconds", "processor_seconds", "iterations")
    }
    theta = np.array([[[d.true[n], d.estimate[n]] for n in d.true] for d in drawn])
    table = xr.Dataset(
        {**columns, "theta": (("machine", "parameter", "of"), theta)},
        coords={"parameter": list(drawn[0].true), "of": ["true", "estimate"]},
    )
    table.to_zarr(out / "maps" / "no_start.zarr", mode="w", consolidated=False)
