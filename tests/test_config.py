"""Every mistake in a TOML file is one line that names the file, the key and what is expected there."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from pydantic import Field
from pydantic.dataclasses import dataclass

from didim_jax.config import CONFIG, build, load_toml
from didim_jax.errors import InputError


@dataclass(frozen=True, config=CONFIG)
class Filter:
    cutoff: float = Field(gt=0, description="Hz, low-pass")
    decimation: int = Field(10, ge=1)


@dataclass(frozen=True, config=CONFIG)
class Study:
    seed: int
    filter: Filter
    steps: int = 30
    scales: tuple[float, ...] = (1.0,)
    width: float = dataclasses.field(default=1.0, metadata={"unit": "m/s"})
    folder: Path | None = None
    others: tuple[Filter, ...] = ()


@dataclass(frozen=True)
class Lax:
    """A class whose author forgot to forbid unknown keys."""

    seed: int = 0


def _load(tmp_path, text, cls=Study):
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    return load_toml(path, cls)


def test_a_right_file_gives_the_values(tmp_path):
    study = _load(tmp_path, 'seed = 1\nscales = [1, 2.5]\nfolder = "runs"\n[filter]\ncutoff = 60\n')
    assert study == Study(seed=1, filter=Filter(cutoff=60.0), scales=(1.0, 2.5), folder=Path("runs"))
    assert isinstance(study.filter.cutoff, float)
    with pytest.raises(dataclasses.FrozenInstanceError):
        study.seed = 2


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("seed = 1\nsteeps = 3\n[filter]\ncutoff = 60.0", "unknown key 'steeps', did you mean 'steps'?"),
        ("seed = 1\n[filter]\ncutof = 60.0", "unknown key 'filter.cutof', did you mean 'filter.cutoff'?"),
        ("seed = 1\ncutoff = 60.0\n[filter]\n", "unknown key 'cutoff', did you mean 'filter.cutoff'?"),
        ("seed = 1\n[filter]\ncutoff = 60.0\nzzz = 1", "unknown key 'filter.zzz', known here: cutoff, decimation"),
        ("seed = 1\n[filter]\ndecimation = 2", "missing key 'filter.cutoff' [Hz, low-pass]"),
        ("[filter]\ncutoff = 60.0", "missing key 'seed'"),
        ("seed = 1\n[filter]\ncutoff = -3.0", "'filter.cutoff' must be greater than 0 [Hz, low-pass], not -3.0"),
        ("seed = 1\n[filter]\ncutoff = nan", "'filter.cutoff' must be a finite number [Hz, low-pass], not nan"),
        ("seed = 1\n[filter]\ncutoff = inf", "'filter.cutoff' must be a finite number [Hz, low-pass], not inf"),
        ('seed = 1\n[filter]\ncutoff = "60"', "'filter.cutoff' must be a valid number [Hz, low-pass], not '60'"),
        ("seed = 1.5\n[filter]\ncutoff = 60.0", "'seed' must be a valid integer"),
        ("seed = true\n[filter]\ncutoff = 60.0", "'seed' must be a valid integer, not True"),
        ('seed = 1\nwidth = "wide"\n[filter]\ncutoff = 1.0', "'width' must be a valid number [m/s], not 'wide'"),
        ('seed = 1\nscales = [1.0, "b"]\n[filter]\ncutoff = 1.0', "'scales[1]' must be a valid number, not 'b'"),
        ("seed = 1\nfilter = 3", "'filter' must be a table of keys, not 3"),
        (
            "seed = 1\n[filter]\ncutoff = 1.0\n[[others]]\ncutof = 2.0",
            "unknown key 'others[0].cutof', did you mean 'others[0].cutoff'?",
        ),
        ("seed = \n", "not valid TOML: Invalid value (at line 1, column 8)"),
    ],
)
def test_a_mistake_is_one_line_with_file_and_key(tmp_path, text, line):
    with pytest.raises(InputError) as caught:
        _load(tmp_path, text)
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'study.toml'}: ")
    assert line in message
    assert "\n" not in message


def test_other_mistakes_of_the_file_are_named_and_not_twice(tmp_path):
    with pytest.raises(InputError) as caught:
        _load(tmp_path, "[filter]\ncutof = -1.0\ndecimation = 0")
    assert str(caught.value).endswith(
        "unknown key 'filter.cutof', did you mean 'filter.cutoff'? (also wrong or missing: 'seed', 'filter.decimation')"
    )


def test_an_unknown_key_is_an_error_even_where_the_class_does_not_forbid_it(tmp_path):
    with pytest.raises(InputError, match="unknown key 'sead', did you mean 'seed'"):
        _load(tmp_path, "sead = 1", Lax)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match=r"absent\.toml: no such file"):
        load_toml(tmp_path / "absent.toml", Study)
    with pytest.raises(InputError, match="is a folder"):
        load_toml(tmp_path, Study)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(InputError, match="not a text file"):
        load_toml(tmp_path / "binary.toml", Study)


def test_a_mapping_is_judged_as_a_file_is():
    assert build(Filter, {"cutoff": np.float64(5.0), "decimation": np.int64(2)}, "here") == Filter(5.0, 2)
    with pytest.raises(InputError, match=r"^sweep, point 3: 'decimation' must be greater than or equal to 1, not 0"):
        build(Filter, {"cutoff": 5.0, "decimation": 0}, "sweep, point 3")
