"""Robots by reference: the catalogue, a robot file, a model in Python."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import motion
from gtmodel.lang.source import of_frame
from gtmodel.problem_files import Context, InputError, explaining
from gtmodel.problem_files.python_models import sentence_of
from gtmodel.problem_files.robots import resolve
from tests.support.own_models import FILES

Q = np.array([0.3, 0.4, 0.5])

ROBOT = """
title = "a copy of l1_tape"
A_m = [[0.04, 0.0, 1.44], [0.25, -1.31, 1.46], [0.0, 0.0, 0.0]]
v = [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
L_m = [2.05, 1.82, 1.81]
"""


MAKERS = """
from pendulum import Pendulum
long = Pendulum(L=2.0)
three = 3
def make(L):
    return Pendulum(L=L)
"""


@pytest.fixture
def context(tmp_path: Path) -> Context:
    """A problem in a folder that holds a robot file and a model."""
    (tmp_path / "copy.toml").write_text(ROBOT)
    (tmp_path / "heavy.toml").write_text(ROBOT + "m_p_kg = 20.0\n")
    (tmp_path / "pendulum.py").write_text(FILES["pendulum.py"])
    (tmp_path / "makers.py").write_text(MAKERS)
    return Context(folder=tmp_path)


def test_robot_file_equals_the_catalogue_entry_it_copies(context: Context) -> None:
    mine, printed = (resolve(name, context).causal(known="q", targets="T") for name in ("copy.toml", "l1_tape"))
    assert np.array_equal(mine(Q)[0], printed(Q)[0])
    assert context.inputs["robot"].name == "copy.toml"


def test_payload_is_added_to_the_plate(context: Context) -> None:
    plain, loaded, heavy = (
        resolve(name, context, payload=payload)
        for name, payload in (("l1_tape", None), ("l1_tape", 2.0), ("heavy.toml", 2.0))
    )
    assert loaded.m_p == pytest.approx(plain.m_p + 2.0)
    assert heavy.m_p == pytest.approx(22.0)


@pytest.mark.parametrize("reference", ["l1_tape", "heavy.toml", "d1_six_link", "f1"])
def test_payload_is_added_to_a_plate_mass_of_the_problem_too(context: Context, reference: str) -> None:
    """It was dropped beside m_p, and with it the tool of an elastic motion and the weight of one kilogram more."""
    robot = resolve(reference, context, parameters={"m_p": 30.0}, payload=5.0)
    assert robot.m_p == pytest.approx(35.0)


@pytest.mark.parametrize(
    ("parameters", "options", "sentence"),
    [
        ({"payload": -3.0}, {}, "parameters.payload: is not a parameter of a robot; use the key payload_kg"),
        ({"inertia": "model_1"}, {}, "parameters.inertia: is not a parameter of a robot; use the key inertia"),
        ({"name": "d1_nominal"}, {}, "parameters.name: is not a parameter of a robot; use the key robot"),
        ({"family": "f1"}, {}, "parameters.family: is not a parameter of a robot; use the key robot"),
        (
            {"velocity_scale": 0.3},
            {"velocity_scale": 0.1},
            "parameters.velocity_scale: is set by friction.velocity_scale_m_s too; leave one of the two out",
        ),
    ],
)
@pytest.mark.parametrize("reference", ["l1_tape", "copy.toml"])
def test_options_are_no_parameters(
    context: Context, reference: str, parameters: dict[str, Any], options: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(InputError) as caught:
        resolve(reference, context, parameters=parameters, **options)
    assert str(caught.value) == sentence


@pytest.mark.parametrize("reference", ["pendulum.py:Pendulum", "pendulum:Pendulum", "makers.py:make", "makers.py:long"])
def test_models_in_python_take_parameters(context: Context, reference: str) -> None:
    model = resolve(reference, context, parameters={"L": 3.0})
    assert isinstance(model, gt.Model) and model.L == 3.0


@pytest.mark.parametrize(
    ("reference", "sentence"),
    [
        ("l1_tap", "robot: there is no robot 'l1_tap'; did you mean 'l1_tape'?"),
        ("nowhere.toml", "robot: there is no robot file 'nowhere.toml'"),
        ("pendulum.py", "for a model in Python name its class too, as in 'pendulum.py:Robot'"),
        ("pendulum", "robot: there is no robot 'pendulum'; there are d1_nominal"),
        ("makers.py:three", "robot: 'makers.py:three' is int; expected a Model"),
        ("makers.py:thre", "robot: 'makers.py' has no 'thre'"),
        ("pendulum.py:", "names no class"),
        (":Pendulum", "names no class"),
        ("os:system", "robot: 'os:system' is builtin_function_or_method; expected a Model"),
        ("shutil:rmtree", "robot: 'shutil:rmtree' is function; expected a Model"),
        ("functools:partial", "robot: 'functools:partial' is not a subclass of Model"),
    ],
)
def test_wrong_references_are_sentences(context: Context, reference: str, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        resolve(reference, context)
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("L_mm = [1.0, 1.0, 1.0]", "copy.toml: L_mm: unknown key; did you mean 'L_m' (m)?"),
        ("m_p_kg = -1.0", "copy.toml: m_p_kg: must be greater than 0 kg; found -1.0"),
        ("m_c_kg = [1.0]", "copy.toml: m_c_kg: expected a list of 3 numbers > 0 in kg; found [1.0]"),
    ],
)
def test_faults_of_a_robot_file_name_both_files(context: Context, line: str, sentence: str) -> None:
    (context.folder / "copy.toml").write_text(ROBOT + line)
    with pytest.raises(InputError) as caught:
        resolve("copy.toml", context)
    assert str(caught.value) == f"robot: {sentence} (line 6)"


def test_catalogue_options_do_not_apply_to_a_model_in_python(context: Context) -> None:
    with pytest.raises(InputError, match=r"^inertia: applies to robots of the catalogue"):
        resolve("pendulum.py:Pendulum", context, inertia="model_1")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("def (", r"'faulty\.py' is not Python: .*faulty\.py:2\)$"),
        ("import nonsense_module", r"'faulty\.py' cannot be used: ModuleNotFoundError: .*faulty\.py:2\)$"),
        ("1 / 0", r"'faulty\.py' cannot be used: ZeroDivisionError: .*faulty\.py:2\)$"),
        ("class A(gt.Model):\n  x = gt.variable(unit='parsec')", r"unknown symbol 'parsec'.*faulty\.py:3\)$"),
    ],
)
def test_faults_while_importing_name_the_line(context: Context, text: str, sentence: str) -> None:
    (context.folder / "faulty.py").write_text(f"import gtmodel as gt\n{text}\n")
    with pytest.raises(InputError, match=sentence):
        resolve("faulty.py:A", context)


def test_two_files_of_one_name_are_two_models(tmp_path: Path) -> None:
    found = []
    for folder, length in (("a", "0.6"), ("b", "0.7")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "pendulum.py").write_text(FILES["pendulum.py"].replace("0.5", length))
        there = Context(folder=tmp_path / folder)
        found += [resolve(name, there).L for name in ("pendulum.py:Pendulum", "pendulum:Pendulum")]
    assert found == [0.6, 0.6, 0.7, 0.7]


def test_a_loaded_package_is_not_taken_for_a_persons_file(context: Context) -> None:
    (context.folder / "numpy.py").write_text("A = 1\n")
    with pytest.raises(InputError, match="'numpy' is the name of an installed package; rename your file"):
        resolve("numpy:A", context)
    assert resolve("gtmodel.robots.catalogue:gantry_tau", context, parameters={"name": "l1_tape"}).L[0] == 2.05


def test_names_are_split_outside_parentheses() -> None:
    assert explaining.split(["T, der(T,2)", "arm[0].rod.tension,,der(der(q, 1))"]) == [
        "T",
        "der(T,2)",
        "arm[0].rod.tension",
        "der(der(q, 1))",
    ]
    assert explaining.split([]) == []


def test_a_person_who_wrote_a_file_hears_of_no_place_in_gtmodel(context: Context) -> None:
    for parameters in ({"m_p": -1.0}, {"m_q": 1.0}, {"L": [1.0, 2.0]}):
        with pytest.raises(InputError) as caught:
            resolve("l1_tape", context, parameters=parameters)
        assert caught.value.key == "parameters" and ".py:" not in caught.value.message


def test_a_place_is_told_where_it_is_in_a_persons_file() -> None:
    class Own(gt.Model):
        L = gt.parameter(1.0, positive=True)

    with pytest.raises(gt.ModelError) as caught:
        Own(L=-1.0)
    own = caught.value
    assert own.where is not None and not own.where.ours and "test_robots.py" in sentence_of(own)

    ours = gt.ModelError("is wrong", of_frame(motion.task.__file__, 3))
    assert ours.where is not None and ours.where.ours and str(ours) == "is wrong (motion/task.py:3)"
    assert sentence_of(ours) == "is wrong"
