"""What one iteration costs: simulations, tangents, seconds, warm."""

import statistics
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp

from didim_jax.identify import PlantParameters, didim_columns, exact_columns, linear_system
from didim_jax.signals import Decimation
from didim_jax.simulate import simulate

from .config import Config
from .twin import FIVE, SEVEN, Twin


def iteration_seconds(twin: Twin, config: Config) -> dict[str, float]:
    """Median seconds of one simulation, and of residual and columns together for each kind."""
    trial = twin.trial(twin.plant, Decimation.at(config.cutoff_hz, twin.dt), twin.noisy)
    kinds = {"DIDIM": didim_columns, "exact": exact_columns}
    seconds = {
        "one simulation": _median(lambda: simulate(trial.loop, trial.excitation, trial.start).tau, config.timings)
    }
    for names, said in ((FIVE, "five"), (SEVEN, "seven")):
        parametrisation = PlantParameters.of(twin.plant, names, bounded=False)
        x, problem = parametrisation.encode(parametrisation.start()), (parametrisation, (trial,))
        for kind, columns in kinds.items():
            seconds[f"{kind}, {said} columns"] = _median(
                lambda x=x, problem=problem, columns=columns: linear_system(jnp.array(x), problem, columns),  # type: ignore[misc]
                config.timings,
            )
    return seconds


def _median(call: Callable[[], object], n: int) -> float:
    jax.block_until_ready(call())  # compiles
    seconds = []
    for _ in range(n):
        begin = time.perf_counter()
        jax.block_until_ready(call())
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)
