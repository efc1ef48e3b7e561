"""What is known of a machine before looking at its data: `machine.toml`. SI units, load axis."""

import dataclasses
import json
import os
from typing import Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from didim_jax.config import CONFIG, load_toml
from didim_jax.files import atomic_write


@dataclass(frozen=True, config=CONFIG)
class Controller:
    """The sampled position law, held between samples (qg, qm in m, vir in V)::

    vir[k] = kv * (kp * (qg[k] - qm[k]) - dq[k]),   dq[k] = (qm[k] - qm[k-2]) / (2 * sample_time)
    """

    law: Literal["pd"]
    kp: float = Field(gt=0, description="1/s")
    kv: float = Field(gt=0, description="V s/m")
    sample_time: float = Field(gt=0, description="s")
    velocity: Literal["two-sample"] = Field(description="dq[k] = (qm[k] - qm[k-2]) / (2 * sample_time)")


@dataclass(frozen=True, config=CONFIG)
class Drive:
    """Amplifier and motor: force = gain * clip(vir, -limit, limit), gain in N/V referred to the load, limit in V."""

    gain: float = Field(gt=0, description="N/V")
    limit: float = Field(gt=0, description="V")


@dataclass(frozen=True, config=CONFIG)
class Encoder:
    """The position sensor on the motor: one count is `resolution` metres of load travel."""

    resolution: float = Field(gt=0, description="m per count")


@dataclass(frozen=True, config=CONFIG)
class Machine:
    """A drive as documented: name, nominal plant, rough total mass (kg), screw lead (m per turn), and its parts.

    Built from a file by `Machine.load`, which turns every mistake into an InputError line; called directly, the
    class raises pydantic's ValidationError (a ValueError) on the same values.
    """

    name: str
    model: Literal["rigid", "flexible"] = Field(description='the nominal plant: "rigid" or "flexible"')
    mass_apriori: float = Field(gt=0, description="kg, total, rough")
    screw_lead: float = Field(gt=0, description="m per motor turn")
    controller: Controller = Field(description="vir = kv * (kp * (qg - qm) - dq), held between samples")
    drive: Drive = Field()  # required all the same: a field after described ones has to look alike
    encoder: Encoder = Field()

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Machine":
        """Read `machine.toml`. Raises InputError, one line with file and key, when it cannot be used."""
        return load_toml(path, cls)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the machine as TOML, the unit beside each value; `Machine.load` gives the same machine back.

        Raises InputError when the folder is missing or cannot be written to.
        """
        lines = ["# What is known of the machine before looking at its data. SI units, load axis.", *_lines(self)]
        with atomic_write(path) as temporary:
            temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _lines(table: object) -> list[str]:
    """The plain keys of a table with their units, then its sub-tables."""
    values = {f.name: getattr(table, f.name) for f in dataclasses.fields(table)}  # type: ignore[arg-type]
    notes = {name: info.description for name, info in type(table).__pydantic_fields__.items()}  # type: ignore[attr-defined]
    plain = [_line(f"{name} = {_toml(v)}", notes[name]) for name, v in values.items() if isinstance(v, str | float)]
    for name, value in values.items():
        if dataclasses.is_dataclass(value):
            plain += [_line(f"[{name}]", notes[name]), *_lines(value)]
    return plain


def _line(text: str, note: str | None) -> str:
    return f"{text:<33} # {note}" if note else text


def _toml(value: str | float) -> str:
    # A JSON string is a TOML basic string; repr gives the shortest text that reads back as the same number.
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
