"""The main job: identify the EMPS from its real record where that is present, else from its synthetic twin.

python -m experiments.first_run --out runs/first
"""

import tempfile
from pathlib import Path

import tyro

from didim_jax.cli import identify, program, simulate

from .data import EMPS_MACHINE, TWIN, emps_folder


def main(out: Path = Path("runs/first")) -> None:
    """Identify, check on another trajectory, and write figures and report.

    Args:
        out: Run folder.
    """
    emps = emps_folder()
    if emps is not None:
        print(
            f"Real record: {emps / 'DATA_EMPS.mat'}, checked on DATA_EMPS_PULSES.mat (rigid drive, asymmetric friction)"
        )
        identify(
            (emps / "DATA_EMPS.mat",),
            machine=EMPS_MACHINE,
            friction="asymmetric",
            method="gauss-newton",
            check=emps / "DATA_EMPS_PULSES.mat",
            out=out,
        )
        return
    print(
        "No real record here (set DIDIM_DATA to a folder that holds emps/): the paper's SYNTHETIC twin, flexible drive"
    )
    with tempfile.TemporaryDirectory() as folder:
        fit, check = Path(folder) / "twin.mat", Path(folder) / "twin_check.mat"
        machine, plant = TWIN / "machine.toml", TWIN / "plant.toml"
        simulate(machine, plant, TWIN / "reference.toml", fit, noise=3.0, seed=1)
        simulate(machine, plant, TWIN / "reference_check.toml", check, noise=3.0, seed=2)
        identify((fit,), machine=machine, method="gauss-newton", check=check, out=out)


if __name__ == "__main__":
    with program():
        tyro.cli(main)
