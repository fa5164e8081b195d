"""Values of physical parameters that make no sense are refused where they are given, in mechanics and robots."""

from __future__ import annotations

import inspect
import re

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import mechanics, robots
from gtmodel.compiler.causal import flat_of
from gtmodel.geometry.rotations import rotation_about
from gtmodel.lang.declarations import Parameter
from gtmodel.lang.values import check_parameter
from gtmodel.mechanics import LinkBody
from gtmodel.robots import cart, f1_geometry, inverse_model, six_link, three_link, with_wrist

MODULES = (mechanics, robots, cart, inverse_model, f1_geometry, six_link, three_link, with_wrist)
MODELS = {
    cls.__name__: cls
    for module in MODULES
    for cls in vars(module).values()
    if inspect.isclass(cls) and issubclass(cls, gt.Model) and cls.__module__.startswith("gtmodel.")
}
PARAMETERS = {
    f"{name}.{key}": item
    for name, cls in sorted(MODELS.items())
    for key, item in cls._declared.items()
    if isinstance(item, Parameter)
}
# units in which a passive part has no negative number
MAGNITUDES = {"kg", "kg.m2", "kg/s", "N.s/m", "N.m.s/rad", "N/m", "N.m/rad", "N", "N.m"}
DIRECTIONS = re.compile(r"\b(axis|axes|direction|normal|quaternion|motion per q)\b")


def of_shape(item: Parameter, fill: float) -> np.ndarray:
    return np.full(tuple(4 if n == -1 else n for n in item.shape), fill)


def refused(item: Parameter, value: np.ndarray) -> bool:
    named = {b.name: np.array(0.0) for b in (item.low, item.high) if isinstance(b, Parameter)}
    try:
        check_parameter(item, value, item.name, others=named)
    except gt.ModelError as error:
        assert f"parameter '{item.name}'" in str(error) and "; found" in str(error)
        return True
    return False


@pytest.mark.parametrize("item", PARAMETERS.values(), ids=list(PARAMETERS))
def test_nonsense_is_refused(item: Parameter) -> None:
    if item.unit in MAGNITUDES and not any(item is own for own in LinkBody._declared.values()):
        # identified numbers of a LinkBody scatter; `identify.consistent_inertias` gives bodies that can exist
        wrong = -np.eye(3) if item.shape == (3, 3) else of_shape(item, -1.0)
        assert refused(item, wrong) and (item.shape == (3, 3) or not refused(item, -wrong))
    if item.unit == "1" and "rotation" in item.description:
        assert refused(item, 2 * np.eye(3)) and refused(item, np.diag([1.0, 1.0, -1.0]))
        assert not refused(item, rotation_about(np.array([0.6, 0.0, 0.8]), 0.7))
    elif item.unit == "1" and DIRECTIONS.search(item.description):
        assert refused(item, of_shape(item, 0.0))


def test_every_default_and_shipped_robot_is_accepted() -> None:
    given = {name: item.default for name, item in PARAMETERS.items() if item.default is not None}
    assert given and [name for name, value in given.items() if refused(PARAMETERS[name], value)] == []
    assert [name for name in robots.names() if not flat_of(robots.make(name)).equations] == []


def turned(digits: int) -> np.ndarray:
    return np.round(rotation_about(np.array([0.48, -0.6, 0.64]), 0.9), digits)


@pytest.mark.parametrize(
    "R, words",
    [
        (2 * np.eye(3), r"must be a rotation matrix; found \[.*\], whose columns are not orthonormal: "
         r"R'R differs from the identity by 3; use the nearest rotation, U V' of its singular value decomposition"),
        (np.diag([1.0, -1.0, 1.0]), r"must be a rotation matrix; found \[.*\], a reflection: its determinant is -1; "),
        ([[1.0, 0.01, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], r"R'R differs from the identity by 0\.01;"),
    ],
)  # fmt: skip
def test_what_is_no_rotation(R, words):
    with pytest.raises(gt.ModelError, match=rf"parameter 'R' .*{words}.*test_values\.py"):
        mechanics.Fixed(R=R)


def test_four_printed_digits_are_a_rotation_and_two_are_not():
    mechanics.Fixed(R=turned(4))
    with pytest.raises(gt.ModelError, match="must be a rotation"):
        mechanics.Fixed(R=turned(2))


def test_a_unit_quaternion():
    half = np.sqrt(0.5)
    given = dict(A=np.zeros(3), v=[1.0, 0.0, 0.0], at=[0.0, 1.0], points=np.zeros((2, 3)))
    mechanics.MeasuredGuideway(u=np.round([half, 0.0, half, 0.0], 4), **given)
    words = r"parameter 'u' must have length 1; found \[1\.\s*, 1\.\s*, 0\.\s*, 0\.\s*\], of length 1\.41421; divide"
    with pytest.raises(gt.ModelError, match=words):
        mechanics.MeasuredGuideway(u=[1.0, 1.0, 0.0, 0.0], **given)


SKEW = np.array([[1.0, 0.2, 0.0], [-0.2, 1.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    "I, words",
    [
        (SKEW, r"symmetric and positive semidefinite; .* whose transpose differs by 0\.4; check the signs"),
        (np.diag([1.0, -0.1, 1.0]), r"with the eigenvalue -0\.1; check its signs and units"),
    ],
)
def test_what_is_no_inertia(I, words):
    with pytest.raises(gt.ModelError, match=words):
        mechanics.RigidBody(m=1.0, I=I)


@pytest.mark.parametrize("I", [np.zeros((3, 3)), np.diag([0.0, 0.2, 0.2]), np.diag([0.0, 0.0, 0.05])])
def test_points_rods_and_planar_bodies_are_bodies(I):
    np.testing.assert_array_equal(mechanics.RigidBody(m=1.0, I=I).I, I)


def test_inertias_of_drawn_bodies_are_taken_and_those_with_a_negative_moment_are_not():
    rng = np.random.default_rng(4)
    for _ in range(50):
        r, m = rng.normal(size=(5, 3)), rng.uniform(0.1, 1.0, 5)
        I = sum(mk * (rk @ rk * np.eye(3) - np.outer(rk, rk)) for rk, mk in zip(r, m, strict=True))
        np.testing.assert_array_equal(mechanics.RigidBody(m=1.0, I=I).I, I)
        moments, axes = np.linalg.eigh(I)
        moments[0] = -0.01 * moments[2]
        with pytest.raises(gt.ModelError, match="with the eigenvalue"):
            mechanics.RigidBody(m=1.0, I=axes @ np.diag(moments) @ axes.T)


class Sled(gt.Model):
    """A flange with a friction that falls from `peak`."""

    coulomb = gt.parameter(2.0, unit="N", min=0.0)
    peak = gt.parameter(3.0, unit="N", min=0.0)
    mass = gt.part(mechanics.Mass, m=1.0)
    motor = gt.part(mechanics.ForceMotor)
    friction = gt.part(
        mechanics.StribeckFriction, coulomb=coulomb, breakaway=peak, stribeck_velocity=0.01, velocity_scale=1e-3
    )

    def equations(self):
        yield gt.connect(self.mass.flange, self.friction.flange)
        yield gt.connect(self.mass.flange, self.motor.flange)


def test_breakaway_below_coulomb():
    Sled().causal("mass.flange.s", "motor.force")
    words = (
        r"parameter 'friction\.breakaway' must be at least 'coulomb', 4\.0; found 3\.0, which follows from peak = 3 "
        r"\(.*test_values\.py:\d+\)$"
    )
    with pytest.raises(gt.ModelError, match=words):
        Sled(coulomb=4.0).causal("mass.flange.s", "motor.force")
    with pytest.raises(gt.ModelError, match=r"'friction\.breakaway' must be at least 'coulomb', 2\.0; found 1\.0 \("):
        Sled(friction=dict(breakaway=1.0)).causal("mass.flange.s", "motor.force")


def test_a_part_of_ones_own_takes_what_a_declared_one_refuses():
    """A magnet is a spring of negative stiffness: declared so, not slipped in by a sign."""

    class Magnet(mechanics.FlangeSpringDamper):
        k = gt.parameter(unit="N/m", max=0.0)

    with pytest.raises(gt.ModelError, match=r"parameter 'k' must be at least 0\.0; found -5\.0"):
        mechanics.FlangeSpringDamper(k=-5.0)
    assert Magnet(k=-5.0).k == -5.0
