"""A plant file gives the plant whose parameters it names, or one line that says what is wrong with which."""

import pytest

from didim_jax.errors import InputError
from didim_jax.params import values
from didim_jax.plant import AsymmetricCoulombViscous, CoulombViscous, FlexibleDrive, RigidDrive
from didim_jax.plant_file import load_plant

FLEXIBLE = {"M1": 68.0, "Fv1": 104.0, "Fc1": 10.0, "M2": 38.0, "Fv2": 96.5, "Fc2": 9.5, "K12": 8.8e5}


def write(folder, model, parameters, head=""):
    path = folder / "plant.toml"
    lines = "\n".join(f"{name} = {value}" for name, value in parameters.items())
    path.write_text(f'model = "{model}"\n{head}\n[parameters]\n{lines}\n')
    return path


def test_every_parameter_arrives_where_its_name_says(tmp_path):
    plant = load_plant(write(tmp_path, "flexible", FLEXIBLE))
    assert isinstance(plant, FlexibleDrive)
    assert values(plant) == FLEXIBLE | {"offset": 0.0}


def test_an_offset_may_be_given_and_may_be_negative(tmp_path):
    plant = load_plant(write(tmp_path, "rigid", {"M": 95.1, "Fv": 203.5, "Fc": 20.4, "offset": -3.2}))
    assert isinstance(plant, RigidDrive)
    assert values(plant) == {"M": 95.1, "Fv": 203.5, "Fc": 20.4, "offset": -3.2}


def test_each_side_has_the_friction_law_of_its_names(tmp_path):
    load_side = {"Fv2_pos": 90.0, "Fc2_pos": 9.0, "Fv2_neg": 110.0, "Fc2_neg": 11.0}
    parameters = {name: v for name, v in FLEXIBLE.items() if name not in ("Fv2", "Fc2")} | load_side
    plant = load_plant(write(tmp_path, "flexible", parameters, head="v_eps = 2e-3"))
    assert isinstance(plant.motor_friction, CoulombViscous)
    assert isinstance(plant.load_friction, AsymmetricCoulombViscous)
    assert values(plant) == parameters | {"offset": 0.0}
    assert float(plant.load_friction.v_eps) == float(plant.motor_friction.v_eps) == 2e-3


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"M2": None}, ["missing", "'parameters.M2'", "[kg]"]),
        ({"K12": None}, ["missing", "'parameters.K12'", "[N/m]"]),
        ({"K_12": 1.0}, ["unknown", "'parameters.K_12'", "'K12'"]),
        ({"zeta": 1.0}, ["unknown", "'parameters.zeta'", "M1, Fv1"]),
        ({"M1": -68.0}, ["'parameters.M1'", "[kg]", "-68"]),
        ({"M1": 0.0}, ["'parameters.M1'", "greater than 0"]),
        ({"Fv1": -1.0}, ["'parameters.Fv1'", "[N s/m]", "negative"]),
        ({"M1": "true"}, ["parameters.M1"]),
        ({"Fv1_pos": 1.0}, ["unknown", "'parameters.Fv1'"]),  # half one law, half the other
    ],
)
def test_a_wrong_parameter_is_one_line_with_its_unit(tmp_path, changed, said):
    parameters = {name: v for name, v in (FLEXIBLE | changed).items() if v is not None}
    with pytest.raises(InputError) as caught:
        load_plant(write(tmp_path, "flexible", parameters))
    message = str(caught.value)
    assert "\n" not in message
    for words in ("plant.toml", *said):
        assert words in message


def test_no_friction_at_all_is_a_plant_too(tmp_path):
    plant = load_plant(write(tmp_path, "rigid", {"M": 100.0, "Fv": 0.0, "Fc": 0.0}))
    assert values(plant)["Fv"] == 0.0


def test_an_unknown_model_is_refused(tmp_path):
    with pytest.raises(InputError, match="model"):
        load_plant(write(tmp_path, "elastic", FLEXIBLE))
