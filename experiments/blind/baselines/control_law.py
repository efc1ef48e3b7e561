"""The recorded volts against the documented control law, by least squares on the law's own terms.

One term at a time: the position term (position_gain), the whole law (velocity_gain), what a filter of the velocity
takes away (velocity_filter), a train of pulses (disturbance_pulses).
"""

import numpy as np
import scipy.signal

from didim_jax.effects.environment import pulses_in
from didim_jax.hygiene import injected_scale, law_terms
from didim_jax.machine import Machine
from didim_jax.recording import Recording

WORTH = 2e-2
"""Least rms of the difference against that of the volts. On the open cases it is below 0.1 % where the law is kept."""


def left_by_law(recording: Recording, machine: Machine) -> dict[str, float]:
    """Effect to the share of the difference's energy that it leaves; empty where the law is kept."""
    position, velocity = law_terms(recording, machine)
    law, volts = position + velocity, recording.vir[2:]
    r = volts - law
    if recording.injected is not None:
        r = r - injected_scale(recording, machine) * recording.injected[2:]
    if np.sqrt(np.mean(r**2)) < WORTH * np.sqrt(np.mean(volts**2)):
        return {}
    dt = machine.controller.sample_time
    columns = [("position_gain", position), ("velocity_gain", law)]
    for T in (3e-4, 1e-3, 2.5e-3):
        keep = np.exp(-dt / T)
        filtered = scipy.signal.lfilter([1 - keep], [1, -keep], velocity, zi=keep * velocity[:1])[0]
        columns.append(("velocity_filter", filtered - velocity))
    t = dt * np.arange(len(r))
    for train in pulses_in(r, dt):
        columns.append(("disturbance_pulses", train.course(t)))
    left: dict[str, float] = {}
    for name, column in columns:
        share = 1 - float((column @ r) ** 2 / max((column @ column) * (r @ r), 1e-300))
        left[name] = min(share, left.get(name, 1.0))
    return left
