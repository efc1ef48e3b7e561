"""DIDIM's columns against the exact ones on the synthetic twin: angles, paths, noise draws, cost, friction.

python -m experiments.jacobians [--config configs/jacobians.toml] [--set key=value ...] [--quick] --out DIR
"""

from pathlib import Path

import numpy as np

from didim_jax.files import atomic_write

from .. import study
from .config import Config


def run(config: Config, out: Path) -> None:
    """metrics.json, arrays.npz, figures and report.html."""
    from .report import answer, write  # after the devices are settled
    from .results import compute

    results = compute(config)
    with atomic_write(out / "arrays.npz") as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **results.arrays)  # type: ignore[arg-type]
    study.write_json(out / "metrics.json", results.numbers)
    with np.load(out / "arrays.npz") as stored:
        arrays = dict(stored)
    write(out, config, arrays, results.numbers)
    print("\n".join(answer(results.numbers, config)))
    print(f"{results.numbers['seconds']['all']:.0f} s; {out / 'report.html'}")


def main(argv: list[str] | None = None) -> None:
    """Run the study from the command line."""
    study.main("jacobians", Config, run, argv)


if __name__ == "__main__":
    main()
