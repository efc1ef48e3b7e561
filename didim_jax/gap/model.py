"""One closed loop with the whole catalogue in it, every effect at its null: choosing an effect is a mask.

Everything that a machine or a record decides (gains, limits, ranges, excitation) is traced, so that many cases of one
length compile once. Effects at their null add nothing and would take most of the time, so that a program holds only
those that take part.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..effects import AbstractEffect
from ..params import Parameter, pack, parameters, unpack
from ..simulate import Excitation, SampledLoop, Start, simulate
from ..sliding import Sliding
from .rounded import SHAPE, with_sign

SOLVER = Sliding()
SUBSTEPS = 4
"""Real friction holds at rest: a nominal plant that creeps there would call every dwell a gap."""

ALWAYS = frozenset({"amplifier_lag", "coupling_damping"})
"""Effects that every machine has a little of: every program holds them."""

FRICTION = ("Fv", "Fc")
"""How the names of a plant's friction parameters begin."""

LEAST_FRICTION = -0.3
"""Of a typical size: less is no machine, and an effect that bends the plant so far is hidden by it."""

AT_BOUND = 1e-3
"""Of its range, within which a parameter is at the end of it: a solver with bounds comes near, not there."""

WIDTH = 12
"""Columns of a Jacobian that are computed together at most; more take several turns, which are no slower for it."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """One entry of x: what it belongs to ("" the plant, "start" the initial state, or an effect), name, unit, range."""

    owner: str
    name: str
    unit: str
    scale: float
    null: float
    lower: float
    upper: float
    logarithmic: bool = False

    def encode(self, value: float) -> float:
        """x of a value."""
        return float(np.log(value / self.scale)) if self.logarithmic else (value - self.null) / self.scale

    def decode(self, x: float) -> float:
        """Value of x."""
        return float(self.scale * np.exp(x)) if self.logarithmic else float(self.null + self.scale * x)


class _Traced(eqx.Module):
    """What the compiled program needs of one record: its loop, excitation and start, all traced."""

    loop: SampledLoop
    excitation: Excitation
    start: Start
    nulls: Array
    scales: Array
    logarithmic: Array

    def outputs(self, x: Array) -> Array:
        """(2, n): commanded force (N) and motion of the load against the measured one, q2 - qm (m), at x."""
        values = jnp.where(
            self.logarithmic, self.scales * jnp.exp(jnp.where(self.logarithmic, x, 0.0)), self.nulls + self.scales * x
        )
        chain = self.loop.chain
        plant_parameters = parameters(chain.plant)
        at = len(plant_parameters)
        plant = unpack(chain.plant, values[:at])
        plant = with_sign(plant, values[at : at + len(SHAPE)])
        at += len(SHAPE)
        effects = []
        for effect in chain.effects:
            chosen = parameters(effect)
            effects.append(unpack(effect, values[at : at + len(chosen)]))
            at += len(chosen)
        loop = eqx.tree_at(lambda a: (a.chain.plant, a.chain.effects), self.loop, (plant, tuple(effects)))
        k = self.start.plant.shape[0]
        shift = values[at:]
        out = simulate(loop, self.excitation, Start(self.start.plant + shift[:k], self.start.memory + shift[k:]))
        return jnp.stack([out.tau, out.load.q - out.qm])


@eqx.filter_jit
def _run(traced: _Traced, x: Array) -> Array:
    return traced.outputs(x)


@eqx.filter_jit
def _columns(traced: _Traced, x: Array, basis: Array) -> tuple[Array, Array]:
    def along(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(traced.outputs, (x,), (direction,))

    value, tangents = jax.vmap(along, out_axes=(None, 0))(basis)
    return value, tangents


class Model:
    """A record, the machine around a nominal plant, and every effect of the catalogue, as a function of one vector x.

    x lists the plant's parameters, the shape of the friction's sign, the effects' parameters in the order of the
    catalogue, and shifts of the initial state; it is 0 at every null, and near 1 in size at a typical value.
    """

    def __init__(
        self,
        loop: SampledLoop,
        excitation: Excitation,
        start: Start,
    ) -> None:
        effects = loop.chain.effects
        self.effects = effects
        self.entries = tuple(_entries(loop, effects, start))
        self.names = [f"{e.owner}.{e.name}" if e.owner else e.name for e in self.entries]
        self._loop, self._excitation, self._start = loop, excitation, start
        self._programs: dict[frozenset[str], _Program] = {}
        self.dt = float(excitation.dt)
        self.n = int(excitation.qg.shape[0])

    @functools.cached_property
    def index(self) -> Mapping[str, int]:
        """Place in x by name: `M1`, `stribeck.vs`, `start.q1`."""
        return {name: i for i, name in enumerate(self.names)}

    def of(self, owner: str) -> list[int]:
        """Places in x of what belongs to "" (plant), "start" or an effect."""
        return [i for i, e in enumerate(self.entries) if e.owner == owner]

    @functools.cached_property
    def lower(self) -> np.ndarray:
        """Least allowed x."""
        return np.array([e.encode(e.lower) if np.isfinite(e.lower) else -np.inf for e in self.entries])

    @functools.cached_property
    def upper(self) -> np.ndarray:
        """Greatest allowed x."""
        return np.array([e.encode(e.upper) if np.isfinite(e.upper) else np.inf for e in self.entries])

    def bound(self, x: np.ndarray, place: int) -> str:
        """Whether an entry of x is as low or as high as it may be: "least", "most", or "" in between."""
        low, high = self.lower[place], self.upper[place]
        slight = AT_BOUND * (high - low)
        if not np.isfinite(slight):
            return ""
        return "least" if x[place] < low + slight else "most" if x[place] > high - slight else ""

    def encode(self, x: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        """x with these values (SI) in their places."""
        x = np.array(x, dtype=float)
        for name, value in values.items():
            x[self.index[name]] = self.entries[self.index[name]].encode(value)
        return x

    def decode(self, x: np.ndarray) -> dict[str, float]:
        """Name to value (SI)."""
        return {name: entry.decode(value) for name, entry, value in zip(self.names, self.entries, x, strict=True)}

    def run(self, x: np.ndarray) -> np.ndarray:
        """(2, n): commanded force (N) and q2 - qm (m)."""
        x = np.asarray(x, dtype=float)
        program = self._program(x != 0)
        return np.asarray(_run(program.traced, program.part(x)))

    def batch(self, xs: np.ndarray) -> np.ndarray:
        """(len(xs), 2, n): a run at each x."""
        return np.array([self.run(x) for x in xs]).reshape(-1, 2, self.n)

    def columns(self, x: np.ndarray, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """The run at x, (2, n), and its exact derivative by the chosen entries of x, (len(chosen), 2, n)."""
        x = np.asarray(x, dtype=float)
        moved = x != 0
        moved[list(chosen)] = True
        program = self._program(moved)
        value, parts = np.zeros((2, self.n)), []
        width = program.width_for(len(chosen))
        for k in range(0, len(chosen), width):
            part = list(chosen[k : k + width])
            basis = np.zeros((width, len(x)))
            basis[np.arange(len(part)), part] = 1.0
            first, tangents = _columns(program.traced, program.part(x), program.part(basis))
            value = np.asarray(first)
            parts.append(np.asarray(tangents)[: len(part)])
        return value, np.concatenate(parts) if parts else np.zeros((0, 2, self.n))

    def _program(self, moved: np.ndarray) -> "_Program":
        """The program of the effects that own an entry of x which is not at its null or may move, (len(x),) of bool."""
        present = {self.entries[i].owner for i in np.flatnonzero(moved)} - {"", "start"}
        kept = ALWAYS | present
        if kept not in self._programs:
            self._programs[kept] = self._reduced(kept)
        return self._programs[kept]

    def _reduced(self, kept: frozenset[str]) -> "_Program":
        effects = tuple(effect for effect in self.effects if effect.label() in kept)
        loop = eqx.tree_at(lambda a: a.chain.effects, self._loop, effects)
        places = np.array([i for i, e in enumerate(self.entries) if e.owner in kept or e.owner in ("", "start")])
        entries = [self.entries[i] for i in places]
        traced = _Traced(
            loop,
            self._excitation,
            self._start,
            jnp.asarray([e.null for e in entries]),
            jnp.asarray([e.scale for e in entries]),
            jnp.asarray([e.logarithmic for e in entries]),
        )
        return _Program(traced, places)


@dataclasses.dataclass
class _Program:
    """A loop with some of the effects in it, and where its entries lie in the whole x."""

    traced: _Traced
    places: np.ndarray
    width: int = 0

    def width_for(self, columns: int) -> int:
        """Columns computed together: as many as ever asked for, in steps of four (a register's).

        So a program compiles once, or once more for an effect that it always holds and that is seldom looked for.
        """
        self.width = max(self.width, min(WIDTH, 4 * math.ceil(columns / 4)))
        return self.width

    def part(self, x: np.ndarray) -> Array:
        """Its entries of x, along the last axis."""
        return jnp.asarray(x[..., self.places])


def _entries(loop: SampledLoop, effects: Sequence[AbstractEffect], start: Start) -> list[Entry]:
    plant = loop.chain.plant
    found = [_of_plant(p, value) for p, value in zip(parameters(plant), pack(plant).tolist(), strict=True)]
    found.append(Entry("", "v_eps", "m/s", 1e-3, 0.0, 1e-6, 2e-2, logarithmic=True))
    found += [Entry("", name, "1", 0.1, 0.0, 0.0, 1.0) for name in SHAPE[1:]]
    for effect in effects:
        values = pack(effect).tolist()
        found += [_entry(effect.label(), p, v) for p, v in zip(parameters(effect), values, strict=True)]
    scales = (*plant.state_scales, *loop.memory_scales)
    names = (*plant.state_names, *loop.memory_names)
    found += [
        Entry("start", name, "m" if scale < 1e-4 else "m/s", scale, 0.0, -np.inf, np.inf)
        for name, scale in zip(names, scales, strict=True)
    ]
    return found


def _of_plant(p: Parameter, value: float) -> Entry:
    """Free, but for friction: a fit finds where it is from any side."""
    entry = _entry("", p, value)
    lower = LEAST_FRICTION * entry.scale if p.name.startswith(FRICTION) else -np.inf
    return dataclasses.replace(entry, null=0.0, lower=lower, upper=np.inf)


def _entry(owner: str, p: Parameter, value: float) -> Entry:
    # A positive parameter of an effect is at its default for x = 0, as any other is at its null.
    scale = value if p.positive and owner and 0 < value < np.inf else p.scale
    return Entry(owner, p.name, p.unit, scale, value, p.lower, p.upper, logarithmic=p.positive)
