"""The closed loop: reference in, motion and motor force out. Sampled as on the rig, or continuous as in the paper."""

import abc
from collections.abc import Callable
from typing import Any

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jax.flatten_util import ravel_pytree

from ._types import Scalar, Traj
from .chain import Chain, Held, State
from .control import AbstractSampledController, ContinuousPD
from .effects import Block, acts_once_per_sample
from .plant import Axis
from .sliding import Sliding
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
        self, excitation: Excitation, states: State, held: Held, qm: Array, result: dfx.RESULTS
    ) -> Simulation:
        t, chain = excitation.t, self.chain
        q1, v1, q2, v2 = jax.vmap(chain.plant.sides)(states.plant)
        rates = jax.vmap(chain.derivative)(t, states, held)
        a1, a2 = jax.vmap(chain.plant.accelerations)(states.plant, rates.plant)
        force = jax.vmap(chain.force)(t, states, held)
        vir = held.command
        return Simulation(t, Axis(q1, v1, a1), Axis(q2, v2, a2), qm, vir, chain.drive.gain * vir, force, result)


class SampledLoop(AbstractLoop):
    """A sampled controller: measure, compute, hold the command for one sample, as on the rig.

    The motion between two samples is integrated in `substeps` equal steps: by a diffrax solver, or by `Sliding`, where
    friction can hold at rest.
    """

    controller: AbstractSampledController
    chain: Chain
    substeps: int = eqx.field(static=True, default=1)
    solver: dfx.AbstractSolver | Sliding = eqx.field(static=True, default=Unrolled(dfx.Tsit5()))

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
        for _ in range(2):  # what the law makes of the motion, then the command, once its effects have settled to that
            at = (jnp.zeros(()), excitation.qg[0], excitation.injected[0], dt)
            _, command, terms, _ = self._command(first, start.memory, *at)
            first = chain.init(start.plant, command, terms)
        still = tuple(acts_once_per_sample(effect) for effect in chain.effects)

        def moving(state: State) -> tuple[Array, tuple[Any, ...]]:
            return state.plant, tuple(() if s else x for s, x in zip(still, state.effects, strict=True))

        flat, as_moving = ravel_pytree(moving(first))
        size = flat.shape[0]
        h = dt / self.substeps

        def hold(t: Array, state: State, held: Held) -> State:
            """One sample of motion under what the drive holds; only what moves continuously is integrated."""
            solver = self.solver
            if isinstance(solver, Sliding):

                def substep(i: Array, state: State) -> State:
                    return solver.step(chain, t + i * h, h, state, held)

                # By twos: four written out take twice as long to compile, and are no faster.
                return jax.lax.fori_loop(0, self.substeps, substep, state, unroll=1)

            def as_state(y: Array) -> State:
                plant, effects = as_moving(y)
                whole = (x if s else e for s, x, e in zip(still, state.effects, effects, strict=True))
                return State(plant, tuple(whole))

            def field(ti: Any, y: tuple[Array, ...], args: None) -> tuple[Array, ...]:
                dy = ravel_pytree(moving(chain.derivative(ti, as_state(jnp.stack(y)), held)))[0]
                return tuple(dy[i] for i in range(size))

            term = dfx.ODETerm(field)
            start = ravel_pytree(moving(state))[0]
            y = tuple(start[i] for i in range(size))  # scalars: the compiler then sees through every stack
            for i in range(self.substeps):
                t0, t1 = t + i * h, t + (i + 1) * h
                memo = solver.init(term, t0, t1, y, None)
                y, _, _, _, _ = solver.step(term, t0, t1, y, None, memo, made_jump=True)
            return as_state(jnp.stack(y))

        def sample(carry: _Carry, now: tuple[Array, Array, Array]) -> tuple[_Carry, tuple[State, Held, Array]]:
            (state, memory), (t, qg, injected) = carry, now
            qm, vir, _, (memory, changes) = self._command(state, memory, t, qg, injected, dt)
            held, driven = chain.hold(t, state, vir, dt)
            changes |= driven
            state = State(state.plant, tuple(changes.get(i, x) for i, x in enumerate(state.effects)))
            return (hold(t, state, held), memory), (state, held, qm)

        inputs = (excitation.t, excitation.qg, excitation.injected)
        _, (states, held, qm) = jax.lax.scan(sample, (first, start.memory), inputs)
        done = dfx.RESULTS.successful  # an explicit fixed step always ends: the numbers tell whether it went well
        return self._describe(excitation, states, held, qm, done)  # type: ignore[arg-type]

    def _command(
        self, state: State, memory: Array, t: Array, qg: Array, injected: Array, dt: Scalar
    ) -> tuple[Array, Array, tuple[Array, Array], tuple[Array, dict[int, Any]]]:
        """(qm in m, vir in V, the law's terms in V, (next memory, next states)) of one sample."""
        signals = self.chain.signals(state.plant, 0.0)
        signals = eqx.tree_at(lambda s: (s.held_since, s.dt), signals, (t, dt))
        qm, sensed = self.chain.along(Block.SENSOR, t, state.effects, signals, signals.q1)
        law, following = self.controller(memory, qg, qm, dt)
        terms = self.controller.terms(memory, qg, qm, dt)
        signals = eqx.tree_at(lambda s: (s.law_position, s.law_velocity), signals, terms)
        vir, commanded = self.chain.along(Block.CONTROLLER, t, state.effects, signals, law)
        return qm, vir + injected, terms, (following, sensed | commanded)


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
            if acts_once_per_sample(effect) and jax.tree.leaves(x):
                raise ValueError(f"{type(effect).__name__} keeps a state between samples: it needs a SampledLoop.")

        def command(ti: Array, state: State, qg: Array, injected: Array) -> tuple[Array, Array]:
            signals = chain.signals(state.plant, 0.0)
            qm, _ = chain.along(Block.SENSOR, ti, state.effects, signals, signals.q1)
            law = self.controller(qg, qm, signals.v1)
            terms = self.controller.terms(qg, qm, signals.v1)
            signals = eqx.tree_at(lambda s: (s.law_position, s.law_velocity), signals, terms)
            vir, _ = chain.along(Block.CONTROLLER, ti, state.effects, signals, law)
            return qm, vir + injected

        def field(ti: Array, state: State, args: None) -> State:
            qg, injected = reference.evaluate(ti)
            return chain.derivative(ti, state, held(ti, state, command(ti, state, qg, injected)[1]))

        def held(ti: Array, state: State, vir: Array) -> Held:
            """As if held for one sample about this instant, so that what sets in at a time does so on time."""
            now = chain.hold(ti, state, vir, excitation.dt)[0]
            return eqx.tree_at(lambda h: h.since, now, ti - 0.5 * excitation.dt)

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
        return self._describe(excitation, states, jax.vmap(held)(t, states, vir), qm, solution.result)


@eqx.filter_jit
def simulate(loop: AbstractLoop, excitation: Excitation, start: Start) -> Simulation:
    """Run a loop, compiled once per shape: gains, parameters and smoothing are traced, so a sweep never recompiles.

    Inside a larger jitted function it is traced once per shape too, however often that function asks for it.
    """
    return loop.run(excitation, start)
