"""An arm with joints that turn and joints that slide, identified by a log with a unit for each column."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.robots import resolve
from gtmodel.problem_files.run import answer
from tests.calibrate.test_arm_full_poses import SCARA

NOISE = (0.5, 0.3, 2.0, 0.05)  # N.m, N.m, N, N.m
VISCOUS, COULOMB = np.array([2.0, 1.0, 30.0, 0.1]), np.array([3.0, 2.0, 15.0, 0.3])
PROBLEM = """kind = "identification"
robot = "scara.toml"
free = ["viscous", "coulomb"]
inertias = "base"
nonnegative = ["viscous", "coulomb"]
[log]
files = ["log.csv"]
position = { column = "q", unit = ["deg", "deg", "mm", "deg"] }
effort = { column = "tau", unit = ["N.m", "N.m", "kN", "N.m"] }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scara")
    (path / "scara.toml").write_text(SCARA)
    (path / "p.toml").write_text(PROBLEM)
    arm = resolve("scara.toml", Context(folder=path), smoothing="sign")
    true = arm.with_(
        m=[8.0, 5.0, 2.0, 1.0], mc=[[-1.2, 0, 0], [-0.6, 0, 0], [0, 0, 0.1], [0.02, 0, 0]],
        J=np.tile([0.1, 0, 0, 0.2, 0, 0.3], (4, 1)), viscous=VISCOUS, coulomb=COULOMB,
    )  # fmt: skip
    t = 0.004 * np.arange(5000)
    reach = np.array([1.0, 1.0, 0.08, 1.5])
    q = gt.identify.multisine(t, np.array([0, 0, 0.1, 0]), reach, np.array([0.2, 0.5, 1.1]), seed=3)
    log = gt.identify.LogSimulator(true, q).draw(2, gt.identify.Sensors(effort_noise=NOISE))
    per_si = np.array([180 / np.pi, 180 / np.pi, 1e3, 180 / np.pi])
    rows = np.column_stack([t, per_si * log["q"], log["tau"] * [1, 1, 1e-3, 1]])
    names = ["time", *(f"q[{k}]" for k in range(4)), *(f"tau[{k}]" for k in range(4))]
    header = f"# synthetic: seed 2\n{','.join(names)}"
    path.joinpath("log.csv").write_text("\n".join([header, *(",".join(f"{x:.9g}" for x in r) for r in rows)]) + "\n")
    return path


def solved(folder: Path, *settings: str) -> Any:
    return answer(load(folder / "p.toml", list(settings)), Context(folder=folder))


def test_friction_and_masses_are_found_with_the_unit_of_each_joint(folder: Path) -> None:
    study = solved(folder)
    assert study.status.ok, study.message
    for name, true in (("viscous", VISCOUS), ("coulomb", COULOMB)):
        for k in range(4):
            low, high = study.estimate.interval(f"{name}[{k}]", 0.999)
            assert low < true[k] < high
    units = {name: study.units[name] for name in ("viscous[1]", "viscous[2]", "coulomb[2]", "coulomb[3]")}
    assert units == {"viscous[1]": "N.m.s/rad", "viscous[2]": "kg/s", "coulomb[2]": "N", "coulomb[3]": "N.m"}
    assert study.estimate.value("m[2] + m[3]") == pytest.approx(3.0, abs=0.03)
    noise = {row.label: row.unit for row in study.rows if row.label.startswith("noise")}
    assert list(noise.values()) == ["N.m", "N.m", "N", "N.m"]
    study.figure("efforts")


@pytest.mark.parametrize(
    ("setting", "key", "part"),
    [
        ('log.position.unit=["deg", "mm"]', "log", "has 2 units for 4 columns"),
        ('log.position.unit=["deg", "deg", "mn", "deg"]', "log.position", "mn"),
        ('log.effort.unit=[]', "log.effort", "no unit"),
    ],
)  # fmt: skip
def test_wrong_units(folder: Path, setting: str, key: str, part: str) -> None:
    with pytest.raises(InputError) as caught:
        solved(folder, setting)
    assert caught.value.key == key and part in caught.value.message
