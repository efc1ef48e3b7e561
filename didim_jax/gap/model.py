"""One compiled closed loop with the whole catalogue in it, every effect at its null: choosing an effect is a mask.

Everything that a machine or a record decides (gains, limits, ranges, excitation) is traced, so that many cases of one
length compile once.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..effects import AbstractEffect
from ..params import Parameter, pack, parameters, unpack
from ..plant import AbstractPlant
from ..simulate import Excitation, SampledLoop, Start, simulate
from ..solver import Unrolled

SOLVER = Unrolled(dfx.Bosh3())
SUBSTEPS = 2
"""Two short steps a sample: a sign as sharp as 0.1 mm/s is stiff, and must stay stable at rest."""

WIDTH = 20
"""Columns of a Jacobian that are computed together; more take several turns, so that nothing compiles twice."""


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
        plant = _with_sharpness(plant, values[at])
        at += 1
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


def _with_sharpness(plant: AbstractPlant, v_eps: Array) -> AbstractPlant:
    """The plant with this smoothing speed (m/s) in every friction it has."""

    def where(p: AbstractPlant) -> list[Any]:
        return [friction.v_eps for friction in p.frictions() if friction is not None]

    return eqx.tree_at(where, plant, [v_eps] * len(where(plant)))


@eqx.filter_jit
def _run(traced: _Traced, x: Array) -> Array:
    return traced.outputs(x)


@eqx.filter_jit
def _batch(traced: _Traced, xs: Array) -> Array:
    return jax.vmap(traced.outputs)(xs)


@eqx.filter_jit
def _columns(traced: _Traced, x: Array, basis: Array) -> tuple[Array, Array]:
    def along(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(traced.outputs, (x,), (direction,))

    value, tangents = jax.vmap(along, out_axes=(None, 0))(basis)
    return value, tangents


class Model:
    """A record, the machine around a nominal plant, and every effect of the catalogue, as a function of one vector x.

    x lists the plant's parameters, the smoothing speed of the friction's sign, the effects' parameters in the order of
    the catalogue, and shifts of the initial state; it is 0 at every null, and near 1 in size at a typical value.
    """

    def __init__(
        self,
        loop: SampledLoop,
        excitation: Excitation,
        start: Start,
        device: Any = None,
    ) -> None:
        effects = loop.chain.effects
        self.effects = effects
        self.entries = tuple(_entries(loop, effects, start))
        self.names = [f"{e.owner}.{e.name}" if e.owner else e.name for e in self.entries]
        traced = _Traced(
            loop,
            excitation,
            start,
            jnp.asarray([e.null for e in self.entries]),
            jnp.asarray([e.scale for e in self.entries]),
            jnp.asarray([e.logarithmic for e in self.entries]),
        )
        self._traced = jax.device_put(traced, device) if device is not None else traced
        self.dt = float(excitation.dt)
        self.n = int(excitation.qg.shape[0])

    @functools.cached_property
    def index(self) -> Mapping[str, int]:
        """Place in x by name: `M1`, `stribeck.vs`, `start.q1`."""
        return {name: i for i, name in enumerate(self.names)}

    def of(self, owner: str) -> list[int]:
        """Places in x of what belongs to "" (plant), "start" or an effect."""
        return [i for i, e in enumerate(self.entries) if e.owner == owner]

    @property
    def lower(self) -> np.ndarray:
        """Least allowed x."""
        return np.array([e.encode(e.lower) if np.isfinite(e.lower) else -np.inf for e in self.entries])

    @property
    def upper(self) -> np.ndarray:
        """Greatest allowed x."""
        return np.array([e.encode(e.upper) if np.isfinite(e.upper) else np.inf for e in self.entries])

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
        return np.asarray(_run(self._traced, jnp.asarray(x, dtype=float)))

    def batch(self, xs: np.ndarray, width: int = 32) -> np.ndarray:
        """(len(xs), 2, n): many runs, `width` at once."""
        out = []
        for k in range(0, len(xs), width):
            part = np.asarray(xs[k : k + width], dtype=float)
            padded = np.concatenate([part, np.repeat(part[-1:], width - len(part), axis=0)])
            out.append(np.asarray(_batch(self._traced, jnp.asarray(padded)))[: len(part)])
        return np.concatenate(out) if out else np.zeros((0, 2, self.n))

    def columns(self, x: np.ndarray, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """The run at x, (2, n), and its exact derivative by the chosen entries of x, (len(chosen), 2, n)."""
        x = np.asarray(x, dtype=float)
        value, parts = np.zeros((2, self.n)), []
        for k in range(0, len(chosen), WIDTH):
            part = list(chosen[k : k + WIDTH])
            basis = np.zeros((WIDTH, len(x)))
            basis[np.arange(len(part)), part] = 1.0
            first, tangents = _columns(self._traced, jnp.asarray(x), jnp.asarray(basis))
            value = np.asarray(first)
            parts.append(np.asarray(tangents)[: len(part)])
        return value, np.concatenate(parts) if parts else np.zeros((0, 2, self.n))


def _entries(loop: SampledLoop, effects: Sequence[AbstractEffect], start: Start) -> list[Entry]:
    plant = loop.chain.plant
    found = [_entry("", p, value) for p, value in zip(parameters(plant), pack(plant).tolist(), strict=True)]
    found = [dataclasses.replace(e, null=0.0, lower=-np.inf, upper=np.inf) for e in found]
    found.append(Entry("", "v_eps", "m/s", 1e-3, 0.0, 1e-4, 2e-2, logarithmic=True))
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


def _entry(owner: str, p: Parameter, value: float) -> Entry:
    # A positive parameter of an effect is at its default for x = 0, as any other is at its null.
    scale = value if p.positive and owner and 0 < value < np.inf else p.scale
    return Entry(owner, p.name, p.unit, scale, value, p.lower, p.upper, logarithmic=p.positive)
