"""The chain of blocks from the drive's command to the motion: drive, plant, and whatever effects sit between them."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from ._types import Scalar
from .control import Drive
from .effects import AbstractEffect, Block, Signals
from .plant import AbstractPlant


class State(eqx.Module):
    """State of the plant (a vector) and of every effect (a tree each, by its place in the chain)."""

    plant: Array
    effects: tuple[Any, ...]


class Chain(eqx.Module):
    """Drive and plant, with effects attached to their blocks; within a block they act in the order given."""

    drive: Drive
    plant: AbstractPlant
    effects: tuple[AbstractEffect, ...] = ()

    def signals(self, y: Array, command: Scalar) -> Signals:
        """What effects see while the plant is at y and the drive holds `command` (V)."""
        q1, v1, q2, v2 = self.plant.sides(y)
        nothing = jnp.zeros_like(q1)
        return Signals(q1, v1, q2, v2, self.plant.coupling_force(y), nothing + command, nothing)

    def init(self, y: Array) -> State:
        """State at a first sample, every effect at the state that suits the motion there."""
        signals = self.signals(y, 0.0)
        return State(y, tuple(effect.init(signals) for effect in self.effects))

    def along(
        self, block: Block, t: Array, states: tuple[Any, ...], signals: Signals, incoming: Scalar
    ) -> tuple[Array, dict[int, Any]]:
        """Pass a value through the effects of one block: what comes out, and each one's change by its place."""
        value = jnp.zeros_like(signals.q1) + incoming
        changes = {}
        for place, effect in enumerate(self.effects):
            if effect.block is block:
                here = eqx.tree_at(lambda s: s.incoming, signals, value)
                contribution, changes[place] = effect(t, states[place], here)
                value = value + contribution
        return value, changes

    def force(self, t: Array, state: State, command: Array) -> Array:
        """Motor force (N) that reaches the plant while the drive holds `command` (V): the drive's, then its effects."""
        signals = self.signals(state.plant, command)
        return self.along(Block.ACTUATOR, t, state.effects, signals, self.drive(command))[0]

    def derivative(self, t: Array, state: State, command: Array) -> State:
        """d(state)/dt while the drive holds `command` (V). Effects that act once per sample stand still."""
        signals = self.signals(state.plant, command)
        rates = {}

        def through(block: Block, incoming: Scalar = 0.0) -> Array:
            value, changes = self.along(block, t, state.effects, signals, incoming)
            rates.update(changes)
            return value

        dy = self.plant.vector_field(
            state.plant,
            through(Block.ACTUATOR, self.drive(command)),
            on_motor=through(Block.MOTOR_SIDE),
            on_coupling=through(Block.COUPLING),
            on_load=through(Block.LOAD_SIDE) + through(Block.ENVIRONMENT),
            frame=through(Block.BASE),
        )
        still = jax.tree.map(jnp.zeros_like, state.effects)
        return State(dy, tuple(rates.get(place, x) for place, x in enumerate(still)))
