"""The chain of blocks from the drive's command to the motion: drive, plant, and whatever effects sit between them."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from ._types import Scalar
from .control import Drive
from .effects import SAMPLED, AbstractEffect, Block, Forces, Signals, acts_once_per_sample
from .plant import AbstractPlant, smooth_sign, without_coulomb

type _Changes = dict[int, Any]
"""What changes of each effect's state, by its place in the chain."""


class State(eqx.Module):
    """State of the plant (a vector) and of every effect (a tree each, by its place in the chain)."""

    plant: Array
    effects: tuple[Any, ...]


class Held(eqx.Module):
    """What the drive holds until the next sample: its command (V), its force (N), since when and how long (s)."""

    command: Array
    force: Array
    since: Scalar
    dt: Scalar


class Grip(eqx.Module):
    """What Coulomb friction can hold on each side: force (N), the mass it acts on (kg), and its sign's speed (m/s).

    `slide` (m/s) is added to the velocities at which it acts. A side that does not rub has no force.
    """

    force: tuple[Array, Array]
    mass: tuple[Array, Array]
    v_eps: tuple[Array, Array]
    slide: Scalar


class Chain(eqx.Module):
    """Drive and plant, with effects attached to their blocks; within a block they act in the order given."""

    drive: Drive
    plant: AbstractPlant
    effects: tuple[AbstractEffect, ...] = ()

    def signals(self, y: Array, command: Scalar) -> Signals:
        """What effects see while the plant is at y and the drive holds `command` (V)."""
        q1, v1, q2, v2 = self.plant.sides(y)
        nothing = jnp.zeros_like(q1)
        deflection, stiffness = self.plant.elastic(y)
        own: dict[str, Any] = {}
        for side, friction, v in zip("12", self.plant.frictions(), (v1, v2), strict=True):
            if friction is not None:
                own[f"viscous{side}"], own[f"coulomb{side}"] = friction.split(v)
                own[f"level{side}"] = friction.level(v)
                own[f"s{side}"] = smooth_sign(v, friction.v_eps)
        return Signals(
            q1,
            v1,
            q2,
            v2,
            self.plant.coupling_force(y),
            nothing + command,
            nothing,
            deflection=deflection,
            stiffness=stiffness,
            gain=jnp.asarray(self.drive.gain),
            **own,
        )

    def init(self, y: Array, command: Scalar = 0.0, terms: tuple[Scalar, Scalar] = (0.0, 0.0)) -> State:
        """State at a first sample, every effect at the state that suits the motion and the volts there.

        These are the command and the law's terms of position and of velocity, V.
        """
        signals = self.signals(y, command)
        signals = eqx.tree_at(
            lambda s: (s.force, s.law_position, s.law_velocity), signals, (self.drive(signals.command), *terms)
        )
        return State(y, tuple(effect.init(signals) for effect in self.effects))

    def along(
        self, block: Block, t: Array, states: tuple[Any, ...], signals: Signals, incoming: Scalar
    ) -> tuple[Array, _Changes]:
        """Pass a value through the effects of one block that acts once per sample: what comes out, and each new state.

        For the actuator these are its `sampled` effects.
        """
        value = jnp.zeros_like(signals.q1) + incoming
        changes = {}
        for place, effect in enumerate(self.effects):
            if effect.block is block and (effect.sampled or block in SAMPLED):
                here = eqx.tree_at(lambda s: s.incoming, signals, value)
                contribution, changes[place] = effect(t, states[place], here)
                if isinstance(contribution, Forces):
                    raise ValueError(f"{type(effect).__name__} acts once per sample: it adds one number, not Forces.")
                value = value + contribution
        return value, changes

    def hold(self, t: Array, state: State, command: Array, dt: Scalar) -> tuple[Held, _Changes]:
        """What the drive makes of a command (V) for one sample from t on."""
        signals = self.signals(state.plant, command)
        signals = eqx.tree_at(lambda s: (s.held_since, s.dt), signals, (t, dt))
        force, changes = self.along(Block.ACTUATOR, t, state.effects, signals, self.drive(command))
        return Held(command, force, t, dt), changes

    def _mechanics(self, t: Array, state: State, held: Held) -> tuple[Array, Forces, _Changes, Signals]:
        """Motor force (N), what effects add, dx/dt of each effect that acts at every instant, and what they saw."""
        signals = self.signals(state.plant, held.command)
        signals = eqx.tree_at(lambda s: (s.held_since, s.dt, s.force), signals, (held.since, held.dt, held.force))
        tau, total = held.force, Forces()
        rates = {}
        acting = [p for p, effect in enumerate(self.effects) if not acts_once_per_sample(effect)]
        for place in sorted(acting, key=lambda p: self.effects[p].block is not Block.ACTUATOR):  # the force comes first
            effect = self.effects[place]
            so_far = (tau, signals.grip1 + total.grip_motor, signals.grip2 + total.grip_load)
            here = eqx.tree_at(lambda s: (s.incoming, s.grip1, s.grip2), signals, so_far)
            made, rates[place] = effect(t, state.effects[place], here)
            if isinstance(made, Forces):
                total = jax.tree.map(lambda a, b: a + b, total, made)
            elif effect.block is Block.ACTUATOR:
                tau = tau + made
            else:
                total = jax.tree.map(lambda a, b: a + b, total, _on(effect.block, made))
        return tau, total, rates, signals

    def force(self, t: Array, state: State, held: Held) -> Array:
        """Motor force (N) that reaches the plant: the drive's, then that of effects in the actuator."""
        return self._mechanics(t, state, held)[0]

    def derivative(self, t: Array, state: State, held: Held) -> State:
        """d(state)/dt while the drive holds a command. Effects that act once per sample stand still."""
        tau, total, rates, signals = self._mechanics(t, state, held)
        rubbing = [
            0.0
            if friction is None
            else friction(v) - friction(v + total.slide) - more * smooth_sign(v + total.slide, friction.v_eps)
            for friction, v, more in zip(
                self.plant.frictions(),
                (signals.v1, signals.v2),
                (total.grip_motor, total.grip_load),
                strict=True,
            )
        ]
        return self._rates(self.plant, state, tau, total, rubbing, rates)

    def free(self, t: Array, state: State, held: Held) -> tuple[State, Grip]:
        """d(state)/dt without Coulomb friction, and what that friction can hold: for a step that solves for it."""
        tau, total, rates, signals = self._mechanics(t, state, held)
        forces: list[Array] = []
        speeds: list[Array] = []
        rubbing: list[Any] = []
        for friction, v, more in zip(
            self.plant.frictions(), (signals.v1, signals.v2), (total.grip_motor, total.grip_load), strict=True
        ):
            if friction is None:
                forces.append(jnp.zeros_like(v))
                speeds.append(jnp.ones_like(v))
                rubbing.append(0.0)
            else:
                forces.append(friction.level(v + total.slide) + more)
                speeds.append(jnp.asarray(friction.v_eps))
                rubbing.append(friction.split(v)[0] - friction.split(v + total.slide)[0])
        rolling = self._rates(without_coulomb(self.plant), state, tau, total, rubbing, rates)
        masses = self.plant.masses(total.payload)
        return rolling, Grip((forces[0], forces[1]), masses, (speeds[0], speeds[1]), total.slide)

    def _rates(
        self, plant: AbstractPlant, state: State, tau: Array, total: Forces, rubbing: list[Any], rates: _Changes
    ) -> State:
        """d(state)/dt; `rubbing` (N) comes on top of what effects add on each side."""
        dy = plant.vector_field(
            state.plant,
            tau,
            on_motor=total.motor + rubbing[0],
            on_coupling=total.coupling,
            on_load=total.load + rubbing[1],
            frame=total.frame,
            payload=total.payload,
        )
        still = jax.tree.map(jnp.zeros_like, state.effects)
        return State(dy, tuple(rates.get(place, x) for place, x in enumerate(still)))


def _on(block: Block, value: Array) -> Forces:
    """A bare contribution as what it means on its block."""
    match block:
        case Block.MOTOR_SIDE:
            return Forces(motor=value)
        case Block.COUPLING:
            return Forces(coupling=value)
        case Block.BASE:
            return Forces(frame=value)
        case _:
            return Forces(load=value)
