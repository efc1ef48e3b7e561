"""Seconds for one closed loop of 25,000 samples, and for its Jacobian: ours beside diffrax's own stages and SciPy.

    python -m benchmarks.closed_loop

Each is warmed up first; compilation is reported apart. Run on an idle machine.
"""

import time
from collections.abc import Callable

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.integrate
from rich.console import Console
from rich.table import Table

from didim_jax import Excitation, Machine, SampledLoop, simulate, unpack
from didim_jax.cli import program
from didim_jax.params import pack
from didim_jax.plant_file import load_plant
from didim_jax.reference import load_reference
from didim_jax.rig import continuous_loop, sampled_loop
from didim_jax.simulate import AbstractLoop
from experiments.data import TWIN

SAMPLES = 25_000


def timed(call: Callable[[], object], repeats: int) -> tuple[float, float]:
    """(first call, least of the later ones), s: the first compiles."""
    seconds = []
    for _ in range(repeats + 1):
        begin = time.perf_counter()
        jax.block_until_ready(call())
        seconds.append(time.perf_counter() - begin)
    return seconds[0], min(seconds[1:])


def scipy_loop(machine: Machine, plant: eqx.Module, qg: np.ndarray) -> np.ndarray:
    """The paper's continuous law by scipy.integrate.solve_ivp, as a script would do it."""
    p, law, dt = plant, machine.controller, machine.controller.sample_time
    M1, M2, K12 = (float(getattr(p, n)) for n in ("M1", "M2", "K12"))
    (Fv1, Fc1), (Fv2, Fc2) = (
        (float(f.Fv), float(f.Fc))
        for f in (p.motor_friction, p.load_friction)  # type: ignore[attr-defined]
    )
    t = dt * np.arange(len(qg))

    def field(ti: float, y: np.ndarray) -> list[float]:
        q1, v1, q2, v2 = y
        vir = law.kv * (law.kp * (np.interp(ti, t, qg) - q1) - v1)
        F12 = K12 * (q2 - q1)
        a1 = (machine.drive.gain * vir - Fv1 * v1 - Fc1 * np.tanh(v1 / 1e-3) + F12) / M1
        return [v1, a1, v2, (-Fv2 * v2 - Fc2 * np.tanh(v2 / 1e-3) - F12) / M2]

    return scipy.integrate.solve_ivp(
        field, (0, t[-1]), [qg[0], 0, qg[0], 0], t_eval=t, max_step=dt, rtol=1e-6, atol=1e-9
    ).y


def main() -> None:
    """Time every variant and print the table."""
    machine, plant = Machine.load(TWIN / "machine.toml"), load_plant(TWIN / "plant.toml")
    dt = machine.controller.sample_time
    qg = np.resize(load_reference(TWIN / "reference.toml").sample(dt), SAMPLES)
    excitation = Excitation(jnp.asarray(dt), jnp.asarray(qg), jnp.zeros(SAMPLES))
    ours = sampled_loop(machine, plant)
    staged = SampledLoop(controller=ours.controller, chain=ours.chain, solver=dfx.Tsit5(scan_kind="lax"))
    loops: dict[str, AbstractLoop] = {
        "sampled, Tsit5 with its stages written out": ours,
        "sampled, Tsit5 with diffrax's own stage loop": staged,
        "continuous, one diffeqsolve (Tsit5)": continuous_loop(machine, plant),
    }
    table = Table("closed loop of 25,000 samples, flexible drive", "compile, s", "run, ms", "Jacobian (8), ms")
    for name, loop in loops.items():
        start = loop.start(qg[0], 0.0, dt)

        def tau(theta: jax.Array, loop: AbstractLoop = loop, start: object = start) -> jax.Array:
            changed = eqx.tree_at(lambda a: a.chain.plant, loop, unpack(plant, theta))
            return changed.run(excitation, start).tau

        compiled, run = timed(lambda loop=loop, start=start: simulate(loop, excitation, start).tau, 5)  # type: ignore[misc]
        jacobian = jax.jit(jax.jacfwd(tau))
        _, slope = timed(lambda jacobian=jacobian: jacobian(pack(plant)), 3)  # type: ignore[misc]
        table.add_row(name, f"{compiled:.2f}", f"{1e3 * run:.1f}", f"{1e3 * slope:.1f}")
    _, run = timed(lambda: scipy_loop(machine, plant, qg), 1)
    table.add_row("continuous, scipy.integrate.solve_ivp (RK45)", "-", f"{1e3 * run:.0f}", "-")
    Console().print(table)


if __name__ == "__main__":
    with program():
        main()
