"""What a map costs: Nelder-Mead from many starts on a long record, timed; and what the fast integration changes."""

import dataclasses
import os
import time

import jax
import jax.numpy as jnp
import numpy as np

from didim_jax.identify import Stopping
from didim_jax.identify.flexible_mode import mode_parameters
from didim_jax.identify.three_step import FLEXIBLE_HZ
from didim_jax.plant import RigidDrive
from didim_jax.sweep import nelder_mead_lanes

from .config import Config
from .mode_start import BOXES
from .twin import FAST, RECORD, Twin


@dataclasses.dataclass(frozen=True)
class Cost:
    """Wall time and processor time (s, all cores) of `starts` times `iterations` of Nelder-Mead, compiled before.

    `load` is the machine's load average meanwhile: beside other programs the wall time is theirs too, and the processor
    time over the number of cores is about what the same would take alone.
    """

    starts: int
    iterations: int
    samples: int
    batch: int
    devices: int
    seconds: float
    processor_seconds: float
    load: float

    @property
    def seconds_alone(self) -> float:
        """Processor time spread over the cores."""
        return self.processor_seconds / self.devices


def measure(config: Config, twin: Twin, rigid: RigidDrive) -> Cost:
    """Starts over eq. 28's box; every lane takes all its iterations."""
    trial = _long(twin, config.cost_samples).trial(twin.truth, FLEXIBLE_HZ)
    problem = (mode_parameters(rigid), (trial,))
    (a, b), (c, d) = BOXES["eq. 28's box"]
    draw = np.random.default_rng(config.seed)
    starts = np.stack([draw.uniform(a, b, config.cost_starts), draw.uniform(c, d, config.cost_starts)], axis=1)
    stopping = Stopping(tolerance=0.0, cost_tolerance=0.0, max_iterations=config.cost_iterations)
    few = config.cost_batch * jax.device_count()
    nelder_mead_lanes(problem, starts[:few], stopping, batch=config.cost_batch)  # compiles
    begin, processor = time.perf_counter(), time.process_time()
    nelder_mead_lanes(problem, starts, stopping, batch=config.cost_batch)
    seconds, processor = time.perf_counter() - begin, time.process_time() - processor
    return Cost(
        config.cost_starts,
        config.cost_iterations,
        config.cost_samples,
        config.cost_batch,
        jax.device_count(),
        seconds,
        processor,
        os.getloadavg()[0],
    )


def _long(twin: Twin, samples: int) -> Twin:
    """A record of so many samples: the twin's, again and again."""
    r = twin.recording
    rows = np.arange(samples) % len(r)
    t = twin.machine.controller.sample_time * np.arange(samples)
    qg = r.qg[rows]
    assert r.ql is not None
    longer = dataclasses.replace(r, t=t, qg=qg, qm=r.qm[rows], ql=r.ql[rows], vir=r.vir[rows])
    return dataclasses.replace(twin, recording=longer)


def integration_error(twin: Twin) -> float:
    """norm(fast - record's method) / norm(record's method) of the filtered force with the true drive."""
    fast, slow = (
        np.asarray(t.predict(twin.truth, jnp.zeros(0)))
        for t in (twin.trial(twin.truth, FLEXIBLE_HZ, method=m) for m in (FAST, RECORD))
    )
    return float(np.linalg.norm(fast - slow) / np.linalg.norm(slow))
