"""All maps in their order, then ranges, figures and the page."""

import dataclasses
import time
from pathlib import Path

import numpy as np
import xarray as xr

from didim_jax.plant import RigidDrive

from ..study import write_json
from . import conditions, cost, global_start, mode_start, no_start, rigid_start
from .config import Config
from .cost import Cost
from .job import NELDER_MEAD
from .no_start import Drawn
from .twin import Twin, make


@dataclasses.dataclass(frozen=True)
class OneLaw:
    """The maps of the three steps under one control law, by method, and where their criteria are least."""

    rigid: RigidDrive
    step1: dict[str, xr.Dataset]
    step2: dict[str, xr.Dataset]
    step3: dict[str, xr.Dataset]
    minimum: dict[str, float]
    true_mode: tuple[float, float]
    integration_error: float


@dataclasses.dataclass(frozen=True)
class Results:
    """Everything that the page tells."""

    config: Config
    twin: Twin
    laws: dict[str, OneLaw]
    conditions: dict[str, dict[str, xr.Dataset]]
    labels: dict[str, str]
    shorter: dict[str, float]
    drawn: list[Drawn]
    cost: Cost
    seconds: dict[str, float]


def study(config: Config, out: Path) -> None:
    """Run everything and write `maps/`, `ranges.json`, `figures/` and `report.html`."""
    from .report import ranges, write_report

    seconds: dict[str, float] = {}
    begin = time.perf_counter()

    def lap(name: str) -> None:
        seconds[name] = time.perf_counter() - begin - sum(seconds.values())

    laws: dict[str, OneLaw] = {}
    first: Twin | None = None
    for law in config.laws:
        full = make(law, config.noise_N, config.seed)
        first = first or full
        laws[law] = _one_law(config, full, out)
        lap(f"three steps, {law} law")
    assert first is not None
    rig = first if first.law == "sampled" else make("sampled", config.noise_N, config.seed)
    rigid = rigid_start.totals(rig)
    wrong = conditions.maps(config, rig, rigid, out)
    labels = {c.name: c.label for c in conditions.conditions(config, rig)}
    lap("mistakes")
    shorter = _shorter_record(config, rig, out)
    lap("full record beside its beginning")
    drawn = no_start.identify_all(config, rig)
    no_start.write(drawn, out)
    lap("machines without a start")
    spent = cost.measure(config, rig, rigid)
    lap("cost")
    results = Results(config, rig, laws, wrong, labels, shorter, drawn, spent, seconds)
    write_json(out / "ranges.json", ranges(results))
    write_report(results, out)


def _one_law(config: Config, full: Twin, out: Path) -> OneLaw:
    twin = full.first(config.map_seconds)
    rigid = rigid_start.totals(twin)
    return OneLaw(
        rigid=rigid,
        step1=rigid_start.maps(config, twin, rigid, out),
        step2=mode_start.maps(config, twin, rigid, out),
        step3=global_start.maps(config, full, rigid_start.totals(full), out),
        minimum=mode_start.target(twin, rigid),
        true_mode=mode_start.true_mode(twin),
        integration_error=cost.integration_error(twin),
    )


def _shorter_record(config: Config, full: Twin, out: Path) -> dict[str, float]:
    """Do the first seconds of the record give the same map of step 2 as all of it? Nelder-Mead from some of its starts.

    `agree_percent`: starts that end the same way (the truth, elsewhere, not at all) on both.
    """
    if not config.check_starts:
        return {}
    starts = mode_start.grid(config, full.law)
    chosen = np.random.default_rng(config.seed).permutation(len(starts))[: config.check_starts]
    outcomes = []
    for twin, suffix in ((full.first(config.map_seconds), "_beginning"), (full, "_full")):
        rigid = rigid_start.totals(twin)
        wanted = mode_start.target(twin, rigid)
        lanes = mode_start.one(config, twin, rigid, NELDER_MEAD, starts[chosen], wanted, out, suffix)
        outcomes.append(lanes["outcome"].values)
    return {
        "starts": len(chosen),
        "agree_percent": 100 * float(np.mean(outcomes[0] == outcomes[1])),
        "truth_on_beginning": int(np.sum(outcomes[0] == 1)),
        "truth_on_full_record": int(np.sum(outcomes[1] == 1)),
        **{f"minimum_on_full_record_{k}": v for k, v in wanted.items()},
    }
