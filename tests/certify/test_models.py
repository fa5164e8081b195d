"""Certificates of models from other doors: Modelica text, a serial arm from a URDF file, and the declared problems."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, context_of

PROBLEMS = Path(__file__).parents[2] / "problems"
BOX = [[0.0, 0.8], [-1.1, -0.7], [0.05, 0.55]]  # m


def run(path: Path):
    """The study of a problem file."""
    loaded = load(path)
    return answer(loaded, context_of(loaded))


def test_modelica_text_gives_the_certificate_of_the_model_in_python():
    text = gt.modelica.load(f"{PROBLEMS / 'models' / 'gantry_tau.mop'}:Robot")()
    T, q = ([f"{n}[{i}]" for i in (1, 2, 3)] for n in "Tq")
    s = gt.certify.study(text.causal(known=T, targets=q), {n: [x] for n, x in zip(T, BOX, strict=True)}, regular=True)
    same = gt.certify.study(gt.robots.gantry_tau("l1_tape").causal(known="T", targets="q"), {"T": BOX}, regular=True)
    assert s.status.ok and s.proved == 1.0
    assert s.least_singular_value == pytest.approx(same.least_singular_value, rel=0.2)
    for (a, b), (c, d) in zip(s.ranges.values(), same.ranges.values(), strict=True):
        assert abs(a - c) < 0.05 and abs(b - d) < 0.05  # m: the operations differ


def test_a_serial_arm_from_a_file(tmp_path):
    """A box of joint angles far from its singular poses, and one across the wrist's."""
    robot = PROBLEMS / "models" / "ur_like.urdf"
    lines = ['kind = "certificate"', f'robot = "{robot}"', 'known = ["q"]', 'targets = ["T", "R"]', "regular = true",
             "max_boxes = 2000", "[box]"]  # fmt: skip
    middle = np.array([0.3, -1.2, 1.4, 0.4, 1.2, 0.1])
    path = tmp_path / "arm.toml"
    for fifth, good in ((1.2, True), (0.0, False)):
        middle[4] = fifth
        path.write_text("\n".join([*lines, f"q = {np.stack([middle - 0.03, middle + 0.03], axis=1).tolist()}"]))
        s = run(path)
        assert s.status.ok == good and (s.proved == 1.0) == good
    assert "Jacobian" in s.message


def test_inverse_kinematics_of_an_arm_in_closed_form():
    """The KR 500 with its tool down: exact joint angles of random points lie in the ranges."""
    arm = gt.robots.kr500()
    ik, fk = arm.causal(known=["T", "R"], targets="q"), arm.causal(known="q", targets=["T", "R"])
    T, R, _ = fk(np.radians([0.0, -60.0, 110.0, 0.0, 40.0, 0.0]))
    s = gt.certify.study(ik, {"T": [[x - 0.1, x + 0.1] for x in T.tolist()], "R": [[x, x] for x in R.ravel().tolist()]})
    assert s.status.ok and s.proved == 1.0 and s.errors["q[1]"] < 1e-13
    assert s.errors["q[5]"] > 6.0  # its cut at half a turn lies inside: round-off decides the side
    x = T + np.random.default_rng(1).uniform(-0.1, 0.1, (200, 3))
    q, status = ik(x, np.broadcast_to(R, (200, 3, 3)))
    low, high = np.array(list(s.ranges.values())).T
    assert not status.any() and np.all((q >= low) & (q <= high))


@pytest.mark.parametrize("name", ["d1", "kr500", pytest.param("f1", marks=pytest.mark.proof)])
def test_the_declared_problems_are_proved(name):
    s = run(PROBLEMS / f"certificate_{name}.toml")
    assert s.status.ok and s.proved == 1.0 and s.least_singular_value > {"d1": 0.15, "kr500": 0.05, "f1": 0.002}[name]
    assert name != "d1" or (s.steps == 4 and s.boxes < 100 and max(s.errors.values()) < 2e-13)


def test_the_inverse_kinematics_of_the_f1_in_five_degrees_of_freedom():
    """0.6 x 0.6 x 0.6 m and 45 degrees to both sides, without its singularities."""
    f = gt.robots.f1_five_dof().causal(known=["T", "angles"], targets="q")
    box = {"T": [[-0.5, 0.1], [2.0, 2.6], [-0.3, 0.3]], "angles": [[-0.785, 0.785]]}
    s = gt.certify.study(f, box)
    assert s.proved == 1.0 and s.boxes < 100 and max(s.errors.values()) < 1e-13
    x = np.random.default_rng(2).uniform(*np.array([*box["T"], *2 * box["angles"]]).T, (500, 5))
    q, status = f(x[:, :3], x[:, 3:])
    low, high = np.array(list(s.ranges.values())).T
    assert not status.any() and np.all((q >= low - 1e-12) & (q <= high + 1e-12))
