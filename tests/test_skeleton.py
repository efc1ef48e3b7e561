"""The package keeps its shape: imports point down, importing changes nothing, the environment can be rebuilt."""

import ast
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "didim_jax"

# A module may import from its own floor or from a lower one.
FLOORS = {
    0: "_types params recording formats files config errors machine hygiene benchmark signals reference devices",
    1: "effects plant control plant_file solver processes",
    2: "chain sliding simulate idm statistics rig synthesize",
    3: "identify",
    4: "sweep gap",
    5: "report",
    6: "cli __main__",
}
FLOOR_OF = {name: floor for floor, names in FLOORS.items() for name in names.split()}
TOP = max(FLOORS)

# Allowed by the floors alone, or worth a rule of its own: (importer, imported).
FORBIDDEN = {("effects", "plant"), ("identify", "gap"), ("identify", "report")}


def module_parts(path: Path, root: Path) -> tuple[str, ...]:
    """Dotted name of the file as a tuple, `__init__` included: it decides what a relative import starts from."""
    return path.relative_to(root).with_suffix("").parts


def imported_modules(source: str, parts: tuple[str, ...]) -> set[tuple[str, ...]]:
    """Absolute dotted names the module imports anywhere: inside functions and for type checking too."""
    found: set[tuple[str, ...]] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {tuple(alias.name.split(".")) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = parts[: len(parts) - node.level] if node.level else ()
            base = start + tuple(node.module.split(".") if node.module else ())
            found |= {(*base, alias.name) for alias in node.names}
    return found


def violations(root: Path) -> list[str]:
    """Every import in root/didim_jax that leaves the package for experiments, or points up."""
    wrong = []
    for path in sorted((root / "didim_jax").rglob("*.py")):
        parts = module_parts(path, root)
        here = parts[1]
        where = path.relative_to(root)
        if here != "__init__" and here not in FLOOR_OF:
            wrong.append(f"{where}: didim_jax.{here} has no floor; enter it in FLOORS in tests/test_skeleton.py")
            continue
        floor = TOP if here == "__init__" else FLOOR_OF[here]
        for target in sorted(imported_modules(path.read_text(encoding="utf-8"), parts)):
            if target[0] == "experiments":
                wrong.append(f"{where}: imports {'.'.join(target)}, but the package never sees the experiments")
            if target[0] != "didim_jax":
                continue
            there = target[1] if len(target) > 1 else "__init__"
            name = ".".join(target)
            # A public name taken from the top of the package drags in everything: only the top floor may.
            if there not in FLOOR_OF and floor < TOP:
                wrong.append(f"{where}: imports {name}, neither a module with a floor nor from one")
            elif FLOOR_OF.get(there, TOP) > floor:
                wrong.append(f"{where}: floor {floor} imports {name}, floor {FLOOR_OF[there]}")
            elif (here, there) in FORBIDDEN:
                wrong.append(f"{where}: {here} must not import {there}")
    return wrong


def test_imports_point_down_only():
    assert not violations(ROOT), "\n" + "\n".join(violations(ROOT))


@pytest.mark.parametrize(
    ("file", "source", "complaint"),
    [
        ("plant/rigid.py", "from ..effects import friction", None),
        ("idm.py", "from . import signals", None),
        ("cli.py", "from didim_jax import identify, __version__", None),
        ("effects/friction.py", "from ..plant.rigid import RigidDrive", "effects must not import plant"),
        ("effects/__init__.py", "from ..plant import RigidDrive", "effects must not import plant"),
        ("identify/didim.py", "def f():\n    import didim_jax.gap.atlas", "floor 3 imports didim_jax.gap.atlas"),
        ("signals.py", "from didim_jax import Recording", "neither a module with a floor"),
        ("report/page.py", "import experiments.blind.truth", "never sees the experiments"),
        ("novelty.py", "", "enter it in FLOORS"),
    ],
)
def test_the_import_rule_sees_what_it_forbids(tmp_path, file, source, complaint):
    path = tmp_path / "didim_jax" / file
    path.parent.mkdir(parents=True)
    path.write_text(source)
    found = violations(tmp_path)
    assert len(found) == (complaint is not None), found
    assert complaint is None or complaint in found[0]


@pytest.mark.parametrize("x64", [False, True])
def test_importing_the_package_changes_no_flag_and_prints_nothing(x64):
    code = f"""
import jax
jax.config.update("jax_enable_x64", {x64})
import didim_jax
raise SystemExit(jax.config.jax_enable_x64 is not {x64})
"""
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


def constraint_lines() -> list[str]:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line.strip() and not line.startswith("#")]


def test_constraints_are_exact_pins_without_addresses():
    assert [line for line in constraint_lines() if not re.fullmatch(r"[\w.-]+==[\w.]+", line)] == []
    assert "://" not in (ROOT / "constraints.txt").read_text(encoding="utf-8")


def test_every_declared_dependency_is_pinned():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    declared = [name for group in (project["dependencies"], *extras) for name in group]
    pinned = {canonical(line.split("==")[0]) for line in constraint_lines()}
    assert {canonical(re.split(r"[<>=!~\[; ]", name)[0]) for name in declared} <= pinned


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_no_measured_data_is_committed():
    listing = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listing.returncode != 0:
        pytest.skip("not a git checkout")
    assert [name for name in listing.stdout.splitlines() if name.lower().endswith(".mat")] == []


def find_python(path: Path) -> subprocess.CompletedProcess[str]:
    """Run the search with nothing but `path` on PATH."""
    script = str(ROOT / "tools" / "find_python.sh")
    return subprocess.run(["/bin/sh", script], env={"PATH": str(path)}, capture_output=True, text=True, check=False)


def fake_program(path: Path, body: str) -> None:
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)


@pytest.mark.parametrize("status", [0, 1])
def test_find_python_says_in_one_line_what_is_missing(tmp_path, status):
    fake_program(tmp_path / "python3", f"echo Python 3.9.2; exit {status}")
    run = find_python(tmp_path)
    assert (run.returncode, run.stdout) == (1, "")
    assert len(run.stderr.splitlines()) == 1
    assert "install Python 3.12 or 3.13" in run.stderr


def test_find_python_passes_over_a_name_that_does_not_run(tmp_path):
    fake_program(tmp_path / "python3", "echo 'version 3.13 is not installed' >&2; exit 127")
    fake_program(tmp_path / "python3.12", f'exec {shlex.quote(sys.executable)} "$@"')
    run = find_python(tmp_path)
    assert (run.returncode, run.stderr) == (0, "")
    version = subprocess.run([run.stdout.strip(), "--version"], capture_output=True, text=True, check=True).stdout
    assert version.startswith(("Python 3.12.", "Python 3.13."))


def test_find_python_names_the_modules_a_stripped_python_lacks(tmp_path):
    fake_program(tmp_path / "python3.13", "exit 3")
    run = find_python(tmp_path)
    assert run.returncode == 1
    assert "python3.13 has no venv and ensurepip modules" in run.stderr
