"""The truth of blind cases is independent of the package, physically sound, and nothing at size 0."""

import ast
import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import io

from experiments.blind import truth
from experiments.blind.truth import EFFECTS, FLEXIBLE_ONLY, OUTSIDE, Made, Wish, make, write
from experiments.blind.truth.catalogue import draw_effects
from experiments.blind.truth.kernel import run
from experiments.blind.truth.law import Draw
from experiments.blind.truth.machine import DT, LEAST_DAMPING, Machine, draw_machine, least_damping
from experiments.blind.truth.record import Plan, draw_plan, simulate
from experiments.blind.truth.slots import NULL, changed

ALL = (*EFFECTS, *OUTSIDE)
ALLOWED = {"numpy", "scipy", "numba", *sys.stdlib_module_names}


@pytest.fixture(scope="module")
def machine() -> Machine:
    return draw_machine(np.random.default_rng(1), "flexible")


@pytest.fixture(scope="module")
def plan(machine: Machine) -> Plan:
    return draw_plan(np.random.default_rng(2), machine, "usual", 0.8)


@pytest.fixture(scope="module")
def nominal(machine: Machine, plan: Plan) -> np.ndarray:
    """Commands of the quiet nominal run."""
    return simulate(machine.slots(), plan, [], None, np.random.default_rng(0)).u


def quiet(p: np.ndarray, qg: np.ndarray) -> tuple[np.ndarray, ...]:
    none = np.zeros(qg.size)
    return run(p, qg, none, none, none, none, np.zeros(qg.size, bool), True)


def drawn_run(effect: str, size: float, seed: int, machine: Machine, plan: Plan, nominal: np.ndarray) -> np.ndarray:
    """Commands of a quiet run with one effect; limits are shares of the peaks of the `nominal` commands."""
    peak, slope = float(np.abs(nominal).max()), float(np.abs(np.diff(nominal)).max()) / DT
    draw = Draw(np.random.default_rng(seed), machine, size, peak, slope)
    effects, _ = draw_effects(seed, draw, (effect,), size, 0.0)
    return simulate(changed(machine.slots(), **effects[0].slots), plan, effects, None, np.random.default_rng(seed)).u


def test_imports_nothing_but_numpy_scipy_and_numba():
    for path in Path(truth.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level:
                assert node.level == 1, path
            elif isinstance(node, ast.ImportFrom):
                assert (node.module or "").split(".")[0] in ALLOWED, path
            elif isinstance(node, ast.Import):
                assert all(name.name.split(".")[0] in ALLOWED for name in node.names), path


def test_catalogue_has_every_kind():
    assert len(EFFECTS) == 32 and "drive_gain" in EFFECTS
    assert len(OUTSIDE) >= 10 and all(name.startswith("x_") for name in OUTSIDE)


def test_stiction_holds_below_the_cone_and_not_above(machine: Machine):
    free = changed(machine.slots(), kv=0.0)
    qg = np.full(1500, 0.05)
    _, _, _, q1, v1, q2, v2 = quiet(changed(free, F0_load=0.98 * machine.base["Fc2"]), qg)
    for at_rest in (q1 - 0.05, v1, q2 - 0.05, v2):
        assert not at_rest.any()  # exactly: sticking is no creeping
    moved = quiet(changed(free, F0_load=1.05 * machine.coulomb), qg)
    assert moved[5][-1] > 0.051


def test_energy_only_falls_once_nothing_pushes(machine: Machine):
    # a push on the load through 0.2 s, then coasting with the drive off
    p = changed(machine.slots(), kv=0.0, pulse_F=150.0, pulse_t0=0.0, pulse_W=0.2, pulse_n=1.0)
    _, _, _, q1, v1, q2, v2 = quiet(p, np.full(8000, 0.05))
    base = machine.base
    energy = 0.5 * (base["M1"] * v1**2 + base["M2"] * v2**2 + base["K12"] * (q2 - q1) ** 2)
    # the step keeps a neighbouring energy exactly, this one to (2 pi f h)^2 / 4: 4e-5 at the highest free mode, 40 Hz
    assert energy[200] > 0.01
    assert np.all(np.diff(energy[201:]) <= 1e-4 * energy[201:-1])
    assert v1[-1] == v2[-1] == 0.0


def test_finer_steps_give_the_same_force(machine: Machine, plan: Plan):
    u, fine = (quiet(changed(machine.slots(), substeps=n), plan.qg)[2] for n in (20.0, 80.0))
    # second order where friction is smooth, first order at the moment of sticking: well below any floor, about 1 %
    assert np.linalg.norm(u - fine) < 1e-3 * np.linalg.norm(fine)


def test_at_rest_on_a_resting_reference(machine: Machine):
    u = quiet(machine.slots(), np.full(500, 0.05))[2]
    assert not u.any()


@pytest.mark.parametrize("effect", ALL)
def test_effect_is_nothing_at_size_0_and_something_at_1(effect: str, machine: Machine, plan: Plan, nominal: np.ndarray):
    for seed in (0, 1):  # other laws of the same effect
        np.testing.assert_array_equal(drawn_run(effect, 0.0, seed, machine, plan, nominal), nominal)
        changes = drawn_run(effect, 1.0, seed, machine, plan, nominal) - nominal
        assert np.abs(changes).max() > 0.01  # V; the same run would give 0


@pytest.mark.parametrize(
    "wish",
    [
        Wish(),
        Wish(("backlash", "friction_drift"), load_encoder=True, noise="high", seed=1),
        Wish(("stribeck",), model="rigid", noise="low", seed=2),
        Wish(("offset",), excitation="poor", seed=3),
        Wish(numerics=True, seed=2**63 - 1),
        Wish(("x_missed_counts",), seed=5),
    ],
)
def test_records_stay_within_stroke_speed_and_drive(wish: Wish):
    made = make(wish)
    for record in (made.fit, made.check):
        assert ("ql" in record) == wish.load_encoder
        assert record["t"].size == record["vir"].size == 10_000
        assert np.abs(record["vir"]).max() <= 8.0
        assert record["qm"].min() > -0.01 and record["qm"].max() < 0.17
        assert np.abs(np.diff(record["qg"])).max() <= 0.2e-3
        np.testing.assert_allclose(record["qm"] / 5e-8, np.round(record["qm"] / 5e-8), atol=1e-4)  # counts
    assert not np.array_equal(made.fit["qg"], made.check["qg"])
    assert all(0 < made.answer["floor"][name] < 0.5 for name in ("fit", "check"))


def test_the_control_law_is_the_contracts():
    made = make(Wish(seed=7))
    qg, qm, vir = (made.check[name].astype(float) for name in ("qg", "qm", "vir"))
    kp, kv = float(made.check["kp"][0]), float(made.check["kv"][0])
    law = kv * (kp * (qg[2:] - qm[2:]) - (qm[2:] - qm[:-2]) / 2e-3)
    np.testing.assert_allclose(vir[2:], law, atol=1e-6)  # float32 of some volts


def test_a_seed_decides_everything_and_the_machine_does_not_hint():
    wish = Wish(("cogging",), seed=11)
    one, two, other = make(wish), make(wish), make(dataclasses.replace(wish, effects=("presliding",)))
    for name in one.fit:
        np.testing.assert_array_equal(one.fit[name], two.fit[name])
    assert one.answer == two.answer
    assert one.machine == other.machine
    assert not np.array_equal(one.fit["vir"], make(dataclasses.replace(wish, seed=12)).fit["vir"])


def test_half_of_the_records_start_in_motion(machine: Machine):
    plans = [draw_plan(np.random.default_rng(k), machine, "usual", 1.0) for k in range(100)]
    moving = [plan for plan in plans if plan.start]
    assert 35 <= len(moving) <= 65  # three standard deviations of 100 throws
    assert all(abs(plan.qg[plan.start] - plan.qg[plan.start - 1]) > 1e-6 for plan in moving)


def test_machines_are_well_damped():
    rng = np.random.default_rng(0)
    assert all(least_damping(draw_machine(rng, "flexible")) > LEAST_DAMPING for _ in range(5))


def test_refuses_what_cannot_be():
    for effect in FLEXIBLE_ONLY:
        with pytest.raises(ValueError, match="needs a coupling"):
            Wish((effect,), model="rigid")
    with pytest.raises(ValueError, match="No effect is named"):
        Wish(("gremlins",))
    with pytest.raises(ValueError, match="one of low, usual, high"):
        Wish(noise="loud")
    with pytest.raises(ValueError, match="no number named"):
        changed(draw_machine(np.random.default_rng(0), "rigid").slots(), Fc9=1.0)
    assert all(np.isfinite(value) for value in NULL.values())


def test_written_as_the_contract_says(tmp_path: Path):
    made: Made = make(Wish(seed=1, load_encoder=True))
    write(made, tmp_path, "case-0042")
    record = io.loadmat(tmp_path / "fit.mat")
    assert record["qm"].shape == record["ql"].shape == (10_000, 1)
    assert 'name = "case-0042"' in (tmp_path / "machine.toml").read_text(encoding="utf-8")


def test_says_when_a_time_local_effect_acts():
    made = make(Wish(("disturbance_pulses",), seed=3))
    start = made.answer["start_s"]["check"]
    first = made.answer["parameters"]["disturbance_pulses"]["t0"]["value"]
    on, off = made.answer["intervals_s"]["disturbance_pulses"]["check"][0]
    assert on == pytest.approx(first - start) and off > on
    assert json.loads(json.dumps(made.answer, allow_nan=False)) == made.answer
