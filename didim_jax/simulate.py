"""The closed loop: reference in, motion and motor force out. Sampled as on the rig, or continuous as in the paper."""

import abc
from collections.abc import Callable

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jax.flatten_util import ravel_pytree

from ._types import Scalar, Traj
from .chain import Chain, State
from .control import AbstractSampledController, ContinuousPD
from .effects import SAMPLED, Block
from .plant import Axis
from .solver import Unrolled

type _Carry = tuple[State, Array]
"""State of the chain and memory of the controller, from sample to sample."""


class Excitation(eqx.Module):
    """What drives one run: sample time (s), reference position (m), known volts added to the control law's output."""

    dt: Scalar
    qg: Traj
    injected: Traj

    @property
    def t(self) -> Traj:
        return self.dt * jnp.arange(self.qg.shape[0])


class Start(eqx.Module):
    """State of a loop at a record's first sample: the plant's, and the controller's memory (vectors)."""

    plant: Array
    memory: Array


class Simulation(eqx.Module):
    """One simulated run, (n,) per channel. The command `vir` (V) is before the clip, as a record holds it.

    `tau` = gain * vir is the commanded motor force (N), `force` the one the plant felt.
    Accelerations are those just after each sample, while the drive holds that sample's command.
    """

    t: Traj
    motor: Axis
    load: Axis
    qm: Traj
    vir: Traj
    tau: Traj
    force: Traj
    result: dfx.RESULTS

    @property
    def ok(self) -> Array:
        """Whether the solver succeeded and every number is finite: a diverged fixed-step solve reports success."""
        ends = (self.tau, self.motor.a, self.load.a)
        return (self.result == dfx.RESULTS.successful) & jnp.isfinite(jnp.stack(ends)).all()


def _on_vectors(derivative: Callable[..., State], as_state: Callable[[Array], State]) -> dfx.ODETerm:
    """The same field on a flat vector: solvers handle one array faster than a tree, and no empty branches at all."""
    return dfx.ODETerm(lambda t, y, args: ravel_pytree(derivative(t, as_state(y), args))[0])


class AbstractLoop(eqx.Module):
    """A controller around a chain of blocks."""

    chain: eqx.AbstractVar[Chain]

    @property
    @abc.abstractmethod
    def memory_names(self) -> tuple[str, ...]:
        """What the controller remembers from sample to sample."""

    @property
    @abc.abstractmethod
    def memory_scales(self) -> tuple[float, ...]:
        """Typical size of each entry of that memory."""

    @abc.abstractmethod
    def start(self, q: Scalar, v: Scalar, dt: Scalar) -> Start:
        """Start with every part of the drive at q (m), moving at v (m/s)."""

    @abc.abstractmethod
    def run(self, excitation: Excitation, start: Start) -> Simulation:
        """Simulate; use `simulate` to have it compiled once per shape."""

    def _describe(
        self, excitation: Excitation, states: State, qm: Array, vir: Array, result: dfx.RESULTS
    ) -> Simulation:
        t, chain = excitation.t, self.chain
        q1, v1, q2, v2 = jax.vmap(chain.plant.sides)(states.plant)
        rates = jax.vmap(chain.derivative)(t, states, vir)
        a1, a2 = jax.vmap(chain.plant.accelerations)(states.plant, rates.plant)
        force = jax.vmap(chain.force)(t, states, vir)
        return Simulation(t, Axis(q1, v1, a1), Axis(q2, v2, a2), qm, vir, chain.drive.gain * vir, force, result)


class SampledLoop(AbstractLoop):
    """A sampled controller: measure, compute, hold the command for one sample, as on the rig.

    The motion between two samples is integrated by a diffrax solver in `substeps` equal steps.
    """

    controller: AbstractSampledController
    chain: Chain
    substeps: int = eqx.field(static=True, default=1)
    solver: dfx.AbstractSolver = eqx.field(static=True, default=Unrolled(dfx.Tsit5()))

    @property
    def memory_names(self) -> tuple[str, ...]:
        return self.controller.memory_names

    @property
    def memory_scales(self) -> tuple[float, ...]:
        return self.controller.memory_scales

    def start(self, q: Scalar, v: Scalar, dt: Scalar) -> Start:
        y = self.chain.plant.start(q, v)
        signals = self.chain.signals(y, 0.0)
        seen, _ = self.chain.along(Block.SENSOR, jnp.zeros(()), self.chain.init(y).effects, signals, signals.q1)
        return Start(y, self.controller.recall(seen, v, dt))  # what the sensor would have shown, so that rest is rest

    def run(self, excitation: Excitation, start: Start) -> Simulation:
        chain, dt = self.chain, excitation.dt
        first = chain.init(start.plant)
        _, as_state = ravel_pytree(first)
        term = _on_vectors(chain.derivative, as_state)
        h = dt / self.substeps

        def hold(t: Array, state: State, vir: Array) -> State:
            """One sample of motion under a held command."""
            y = ravel_pytree(state)[0]
            for i in range(self.substeps):
                t0, t1 = t + i * h, t + (i + 1) * h
                memo = self.solver.init(term, t0, t1, y, vir)
                y, _, _, _, _ = self.solver.step(term, t0, t1, y, vir, memo, made_jump=True)
            return as_state(y)

        def sample(carry: _Carry, now: tuple[Array, Array, Array]) -> tuple[_Carry, tuple[State, Array, Array]]:
            (state, memory), (t, qg, injected) = carry, now
            signals = chain.signals(state.plant, 0.0)
            qm, sensed = chain.along(Block.SENSOR, t, state.effects, signals, signals.q1)
            law, memory = self.controller(memory, qg, qm, dt)
            vir, commanded = chain.along(Block.CONTROLLER, t, state.effects, signals, law)
            vir = vir + injected
            changes = sensed | commanded
            state = State(state.plant, tuple(changes.get(i, x) for i, x in enumerate(state.effects)))
            return (hold(t, state, vir), memory), (state, qm, vir)

        inputs = (excitation.t, excitation.qg, excitation.injected)
        _, (states, qm, vir) = jax.lax.scan(sample, (first, start.memory), inputs)
        done = dfx.RESULTS.successful  # an explicit fixed step always ends: the numbers tell whether it went well
        return self._describe(excitation, states, qm, vir, done)  # type: ignore[arg-type]


class ContinuousLoop(AbstractLoop):
    """A control law that acts at every instant, as in the paper: one diffrax ODE from the first sample to the last.

    Reference and injected volts are linear between samples. Effects of the sensor and the controller may have no
    state of their own here: theirs moves once per sample.
    """

    controller: ContinuousPD
    chain: Chain
    substeps: int = eqx.field(static=True, default=1)
    solver: dfx.AbstractSolver = eqx.field(static=True, default=dfx.Tsit5())

    @property
    def memory_names(self) -> tuple[str, ...]:
        return ()

    @property
    def memory_scales(self) -> tuple[float, ...]:
        return ()

    def start(self, q: Scalar, v: Scalar, dt: Scalar) -> Start:
        return Start(self.chain.plant.start(q, v), jnp.zeros(0))

    def run(self, excitation: Excitation, start: Start) -> Simulation:
        chain, t = self.chain, excitation.t
        reference = dfx.LinearInterpolation(t, jnp.stack([excitation.qg, excitation.injected], axis=1))
        first = chain.init(start.plant)
        y0, as_state = ravel_pytree(first)
        for effect, x in zip(chain.effects, first.effects, strict=True):
            if effect.block in SAMPLED and jax.tree.leaves(x):
                raise ValueError(f"{type(effect).__name__} keeps a state between samples: it needs a SampledLoop.")

        def command(ti: Array, state: State, qg: Array, injected: Array) -> tuple[Array, Array]:
            signals = chain.signals(state.plant, 0.0)
            qm, _ = chain.along(Block.SENSOR, ti, state.effects, signals, signals.q1)
            law = self.controller(qg, qm, signals.v1)
            vir, _ = chain.along(Block.CONTROLLER, ti, state.effects, signals, law)
            return qm, vir + injected

        def field(ti: Array, state: State, args: None) -> State:
            qg, injected = reference.evaluate(ti)
            return chain.derivative(ti, state, command(ti, state, qg, injected)[1])

        n = excitation.qg.shape[0]
        solution = dfx.diffeqsolve(
            _on_vectors(field, as_state),
            self.solver,
            t[0],
            t[-1],
            excitation.dt / self.substeps,
            y0,
            saveat=dfx.SaveAt(ts=t),
            adjoint=dfx.ForwardMode(),
            max_steps=n * self.substeps + 8,  # rounding may add a last, tiny step
            throw=False,
        )
        assert solution.ys is not None
        states = jax.vmap(as_state)(solution.ys)
        qm, vir = jax.vmap(command)(t, states, excitation.qg, excitation.injected)
        return self._describe(excitation, states, qm, vir, solution.result)


@eqx.filter_jit
def simulate(loop: AbstractLoop, excitation: Excitation, start: Start) -> Simulation:
    """Run a loop, compiled once per shape: gains, parameters and smoothing are traced, so a sweep never recompiles.

    Inside a larger jitted function it is traced once per shape too, however often that function asks for it.
    """
    return loop.run(excitation, start)
