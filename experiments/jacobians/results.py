"""Everything that is computed, in order, as flat arrays (for the figures) and a tree of numbers (for the text)."""

import dataclasses
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from didim_jax.plant import AbstractPlant, CoulombViscous, FlexibleDrive, RigidDrive, mode
from didim_jax.signals import Decimation, LowPass

from . import angles
from .config import Config
from .cost import iteration_seconds
from .draws import bound, checked, coverage, coverage_limits, every_method, own_std
from .friction import separations
from .paths import Path, distance, eq_21, flexible_paths, rigid_paths, step_paths
from .twin import PHASES, SEVEN, Starts, Twin, build_twin, drive, first_steps, phases

type Arrays = dict[str, np.ndarray]
type Numbers = dict[str, Any]

THREE = ("M", "Fv", "Fc")
WHOLE = "load side"
"""Name of the column for a common relative change of M2, Fv2, Fc2 and K12."""

_LOAD = [SEVEN.index(n) for n in ("M2", "Fv2", "Fc2", "K12")]
_BIN_HZ = 2.0


@dataclasses.dataclass(frozen=True)
class Results:
    """Arrays by dotted key, numbers by nested key."""

    arrays: Arrays
    numbers: Numbers


def compute(config: Config) -> Results:
    """The whole study."""
    begin = time.perf_counter()
    twin = build_twin(config)
    starts = first_steps(twin.case())
    arrays: Arrays = {"truth": twin.truth, "names": np.array(SEVEN)}
    numbers: Numbers = {
        "truth": _named(SEVEN, twin.truth),
        "step 2": _named(starts.step2.names, starts.step2.theta),
    }
    pair = angles.columns(twin, twin.plant, SEVEN)
    seconds = {}
    for part in (
        lambda: _at_the_truth(twin, config, pair),
        lambda: _modes(twin, config),
        lambda: _paths(twin, starts, config),
        lambda: _draws(twin, starts, config, pair),
        lambda: _friction(twin, config),
    ):
        since = time.perf_counter()
        name, found, said = part()
        arrays.update({f"{name}.{key}": value for key, value in found.items()})
        numbers[name] = said
        seconds[name] = time.perf_counter() - since
    numbers["cost"] = {
        "iteration": iteration_seconds(twin, config),
        "steps": {key: _cost(path) for key, path in step_paths(twin).items()},
        "step 3": numbers["paths"].pop("cost"),
    }
    numbers["seconds"] = {**seconds, "all": time.perf_counter() - begin}
    return Results(arrays, numbers)


def rigid_twin(twin: Twin) -> RigidDrive:
    """A rigid drive with the twin's totals."""
    M1, Fv1, Fc1, M2, Fv2, Fc2, _ = twin.truth
    return RigidDrive(M1 + M2, CoulombViscous(Fv1 + Fv2, Fc1 + Fc2))


def _named(names: Sequence[str], values: np.ndarray) -> dict[str, float]:
    return dict(zip(names, np.asarray(values).tolist(), strict=True))


# -- columns at the truth ----------------------------------------------------------------------------------------


def _at_the_truth(twin: Twin, config: Config, pair: angles.Pair) -> tuple[str, Arrays, Numbers]:
    """Columns of the rigid and the flexible drive: as a whole, by band, by phase, and the loop's answer T."""
    arrays: Arrays = {"bands_hz": np.array(config.bands_hz), "phases": np.array(PHASES)}
    numbers: Numbers = {}
    labels = phases(twin.dt)
    rigid = angles.columns(twin, rigid_twin(twin), THREE)
    for model, here, names in (("rigid", rigid, THREE), ("flexible", pair, (*SEVEN, WHOLE))):
        W, J = _with_whole(here, twin.truth) if model == "flexible" else (here.W, here.J)
        arrays[f"{model}.names"] = np.array(names)
        for hz in (config.rigid_hz, config.cutoff_hz):
            low_pass = LowPass.butterworth(hz, twin.dt)
            Wf, Jf = low_pass(W), low_pass(J)
            whole = angles.compare(Wf, Jf)
            numbers[f"{model} {hz:g} Hz"] = {key: _named(names, value) for key, value in whole.items()}
            stacked = here.filtered(Decimation.at(hz, twin.dt)).stacked()
            numbers[f"{model} {hz:g} Hz"]["stacked cosine"] = _named(
                names[: here.J.shape[1]], angles.compare(*stacked)["cosine"]
            )
            numbers[f"{model} {hz:g} Hz"]["contraction"] = angles.contraction(*stacked).tolist()
        # after the loop the 60 Hz versions are the last ones
        arrays |= {f"{model}.phase.{k}": v for k, v in angles.by_phase(Wf, Jf, labels, len(PHASES)).items()}
        arrays |= {f"{model}.band.{k}": v for k, v in angles.by_band(W, J, twin.dt, config.bands_hz).items()}
        arrays |= {f"{model}.W": Wf, f"{model}.J": Jf}
    arrays["t"] = twin.dt * np.arange(len(twin.qg))
    arrays["labels"] = labels
    for name, plant, here in (("rigid", rigid_twin(twin), rigid), ("flexible", twin.plant, pair)):
        f, T = angles.response(here.W[:, 0], here.J[:, 0], twin.dt, _BIN_HZ, config.bands_hz[-1])
        arrays |= {"f": f, f"{name}.T": T, f"{name}.loop": angles.loop_response(twin.machine, plant, f)}
    return "columns", arrays, numbers


def _with_whole(pair: angles.Pair, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    w, j = angles.load_as_a_whole(pair, theta, _LOAD)
    return np.hstack([pair.W, w]), np.hstack([pair.J, j])


# -- stiffness and cutoff ----------------------------------------------------------------------------------------


def _modes(twin: Twin, config: Config) -> tuple[str, Arrays, Numbers]:
    """Relative error and cosine of the columns, (n_modes, n_cutoffs, 8), and the contraction, (n_modes, n_cutoffs)."""
    found: dict[str, list] = {"cosine": [], "error": [], "slowest": []}
    for f_n in config.modes_hz:
        theta = twin.truth.copy()
        theta[SEVEN.index("K12")] = theta[SEVEN.index("M2")] * (2 * np.pi * f_n) ** 2
        pair = angles.columns(twin, drive(theta), SEVEN)
        W, J = _with_whole(pair, theta)
        rows = []
        for hz in config.cutoffs_hz:
            low_pass = LowPass.butterworth(hz, twin.dt)
            stacked = pair.filtered(Decimation.at(hz, twin.dt)).stacked()
            # The three directions in which the load side cannot move have eigenvalue 1 and are left out.
            slowest = angles.contraction(*stacked)[: len(SEVEN) - 3][-1]
            rows.append({**angles.compare(low_pass(W), low_pass(J)), "slowest": slowest})
        for key, values in found.items():
            values.append([row[key] for row in rows])
    arrays = {key: np.array(values) for key, values in found.items()}
    arrays |= {
        "f_n": np.array(config.modes_hz),
        "cutoff": np.array(config.cutoffs_hz),
        "names": np.array((*SEVEN, WHOLE)),
    }
    rigid = angles.columns(twin, rigid_twin(twin), THREE)
    arrays["rigid.error"] = np.array(
        [angles.compare(*_both(rigid, LowPass.butterworth(hz, twin.dt)))["error"] for hz in config.cutoffs_hz]
    )
    good = {n: _good_to(arrays, k, config.accepted) for k, n in enumerate((*SEVEN, WHOLE))}
    rigid_good = {
        n: crossing(arrays["cutoff"], arrays["rigid.error"][:, k], config.accepted) for k, n in enumerate(THREE)
    }
    numbers = {"f_n": list(config.modes_hz), "good to, Hz": good, "rigid good to, Hz": rigid_good}
    return "modes", arrays, numbers


def _both(pair: angles.Pair, low_pass: LowPass) -> tuple[np.ndarray, np.ndarray]:
    return low_pass(pair.W), low_pass(pair.J)


def _good_to(arrays: Arrays, column: int, accepted: float) -> list[float]:
    """Per mode, the cutoff below which a column's relative error stays accepted."""
    return [crossing(arrays["cutoff"], row[:, column], accepted) for row in arrays["error"]]


def crossing(x: np.ndarray, y: np.ndarray, level: float) -> float:
    """Where y first rises above a level, log y linear in log x; the last x where it never does, nan if at once."""
    above = np.flatnonzero(~(y <= level))
    if above.size == 0:
        return float(x[-1])
    k = int(above[0])
    if k == 0 or not np.isfinite(y[k]):
        return float("nan")
    ends = slice(k - 1, k + 1)
    return float(np.exp(np.interp(np.log(level), np.log(y[ends]), np.log(x[ends]))))


# -- paths -------------------------------------------------------------------------------------------------------


def _paths(twin: Twin, starts: Starts, config: Config) -> tuple[str, Arrays, Numbers]:
    """Criterion, distance and angles by iteration; what each method costs."""
    arrays: Arrays = {}
    numbers: Numbers = {"cost": {}}
    for key, path in flexible_paths(twin, starts, config).items():
        result = path.result
        plants = [_flexible(result.names, theta) for theta in result.trace]
        arrays |= _along(twin, key, plants, config.cutoff_hz, SEVEN)
        arrays |= {f"{key}.costs": result.costs, f"{key}.distance": distance(result, result.trace, twin.truth)}
        arrays |= {f"{key}.trace": result.trace, f"{key}.stop": np.array(eq_21(result.costs))}
        numbers["cost"][key] = _cost(path)
        f_n = [float(mode(p.M2, p.K12)) for p in plants]
        numbers[key] = {"theta": _named(result.names, result.theta), "reason": result.reason, "f_n, Hz": f_n}
    for key, path in rigid_paths(twin, config).items():
        rigid = [RigidDrive(M, CoulombViscous(Fv, Fc)) for M, Fv, Fc in path.result.trace]
        hz = config.rigid_hz if "5 Hz" in key else config.cutoff_hz
        arrays |= _along(twin, f"rigid {key}", rigid, hz, THREE)
        arrays[f"rigid {key}.costs"] = path.result.costs
        numbers["cost"][f"rigid {key}"] = _cost(path)
        numbers[f"rigid {key}"] = {"theta": _named(THREE, path.result.theta), "std": _named(THREE, path.result.std)}
    return "paths", arrays, numbers


def _along(twin: Twin, key: str, plants: Sequence[AbstractPlant], hz: float, names: Sequence[str]) -> Arrays:
    low_pass = LowPass.butterworth(hz, twin.dt)
    found = [angles.compare(*_both(angles.columns(twin, plant, names), low_pass)) for plant in plants]
    return {f"{key}.{k}": np.array([one[k] for one in found]) for k in ("cosine", "ratio", "error")}


def _flexible(names: Sequence[str], theta: np.ndarray) -> FlexibleDrive:
    """A drive of a path; what the path does not have is zero."""
    full = np.zeros(len(SEVEN))
    full[[SEVEN.index(n) for n in names]] = theta
    return drive(full)


def _cost(path: Path) -> Numbers:
    result = path.result
    return {
        "iterations": result.n_iterations,
        "simulations": result.n_simulations,
        "parameters": len(result.names),
        "first call, s": path.first_seconds,
        "warm, s": path.warm_seconds,
        "warm per simulation, s": path.warm_seconds / result.n_simulations,
    }


# -- draws -------------------------------------------------------------------------------------------------------


def _draws(twin: Twin, starts: Starts, config: Config, pair: angles.Pair) -> tuple[str, Arrays, Numbers]:
    """Bias, spread, coverage."""
    truth, covariance = twin.truth, bound(pair.J, config.noise)
    unit = np.sqrt(np.diag(covariance))
    samples, observed = every_method(twin, starts, config)
    arrays: Arrays = {"bound": unit, "covariance": covariance}
    numbers: Numbers = {"bound": _named(SEVEN, unit)}
    for key, found in samples.items():
        arrays[f"{key}.theta"] = found.theta
        own = np.where(found.std > 1e-9 * truth, found.std, np.nan)  # what never moves has no spread
        numbers[key] = {
            "draws": found.draws,
            "converged": found.converged,
            "iterations": found.iterations,
            "criterion": float(found.costs.mean()),
            "names": list(found.names),
            "bias": _named(SEVEN, found.bias(truth)),
            "std": _named(SEVEN, found.std),
            "bias in its std": _named(SEVEN, found.bias(truth) / own),
            "bias in bounds": _named(SEVEN, found.bias(truth) / unit),
            "std over the bound": _named(SEVEN, found.std / unit),
            "bias of Fv, Fc": [float(found.bias(truth)[[k, k + 3]].sum()) for k in (1, 2)],
        }
    exact = samples["gauss-newton"]
    if exact.converged == exact.draws:  # else draws and signals no longer belong to each other
        stated = own_std(twin, config, pair, exact.theta, observed)
        kinds = {"white": stated.white, "autocorrelated": stated.autocorrelated, "bound": unit}
        arrays |= {"own.white": stated.white, "own.autocorrelated": stated.autocorrelated}
        numbers["stated std over the bound"] = {
            k: _named(SEVEN, np.median(std, axis=0) / unit) for k, std in kinds.items() if k != "bound"
        }
        covered = {k: coverage(exact.theta, std, truth) for k, std in kinds.items()}
        arrays |= {f"coverage.{k}": v for k, v in covered.items()}
        numbers["coverage"] = {k: _named(SEVEN, v) for k, v in covered.items()}
        numbers["check"] = dataclasses.asdict(checked(twin, starts, config, observed, exact, stated, unit))
    limits = coverage_limits(exact.draws)
    arrays["coverage.limits"] = np.array(limits)
    numbers["coverage limits"] = list(limits)
    return "draws", arrays, numbers


# -- friction ----------------------------------------------------------------------------------------------------


def _friction(twin: Twin, config: Config) -> tuple[str, Arrays, Numbers]:
    """Bound and spread of the seven parameters by excitation."""
    found = separations(twin, config)
    arrays: Arrays = {"excitations": np.array(list(found))}
    arrays["bound"] = np.array([s.std for s in found.values()])
    arrays["std"] = np.array([s.sample.std for s in found.values()])
    numbers: Numbers = {}
    for name, s in found.items():
        numbers[name] = {
            "bound": _named(SEVEN, s.std),
            "std": _named(SEVEN, s.sample.std),
            "draws": s.sample.draws,
            "converged": s.sample.converged,
            "correlation Fv1 Fv2": s.correlation("Fv1", "Fv2"),
            "correlation Fc1 Fc2": s.correlation("Fc1", "Fc2"),
            "bound of Fv1 + Fv2": s.sum_std("Fv1", "Fv2"),
            "bound of Fc1 + Fc2": s.sum_std("Fc1", "Fc2"),
        }
    arrays["correlation"] = np.array(
        [[s.correlation("Fv1", "Fv2"), s.correlation("Fc1", "Fc2")] for s in found.values()]
    )
    return "friction", arrays, numbers
