"""Convergence maps on the synthetic twin: python -m experiments.robustness [--quick] [--set key=value ...] --out DIR

From which starts does each step of the procedure end at the machine, and what may be wrong besides? A run that was
stopped goes on where it was: give it the same --out.
"""

from pathlib import Path

from ..study import main
from .config import Config


def run(config: Config, out: Path) -> None:
    """Imported here: the modules behind it start JAX, whose devices are settled by then."""
    from .maps import study

    study(config, out)


if __name__ == "__main__":
    main("robustness", Config, run)
