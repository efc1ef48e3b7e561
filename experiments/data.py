"""Where the measured records are, if they are anywhere: the project commits none."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

TWIN = ROOT / "configs" / "twin"
"""The synthetic twin of the paper's machine: machine, plants, references."""


EMPS_RECORDS = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")

EMPS_MACHINE = ROOT / "configs" / "emps" / "machine.toml"
"""What is documented of the EMPS; the public data set has no such file."""


def emps_folder() -> Path | None:
    """Folder of the real EMPS records: `$DIDIM_DATA/emps`, else `../shared/data/emps`; None where they are not."""
    data = Path(os.environ["DIDIM_DATA"]) if "DIDIM_DATA" in os.environ else ROOT.parent / "shared" / "data"
    folder = data / "emps"
    return folder if all((folder / name).is_file() for name in EMPS_RECORDS) else None


def gap_folder() -> Path | None:
    """Folder of the open diagnosis cases, their answers and their judge: `gap` beside the measured data."""
    data = Path(os.environ["DIDIM_DATA"]) if "DIDIM_DATA" in os.environ else ROOT.parent / "shared" / "data"
    for folder in (data.parent / "gap", data.parent / "shared" / "gap"):
        if (folder / "dev").is_dir() and (folder / "dev_answers.json").is_file():
            return folder
    return None
