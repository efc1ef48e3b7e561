"""Shared fixtures: 64-bit arithmetic, the shared data where present, one small simulated record."""

import os
from pathlib import Path

import jax
import numpy as np
import pytest

from didim_jax.machine import Controller, Drive, Encoder, Machine
from didim_jax.plant import AbstractPlant
from didim_jax.plant_file import load_plant
from didim_jax.recording import Recording
from didim_jax.reference import load_reference
from didim_jax.synthesize import synthesize

ROOT = Path(__file__).resolve().parents[1]

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests first: the last one to begin then is a short one, and no worker waits long for it."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session", autouse=True)
def compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Programs compiled by one worker, or by a process that a test starts, serve all; the user's are not used."""
    root = tmp_path_factory.getbasetemp()
    folder = (root.parent if "PYTEST_XDIST_WORKER" in os.environ else root) / "compiled"
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of the shared data: $DIDIM_DATA, else ../shared/data beside the repository."""
    repository = Path(__file__).resolve().parents[1]
    return Path(os.environ.get("DIDIM_DATA") or repository.parent / "shared" / "data")


@pytest.fixture(scope="session")
def emps_dir(data_dir: Path) -> Path:
    """Folder with DATA_EMPS.mat, DATA_EMPS_PULSES.mat and machine.toml."""
    folder = data_dir / "emps"
    if not (folder / "DATA_EMPS.mat").is_file():
        pytest.skip(f"needs the EMPS records: no {folder / 'DATA_EMPS.mat'}, set DIDIM_DATA to the folder above 'emps'")
    return folder


@pytest.fixture(scope="session")
def gap_cases(data_dir: Path) -> list[Path]:
    """Folders of the development cases (fit.mat, check.mat, machine.toml), beside the shared data."""
    for folder in (data_dir.parent / "gap" / "dev", data_dir.parent / "shared" / "gap" / "dev"):
        if cases := sorted(path.parent for path in folder.glob("*/machine.toml")):
            return cases
    pytest.skip(f"needs the development cases: no {data_dir.parent / 'gap' / 'dev'}, set DIDIM_DATA")


@pytest.fixture(scope="session")
def emps_like() -> Machine:
    """A machine with the documented values of the EMPS."""
    return Machine(
        name="bench",
        model="rigid",
        mass_apriori=78.0,
        screw_lead=0.0025,
        controller=Controller(law="pd", kp=160.18, kv=243.45, sample_time=1e-3, velocity="two-sample"),
        drive=Drive(gain=35.15, limit=10.0),
        encoder=Encoder(resolution=5e-8),
    )


@pytest.fixture(scope="session")
def clean_run(emps_like: Machine) -> Recording:
    """Two seconds of a rigid mass under the documented law, encoder counted, in plain numpy: nothing odd in it."""
    c, n = emps_like.controller, 2000
    t = np.arange(n) * c.sample_time
    qg = 0.05 * (1 - np.cos(2 * np.pi * t)) + 0.0003 * (1 - np.cos(14 * np.pi * t))
    qm, vir = np.zeros(n), np.zeros(n)
    q = v = 0.0
    for k in range(n):
        qm[k] = emps_like.encoder.resolution * np.round(q / emps_like.encoder.resolution)
        dq = (qm[k] - qm[max(k - 2, 0)]) / (2 * c.sample_time)
        vir[k] = c.kv * (c.kp * (qg[k] - qm[k]) - dq)
        v += c.sample_time * (emps_like.drive.gain * vir[k] - 200.0 * v - 20.0 * np.tanh(v / 1e-3)) / 95.0
        q += c.sample_time * v
    return Recording(t, qg, qm, vir, emps_like.drive.gain, ql=qm + 1e-6 * vir, name="clean run", synthetic=True)


@pytest.fixture(scope="session")
def twin_machine() -> Machine:
    """The synthetic twin's machine: the published gains and the EMPS encoder."""
    return Machine.load(ROOT / "configs" / "twin" / "machine.toml")


@pytest.fixture(scope="session")
def twin_plant() -> AbstractPlant:
    """Table 3 of the paper, IDIM-LS column."""
    return load_plant(ROOT / "configs" / "twin" / "plant.toml")


@pytest.fixture(scope="session")
def twin_run(twin_machine: Machine, twin_plant: AbstractPlant) -> Recording:
    """The twin under trapezoids and a chirp, with white noise of 3 N rms on the recorded force."""
    qg = load_reference(ROOT / "configs" / "twin" / "reference.toml").sample(twin_machine.controller.sample_time)
    return synthesize(twin_machine, twin_plant, qg, force_noise=3.0, seed=1, name="twin")
