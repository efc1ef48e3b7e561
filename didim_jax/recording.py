"""One run of the drive, as measured or simulated."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from didim_jax.errors import InputError


@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """One run of the drive; SI units, load axis. All channels kept: DIDIM needs the reference.

    Channels are float64 vectors of equal length, made read-only:

    - `t` time, s; `qg` reference position, m; `qm` measured motor position, m; `ql` measured load position, m, or None
    - `vir` control signal, V, before the drive's limit, held until the next sample
    - `injected` a known signal added to the output of the control law (`pulses_N` in the EMPS files), or None: in the
      unit of the file, which is not to be believed (`hygiene.injected_scale` finds it); `vir` already contains it

    `gain` is the drive gain, N/V. `documented` holds the controller gains written in the file, if any: `kp` (1/s),
    `kv` (V s/m). `synthetic` says that the record was simulated.

    Raises InputError: channels empty, of different length or not finite, gain not a positive number.
    """

    t: np.ndarray
    qg: np.ndarray
    qm: np.ndarray
    vir: np.ndarray
    gain: float
    ql: np.ndarray | None = None
    injected: np.ndarray | None = None
    name: str = ""
    source: str = ""
    synthetic: bool = False
    documented: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, values in self.channels.items():
            values = np.array(values, dtype=np.float64)  # a copy: the caller's array stays the caller's
            if values.ndim != 1:
                raise InputError(f"{self.label}: channel {name} has the shape {values.shape}, a vector is expected.")
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                raise InputError(
                    f"{self.label}: channel {name} is {values[bad[0]]} at row {bad[0] + 1} "
                    f"({bad.size} such values); cut or repair the record."
                )
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        lengths = {name: len(values) for name, values in self.channels.items()}
        if len(set(lengths.values())) != 1:
            listed = ", ".join(f"{name} {n}" for name, n in lengths.items())
            raise InputError(f"{self.label}: channels differ in length: {listed}.")
        if len(self) < 2:
            raise InputError(f"{self.label}: {len(self)} samples; a record needs at least two to have a sample time.")
        if not (np.isfinite(self.gain) and self.gain > 0):
            raise InputError(f"{self.label}: drive gain gtau = {self.gain} N/V must be a positive number.")
        object.__setattr__(self, "gain", float(self.gain))
        object.__setattr__(self, "documented", dict(self.documented))

    @property
    def channels(self) -> dict[str, np.ndarray]:
        """The channels present, by name."""
        every = {name: getattr(self, name) for name in ("t", "qg", "qm", "ql", "vir", "injected")}
        return {name: values for name, values in every.items() if values is not None}

    @property
    def label(self) -> str:
        """What to call the record in a message: its file, else its name."""
        return self.source or self.name or "recording"

    @property
    def dt(self) -> float:
        """Mean sample time, s."""
        return float((self.t[-1] - self.t[0]) / (len(self) - 1))

    @property
    def tau(self) -> np.ndarray:
        """Commanded motor force gain * vir, N."""
        return self.gain * self.vir

    def __len__(self) -> int:
        return len(self.t)
