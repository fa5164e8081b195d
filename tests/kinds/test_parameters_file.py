"""parameters.toml as people hand it on: a unit that slipped, a file that names itself, the same numbers again."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from gtmodel import robots
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.robots import resolve
from gtmodel.robots.plausible_lengths import implausible_model

L1: dict[str, Any] = {
    "A_m": [[0.04, 0.01, 1.44], [0.25, -1.31, 1.46], [0.0, 0.0, 0.0]], "v": [[1.0, 0.0, 0.0]] * 3,
    "L_m": [2.05, 1.82, 1.81], "home_m": [1.4, -0.4, 0.9],
}  # fmt: skip
ARM = tomllib.loads(
    (Path(__file__).parents[2] / "problems" / "models" / "six_axis_arm.toml").read_text(encoding="utf-8")
)


def read(folder: Path, table: dict[str, Any], **more: Any) -> Any:
    (folder / "own.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
    return resolve("own.toml", Context(folder=folder), **more)


def d1(**more: Any) -> dict[str, Any]:
    model = robots.make("d1_six_link")
    names = {"A_m": "A", "v": "v", "L_m": "L", "B_m": "B", "home_m": "home"}
    return {"family": "six_link"} | {key: np.array(getattr(model, n)).tolist() for key, n in names.items()} | more


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (L1 | {"home_m": [1400.0, -400.0, 900.0]}, r"home_m: is .* m away from guideway \d"),
        (d1(c_p_m=[10.0, 20.0, 30.0]), "c_p_m: the plate's centre of mass is 37.4166 m from T"),
        (ARM | {"alpha_deg": np.radians(ARM["alpha_deg"]).tolist()}, "alpha_deg: .* look like radians"),
        ({k: v for k, v in ARM.items() if k != "limits_deg"} | {"limits": [[-180.0, 180.0]] * 6},
         "limits: .* look like degrees"),
        (ARM | {"theta_deg": [1e308] + [0.0] * 5}, "theta_deg: angles up to 1e[+]308 deg are more than four turns"),
    ],
)  # fmt: skip
def test_a_slip_of_unit_is_named(tmp_path: Path, table: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        read(tmp_path, table)


def test_parameters_of_a_problem_are_looked_at_as_those_of_a_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"parameters\.L: link lengths from 1810 to 2050 m look like millimetres"):
        read(tmp_path, L1, parameters={"L": [2050.0, 1820.0, 1810.0]})
    with pytest.raises(InputError, match=r"parameters\.home: is .* away from guideway"):
        resolve("f1", Context(folder=tmp_path), parameters={"home": [1000.0, 2000.0, 0.0]})
    assert read(tmp_path, L1, parameters={"L": [2.04, 1.82, 1.81]}).L[0] == 2.04


def test_no_robot_of_the_catalogue_is_implausible() -> None:
    carried = [name for name, entry in robots.entries().items() if entry.family != "serial"]
    assert {name: implausible_model(robots.make(name)) for name in carried} == dict.fromkeys(carried)


def test_a_file_that_names_itself_is_refused(tmp_path: Path) -> None:
    (tmp_path / "other.toml").write_text('robot = "own.toml"\n')
    for named in ("own.toml", "other.toml"):
        with pytest.raises(InputError, match=r"'own\.toml' names itself as robot"):
            read(tmp_path, {"robot": named})
