"""Compare every number of the paper with ours on its synthetic twin: tables.json, figures and report.html."""

import time
from pathlib import Path

import jax

from ..study import main, write_json
from .beyond import as_printed, cross_validation, other_starts, payload_draws
from .config import PaperConfig
from .methods import run_methods
from .published import BARE
from .report import Found, write
from .rows import table_rows
from .twin import twins


def run(config: PaperConfig, out: Path) -> None:
    """Simulate the records, identify them by every method, and write what was found."""
    if config.compile_afresh:
        jax.config.update("jax_enable_compilation_cache", False)
    begin = time.perf_counter()
    sets = twins(config)
    fits = {}
    for name, twin in sets.items():
        fits[name] = run_methods(twin, config)
        print(f"{name}: every method, {time.perf_counter() - begin:.0f} s", flush=True)
    check = cross_validation(sets[BARE], config, fits[BARE])
    literal = as_printed(sets[BARE], config, fits[BARE])
    restarts = other_starts(sets[BARE], config, fits[BARE])
    draws = payload_draws(sets, config, fits)
    rows = table_rows(sets, fits, draws, {method: 100 * found.force_error for method, found in check.items()})
    write_json(out / "tables.json", rows)
    write(Found(config, sets, fits, draws, check, literal, restarts, rows, time.perf_counter() - begin), out)
    print(f"{out / 'report.html'}: {len(rows)} numbers, {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main("paper", PaperConfig, run)
