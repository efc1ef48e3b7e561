"""What is read off a record without a plant: the controller's law, pulses behind it, a coarse encoder."""

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np

from ..machine import Machine
from ..recording import Recording
from .law import Pulse, encoder_grid, examine_law

CONTROLLER = ("position_gain", "velocity_gain", "velocity_filter")
PULSES, GRID = "disturbance_pulses", "encoder_quantisation"


@dataclasses.dataclass(frozen=True)
class Readings:
    """Effects that need no search.

    - `controller` parameters (`position_gain.e`) that explain vir against the documented law; `std` of each
    - `law_left` share of r_C that nothing explains, of the record where that is most
    - `pulses` in the control law's output, for each record; `grid` of the encoder (m), 0 where it is the documented one
    """

    controller: dict[str, float]
    std: dict[str, float]
    law_left: float
    pulses: tuple[tuple[Pulse, ...], ...]
    grid: float
    remarks: tuple[str, ...]

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that were read off, pulses first: they are the largest."""
        names = dict.fromkeys(name.split(".")[0] for name in self.controller)
        return (*((PULSES,) if any(self.pulses) else ()), *names, *((GRID,) if self.grid else ()))

    def quiet(self, recording: Recording, record: int) -> Recording:
        """The record with its pulses as a known signal, V."""
        if not self.pulses[record]:
            return recording
        volts = np.zeros(len(recording)) if recording.injected is None else np.array(recording.injected)
        t = recording.t - recording.t[0]
        for pulse in self.pulses[record]:
            inside = (t >= pulse.on - 0.5 * recording.dt) & (t < pulse.off - 0.5 * recording.dt)
            volts[inside] += pulse.volts * (1.0 if pulse.shape is None else pulse.shape)
        return dataclasses.replace(recording, injected=volts)


def read_off(recordings: Sequence[Recording], machine: Machine, exclude: Collection[str]) -> Readings:
    """Examine the control law of every record; the first one decides on the controller."""
    laws = [examine_law(r, machine, exclude=exclude) for r in recordings]
    law, remarks = laws[0], []
    pulses = tuple(x.pulses if x.significant and PULSES not in exclude else () for x in laws)
    for r, found in zip(recordings, pulses, strict=True):
        if found:
            volts = float(np.median([abs(p.volts) for p in found]))
            remarks.append(
                f"{r.label}: {len(found)} pulses of {volts:.4g} V ({volts * machine.drive.gain:.4g} N) in vir, behind "
                "the control law."
            )
    controller, std = {}, {}
    law_left = max((1 - x.best(exclude).share for x in laws if x.significant), default=0.0)
    if law.significant:
        best = law.best(exclude)
        named = [name for name in best.effects if name in CONTROLLER]
        controller = {k: v for k, v in best.parameters.items() if k.split(".")[0] in CONTROLLER}
        std = {k: v for k, v in best.std.items() if k in controller}
        if named or not any(pulses):
            explained = f"{' and '.join(named)} leaves {best.rms:.2g} V" if named else "no effect of the catalogue does"
            remarks.append(
                f"vir differs from the documented control law by {100 * law.relative:.3g} % of the commanded force; "
                f"explained: {explained}."
            )
    grid = encoder_grid(recordings[0], machine) if GRID not in exclude else None
    if grid is not None:
        remarks.append(f"qm lies on a grid of {grid:.4g} m; {machine.encoder.resolution:.4g} m is documented.")
    return Readings(controller, std, law_left, pulses, grid or 0.0, tuple(remarks))
