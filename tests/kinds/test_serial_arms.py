"""Serial arms by reference: URDF files, robot files with family = "serial", and files with parameters of either."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.problem_files import Context, InputError, explaining
from gtmodel.problem_files.robots import resolve
from tests.robots.arm_oracle import URDF
from tests.robots.test_mjcf_and_sdf import BY_HAND, DEFAULTS

SCARA = """
family = "serial"
title = "a SCARA"
joints = "rrp"
a_m = [0.3, 0.25, 0.0]
alpha_deg = [0, 180, 0]
d_m = [0.4, 0, 0]
m_kg = [5, 4, 1]
c_m = [[-0.15, 0, 0], [-0.1, 0, 0], [0, 0, 0]]
limits = [[-2.9, 2.9], [-2.5, 2.5], [0.0, 0.2]]
"""
HEAVIER = 'robot = "ARM"\n[parameters]\nm = [9.0, 4.0, 1.0]\n'


@pytest.fixture
def context(tmp_path: Path) -> Context:
    """A problem in a folder that holds robot files."""
    for file in URDF.glob("*.urdf"):
        shutil.copy(file, tmp_path)
    (tmp_path / "scara.toml").write_text(SCARA)
    (tmp_path / "heavier.toml").write_text(HEAVIER.replace("ARM", "scara.toml"))
    (tmp_path / "heavy.toml").write_text(HEAVIER.replace("ARM", "parallel.urdf"))
    return Context(folder=tmp_path)


def test_a_urdf_is_a_robot(context: Context) -> None:
    by_file = resolve("serial.urdf", context)
    direct = gt.robots.from_urdf(URDF / "serial.urdf")
    q = np.array([0.1, -0.4, 0.9, 2.0, 0.3, -1.0])
    for x, y in zip(*(arm.causal(known="q", targets=["T", "R"])(q) for arm in (by_file, direct)), strict=True):
        np.testing.assert_array_equal(x, y)
    assert context.inputs["robot"].name == "serial.urdf"
    assert context.notes[0].startswith("serial.urdf: not used: 1 transmissions")


def test_sdf_and_mjcf_are_robots_too(context: Context) -> None:
    (context.folder / "arm.xml").write_text(DEFAULTS)
    (context.folder / "arm.sdf").write_text(BY_HAND)
    for name, direct in (("arm.xml", gt.robots.from_mjcf(DEFAULTS)), ("arm.sdf", gt.robots.from_sdf(BY_HAND))):
        q = 0.1 * np.arange(1, 1 + len(direct.structure.leaders))
        (T, *_), (expected, *_) = (a.causal(known="q", targets=["T", "R"])(q) for a in (resolve(name, context), direct))
        np.testing.assert_array_equal(T, expected)
    assert resolve("arm.xml:two", context).structure.tool == "two"
    assert resolve("arm.sdf:upper", context).structure.tool == "upper"
    assert "q[0]  j1" in explaining.of(str(context.folder / "arm.xml"))
    (context.folder / "rough.toml").write_text('robot = "arm.xml"\n[parameters]\ncoulomb = [1, 2, 3, 4, 5]\n')
    assert list(resolve("rough.toml", context).coulomb) == [1.0, 2.0, 3.0, 4.0, 5.0]
    with pytest.raises(InputError, match=r"^robot: there is no MJCF file 'no.xml'"):
        resolve("no.xml", context)
    (context.folder / "wrong.sdf").write_text(BY_HAND.replace("prismatic", "ball"))
    with pytest.raises(InputError, match=r"^robot: wrong.sdf, line 6: joint 'elbow' is ball"):
        resolve("wrong.sdf", context)


def test_its_tip_stands_behind_a_colon(context: Context) -> None:
    assert resolve("telescope.urdf:hand", context).structure.tool == "hand"
    assert len(context.notes) == 2
    with pytest.raises(InputError, match=r"^robot: telescope.urdf has several ends"):
        resolve("telescope.urdf", context)
    with pytest.raises(InputError, match=r"^robot: telescope.urdf has no link 'hnad'; did you mean 'hand'\?"):
        resolve("telescope.urdf:hnad", context)
    with pytest.raises(InputError, match=r"^robot: there is no URDF file 'no.urdf'"):
        resolve("no.urdf", context)


def test_options_of_the_catalogue_hold_for_arms(context: Context) -> None:
    plain, loaded = (resolve("parallel.urdf", context, payload=p) for p in (None, 2.0))
    assert loaded.m[-1] == pytest.approx(plain.m[-1] + 2.0)
    assert resolve("parallel.urdf", context, smoothing="sign", velocity_scale=0.3).velocity_scale == 0.3
    with pytest.raises(InputError, match=r"^inertia: applies to three-link robots only"):
        resolve("parallel.urdf", context, inertia="model_1")
    with pytest.raises(InputError, match=r"^inertia: inertia model 'model_1' applies to three-link robots only"):
        resolve("scara.toml", context, inertia="model_1")
    with pytest.raises(InputError, match=r"^parameters: .* has no declaration 'mm'"):
        resolve("parallel.urdf", context, parameters={"mm": 1.0})


def test_a_robot_file_of_dh_numbers(context: Context) -> None:
    arm = resolve("scara.toml", context)
    T, status = arm.causal(known="q", targets="T")([0.0, np.pi / 2, 0.1])
    assert status is gt.Status.OK
    np.testing.assert_allclose(T, [0.3, 0.25, 0.3], atol=1e-12)
    np.testing.assert_allclose(arm.mc, [[-0.75, 0, 0], [-0.4, 0, 0], [0, 0, 0]])
    np.testing.assert_allclose(arm.joint_limits, [[-2.9, 2.9], [-2.5, 2.5], [0.0, 0.2]])


@pytest.mark.parametrize(("name", "base"), [("heavier.toml", "scara.toml"), ("heavy.toml", "parallel.urdf")])
def test_a_file_may_give_parameters_of_another(context: Context, name: str, base: str) -> None:
    arm = resolve(name, context)
    np.testing.assert_allclose(arm.m, [9.0, 4.0, 1.0])
    np.testing.assert_allclose(arm.mc, resolve(base, context).mc)
    assert resolve(name, context, payload=1.5).m[-1] == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("0.3, 0.25", "300, 250", r"a_m: lengths up to 300 m look like millimetres"),
        ('"rrp"', '"rr"', r"joints takes one of r, p for each of the 3 joints"),
        ("limits =", "limits_deg =", r"limits_deg: needs revolute joints only"),
        ("a_m", "a_n", r"a_n: .*a_m"),
        ("alpha_deg = [0, 180, 0]", "alpha_deg = [0, 180]", r"'alpha' has 2 numbers; expected 3"),
    ],
)
def test_what_is_wrong_in_it_is_said(context: Context, old: str, new: str, sentence: str) -> None:
    (context.folder / "wrong.toml").write_text(SCARA.replace(old, new))
    with pytest.raises(InputError, match=sentence):
        resolve("wrong.toml", context)


def test_explain_shows_an_arm(context: Context) -> None:
    text = explaining.of(str(context.folder / "telescope.urdf:tool_point"))
    lines = text.splitlines()
    assert lines[0] == "telescope: q (4), from floor to tool_point"
    assert " ".join(lines[3].split()) == "q[2] extend_1 prismatic 0 to 600 mm 300 mm/s 800 N moves stage_1, 9 kg"
    assert "0.8 q[2] +0.05" in lines[4] and "joint 'grip' is not on the chain" in lines[-2]
    assert "SerialArm: T from q" in explaining.of(str(context.folder / "scara.toml"), ["q"], ["T"])
