"""A machine reads back as it was written, and no machine that physics forbids is accepted from a file."""

import dataclasses
import re

import pytest

from didim_jax.errors import InputError
from didim_jax.machine import Machine


def _edit(machine, tmp_path, old, new):
    path = tmp_path / "machine.toml"
    machine.save(path)
    text = path.read_text(encoding="utf-8")
    edited = re.sub(old, new, text, flags=re.M)
    assert edited != text
    path.write_text(edited, encoding="utf-8")
    return path


def test_save_and_load_give_the_same_machine(emps_like, tmp_path):
    odd = dataclasses.replace(emps_like, name='a "quoted" name\\', mass_apriori=0.1 + 0.2)
    odd.save(tmp_path / "machine.toml")
    assert Machine.load(tmp_path / "machine.toml") == odd


def test_the_file_says_its_units(emps_like, tmp_path):
    emps_like.save(tmp_path / "machine.toml")
    text = (tmp_path / "machine.toml").read_text(encoding="utf-8")
    for key, unit in (
        ("mass_apriori", "kg"),
        ("kp", "1/s"),
        ("kv", "V s/m"),
        ("gain", "N/V"),
        ("limit", "V"),
        ("resolution", "m per count"),
        ("sample_time", "s"),
        ("screw_lead", "m per motor turn"),
    ):
        assert re.search(rf"^{key} = \S+ +# {unit}", text, flags=re.M), key


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            "^mass_apriori = .*",
            "mass_apriori = -78.0",
            "'mass_apriori' must be greater than 0 [kg, total, rough], not -78.0",
        ),
        ("^gain = .*", "gain = 0.0", "'drive.gain' must be greater than 0 [N/V]"),
        ("^kp = .*", "kp = -1.0", "'controller.kp' must be greater than 0 [1/s]"),
        ("^resolution = .*", "resolution = 0", "'encoder.resolution' must be greater than 0 [m per count]"),
        ("^kv = .*", 'kv = "243.45"', "'controller.kv' must be a valid number [V s/m], not '243.45'"),
        ("^law = .*", 'law = "pid"', "'controller.law' must be 'pd', not 'pid'"),
        ("^velocity = .*", 'velocity = "filtered"', "'controller.velocity' must be 'two-sample'"),
        ("^model = .*", 'model = "stiff"', "'model' must be 'rigid' or 'flexible'"),
        ("^limit = .*", "limits = 10.0", "unknown key 'drive.limits', did you mean 'drive.limit'?"),
        (r"^\[encoder\][^\[]*", "", "missing key 'encoder'"),
    ],
)
def test_an_impossible_machine_is_one_line(emps_like, tmp_path, old, new, line):
    path = _edit(emps_like, tmp_path, old, new)
    with pytest.raises(InputError) as caught:
        Machine.load(path)
    assert line in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_saving_into_a_missing_folder_is_one_line(emps_like, tmp_path):
    with pytest.raises(InputError, match=r"the folder .* does not exist"):
        emps_like.save(tmp_path / "absent" / "machine.toml")


def test_the_shared_machine_file_is_read(emps_dir):
    machine = Machine.load(emps_dir / "machine.toml")
    assert (machine.name, machine.model, machine.mass_apriori) == ("EMPS", "rigid", 78.0)
    assert machine.drive.gain == 35.15065188248547
