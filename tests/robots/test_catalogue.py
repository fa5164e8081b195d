"""The catalogue: all printed sets with what is known of them, and configurations by their signs."""

from __future__ import annotations

from itertools import product

import mpmath
import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, Status
from gtmodel.compiler.alias import eliminate
from gtmodel.compiler.causal import flat_of
from gtmodel.compiler.structure import analyse
from gtmodel.mechanics import PiecewiseLinearFriction, TanhFriction
from gtmodel.robots import configuration, entries, gantry_tau, make
from tests.support.compare import relative_error
from tests.support.strategies import SIDES, columns, random_states

# Some hundred operations at regular poses, which lose two digits.
ROUND_OFF = 1e-12
L1 = ("l1_camera", "l1_tape", "l1_tracker", "l1_tracker_2008", "l1_vision")
THREE_LINK = (*L1, "d1_nominal")


def side_of(robot: gt.robots.GantryTau, T: np.ndarray, q: np.ndarray) -> np.ndarray:
    """On which side of the plane through the carts T lies, along the first guideway."""
    p = np.asarray(robot.A) + q[:, :, None] * np.asarray(robot.v)
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return np.sign(np.sum((T - p[:, 0]) * normal, axis=1) * (normal @ np.asarray(robot.v)[0])).astype(int)


def round_trip(name: str, signs: tuple[int, ...], count: int = 40) -> float:
    """T -> q on one of eight branches -> T on the side on which it lies; the other side is another T, as far.

    Returns the largest relative error; infinite where a status or a side is wrong.
    """
    robot = gantry_tau(name)
    T, *_, q = columns(random_states(robot, count, seed=1, sides=signs))
    inverse = robot.causal("T", "q", branches=configuration(robot, signs))
    found, status = inverse(T)
    errors = [relative_error(found, q)]
    right = not status.any()
    sides = side_of(robot, T, q)
    for side in (1, -1):
        back, status = robot.causal("q", "T", branches=configuration(robot, forward=side))(q)
        here = sides == side
        errors.append(relative_error(back[here], T[here]))
        right = right and not status.any() and bool(np.all(side_of(robot, back, q) == side))
        links = back[:, None] - np.asarray(robot.A) - q[:, :, None] * np.asarray(robot.v)
        errors.append(relative_error(np.linalg.norm(links, axis=2), np.broadcast_to(robot.L, (count, 3))))
    return float(np.max(errors)) if right else np.inf


class TestEntries:
    def test_all_printed_sets(self):
        found = entries()
        assert {n for n, e in found.items() if e.family == "three_link"} == set(THREE_LINK)
        assert {n: e.degrees_of_freedom for n, e in found.items() if e.family != "three_link"} == {
            "d1_six_link": 3,
            "f1": 6,
            "kr500": 6,
        }
        assert found["f1"].source == "Dressler 2012, Table 5.5"
        ours = {n for n, e in found.items() if "ours" in e.masses}
        assert ours == {"d1_nominal", "d1_six_link", "f1"}

    @pytest.mark.parametrize("name", ["d1_nominal", "d1_six_link", "f1"])
    def test_degrees_of_freedom_are_those_of_the_structure(self, name):
        flat = flat_of(make(name))
        given = set(flat.lookup("tau")[1])
        kept = eliminate(flat, frozenset(given))
        unknowns = [v.index for v in flat.variables if v.index not in kept.removed and v.index not in given]
        structure = analyse(flat, kept.equations, unknowns)  # positions and velocities
        assert structure.degrees_of_freedom == 2 * entries()[name].degrees_of_freedom

    @pytest.mark.parametrize("name", ["d1_nominal", "d1_six_link", "f1"])
    def test_options_reach_every_family(self, name):
        plain, changed = make(name), make(name, payload=2.0, velocity_scale=0.3, smoothing="piecewise_linear")
        assert changed.m_p == pytest.approx(plain.m_p + 2.0) and changed.velocity_scale == 0.3
        part = "arm" if name == "d1_nominal" else "cart"
        kinds = [m.__dict__["_modifiers"][part]["friction"] for m in (plain, changed)]
        assert kinds == [TanhFriction, PiecewiseLinearFriction]

    def test_a_payload_is_no_less_than_nothing(self):
        for name in ("l1_tape", "d1_six_link", "f1"):
            with pytest.raises(ModelError, match="a payload is a mass of 0 kg or more; found -3 kg"):
                make(name, payload=-3.0)

    def test_a_serial_arm_takes_no_friction(self):
        with pytest.raises(ModelError, match="leave out inertia, payload and friction smoothing"):
            make("kr500", velocity_scale=0.3)

    def test_smoothing_is_felt(self):
        # cart 1 at the velocity scale: all of its 130 N of Coulomb friction, of which tanh gives three quarters
        f = make("f1", smoothing="piecewise_linear").causal("q", "cart[0].friction.force")
        force, status = f([0.72, 0.26, 0.21, 0.0, 0.0, 0.0], np.eye(6)[0] * 0.1)
        assert status is Status.OK and force == pytest.approx(130.0 + 10.0)

    def test_what_a_family_does_not_take(self):
        with pytest.raises(
            gt.ModelError, match="inertia model 'model_1' applies to three-link robots only; give the masses of 'f1'"
        ):
            make("f1", inertia="model_1")
        with pytest.raises(gt.ModelError, match="there is no three-link robot 'f1'; there are d1_nominal"):
            gantry_tau("f1")
        with pytest.raises(gt.ModelError, match="F1 has no declaration 'I_q'"):
            make("f1", I_q=1.0)
        with pytest.raises(gt.ModelError, match="masses and friction of 'kr500' are not printed"):
            make("kr500", payload=500.0)
        with pytest.raises(gt.ModelError, match="there is no robot 'd1_nominel'; did you mean 'd1_nominal'"):
            make("d1_nominel")


class TestConfiguration:
    @pytest.mark.parametrize(
        ("name", "signs"),
        [
            ("d1_nominal", (1, 1, 1)),
            ("d1_nominal", (-1, 1, -1)),
            ("l1_tracker", (1, -1, -1)),
            ("l1_vision", (-1, -1, -1)),
        ],
    )
    def test_round_trips(self, name, signs):
        assert round_trip(name, signs) < ROUND_OFF

    @pytest.mark.proof
    @pytest.mark.parametrize(("name", "signs"), [*product(THREE_LINK, SIDES)])
    def test_every_set_on_every_branch(self, name, signs):
        assert round_trip(name, signs) < ROUND_OFF

    def test_wrong_signs_are_sentences(self):
        robot = gantry_tau("l1_camera")
        with pytest.raises(gt.ModelError, match="the inverse kinematics of GantryTau takes 3 signs; found 2"):
            configuration(robot, (1, 1))
        with pytest.raises(gt.ModelError, match=r"the configuration takes \+1 or -1 for arm\[1\].ahead; found 0"):
            configuration(robot, (1, 0, 1))
        with pytest.raises(gt.ModelError, match="the forward kinematics of F1 is iterative"):
            configuration(make("f1"), forward=1)
        with pytest.raises(gt.ModelError, match="World has no configuration"):
            configuration(gt.mechanics.World())


class TestThreeRoads:
    """Forward kinematics by closed form, by Newton in double precision and by mpmath with thirty digits."""

    @pytest.mark.parametrize("name", ["l1_camera", "d1_nominal"])
    def test_three_links(self, name):
        robot = gantry_tau(name)
        A, v, L = (np.asarray(getattr(robot, k), dtype=float) for k in "AvL")
        T, *_, q = columns(random_states(robot, 5, seed=3))
        sides = side_of(robot, T, q)
        for n in range(5):
            f = robot.causal("q", "T", branches=configuration(robot, forward=int(sides[n])))
            closed, status = f(q[n])
            assert status is Status.OK
            P = A + q[n][:, None] * v

            def closure(*x, P=P):
                return [sum((a - b) ** 2 for a, b in zip(x, p, strict=True)) - r**2 for p, r in zip(P, L, strict=True)]

            newton = T[n] + 1e-2
            for _ in range(8):
                d = newton - P
                newton = newton + np.linalg.solve(2 * d, L**2 - np.sum(d * d, axis=1))
            with mpmath.workdps(30):
                exact = [float(x) for x in mpmath.findroot(closure, (T[n] + 1e-2).tolist())]
            assert relative_error(closed, exact) < ROUND_OFF and relative_error(newton, exact) < ROUND_OFF


class TestStatus:
    """Rows that cannot be solved get a status and NaN, and every row is what its scalar call gives."""

    @pytest.mark.parametrize(
        ("name", "known", "target", "bad", "verdict"),
        [
            ("d1_nominal", "T", "q", [0.0, 40.0, 0.0], Status.OUT_OF_RANGE),
            ("d1_nominal", "q", "T", [0.0, 40.0, 0.0], Status.OUT_OF_RANGE),
            ("d1_six_link", "q", "T", [0.0, 40.0, 0.0], Status.NOT_CONVERGED),
            ("f1_five_dof", "q", "T", [9.0, 0.0, 0.0, 0.0, 0.0], Status.OUT_OF_RANGE),
        ],
    )
    def test_rows(self, name, known, target, bad, verdict):
        robot = gt.robots.f1_five_dof() if name == "f1_five_dof" else make(name)
        good = np.asarray(robot.home) if known == "T" else np.zeros(len(bad)) + ([0.5] * 3 + [0.0] * (len(bad) - 3))
        rows = np.tile(good, (5, 1))
        rows[1, 1], rows[2], rows[3, 0] = np.nan, bad, np.inf
        f = robot.causal(known, target)
        found, status = f(rows)
        assert status.tolist() == [Status.OK, Status.NOT_FINITE, verdict, Status.NOT_FINITE, Status.OK]
        for n, row in enumerate(rows):
            alone, one = f(row)
            assert one == status[n] and np.array_equal(alone, found[n], equal_nan=True)
            assert np.isfinite(alone).all() == (one == Status.OK)
        sentence = f.diagnose(rows[2])
        assert sentence.startswith(verdict.message) and len(sentence) > len(verdict.message)


@pytest.mark.parametrize(
    ("maker", "part"),
    [
        (gt.robots.six_link_gantry_tau, "cart"),
        (gt.robots.f1_gantry_tau, "cart"),
        (gt.robots.extra_carts, "cart"),
        (lambda **parts: gantry_tau("l1_tape", **parts), "arm"),
        (lambda **parts: gantry_tau("l1_tape", inertia="model_1", smoothing="piecewise_linear", **parts), "arm"),
    ],
)
def test_friction_can_be_taken_out(maker, part: str):
    robot = maker(**{part: {"friction": gt.mechanics.Frictionless}})
    assert robot.causal(known="q", targets=f"{part}[1].friction.force")() == (0.0, Status.OK)
