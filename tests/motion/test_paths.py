"""Motions along a path: the restricted model and the squared speeds are two roads to one motion."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel import SolveStatus
from gtmodel.motion import Arc, Line, Obstacle, Polyline, Spline, Taught, read_points
from gtmodel.motion.paths import arc, line, polyline, spline, taught
from gtmodel.motion.planning import plan_of
from gtmodel.optimize.path import PathTask, cosine_nodes, solve_path
from gtmodel.results import ArgumentError
from tests.support.motions import asked, solution

# The reference instance on the straight line, 50 x 3 Radau; on ever finer meshes 1.041338 by squared speeds.
LINE, LINE_BY_SPEEDS = 1.041242, 1.041338
PRINTED = 1e-6
COARSE = 3e-3  # of the time, on 30 elements; 1e-4 on 50 elements of the line
START, GOAL = np.array([0.0, -0.9, 0.1]), np.array([0.9, -0.9, 0.45])
CORNER = np.array([0.3, -0.9, 0.5])
rng = np.random.default_rng(3)
u = np.linspace(0.0, 1.0, 60)
# synthetic recording: a bent line, 0.1 mm of noise, seed 3
RECORDED = (
    START + np.outer(u, GOAL - START) + np.outer(0.08 * np.sin(np.pi * u), [0, 1, 0]) + 1e-4 * rng.normal(size=(60, 3))
)


def outcome(path=None, **changes):
    return solution(path=path or Line(), **changes)


def refused(**changes) -> ArgumentError:
    with pytest.raises(ArgumentError) as caught:
        plan_of(asked(**changes))
    return caught.value


class TestCurves:
    @pytest.mark.parametrize(
        "path",
        [
            line(START, GOAL),
            polyline(np.array([START, CORNER, [0.7, -1.0, 0.5], GOAL]), 0.05),
            arc(START, CORNER, GOAL),
            spline(np.array([START, CORNER, GOAL])),
            taught(RECORDED, 5e-4),
        ],
        ids=["line", "polyline", "arc", "spline", "taught"],
    )
    def test_two_continuous_derivatives_and_the_same_expression(self, path):
        s = np.linspace(0.0, 1.0, 2001)
        x, slope, bend = path(s)
        h = s[1]
        assert np.max(np.abs((x[2:] - x[:-2]) / (2 * h) - slope[1:-1])) < 1e-3 * np.max(np.abs(slope))
        assert np.max(np.abs((slope[2:] - slope[:-2]) / (2 * h) - bend[1:-1])) < 0.02 * (1 + np.max(np.abs(bend)))
        assert path.length == pytest.approx(np.sum(np.linalg.norm(np.diff(x, axis=0), axis=1)), rel=1e-6)

        class Along(gt.Model):
            metre = gt.parameter(1.0, unit="m")
            s = gt.variable()
            r = gt.variable(3, unit="m")

            def equations(self):
                yield self.r == path.expression(self.s, self.metre)

        f = Along().causal("s", ["r", "der(r)", "der(r,2)"])
        r, v, a, status = f(s, np.full(2001, 0.5), np.full(2001, -0.2))
        assert np.all(status == 0)
        inner = slice(1, -1)  # at a break either piece may count
        assert r == pytest.approx(x, abs=1e-12)
        assert v[inner] == pytest.approx(0.5 * slope[inner], abs=1e-9)
        assert a[inner] == pytest.approx(0.25 * bend[inner] - 0.2 * slope[inner], abs=1e-8)

    def test_arc_is_a_circle_through_three_points(self):
        path = arc(START, CORNER, GOAL)
        x = path(np.linspace(0.0, 1.0, 401))[0]
        assert np.ptp(np.linalg.norm(x - path.center, axis=1)) < 1e-12
        assert x[0] == pytest.approx(START) and x[-1] == pytest.approx(GOAL)
        assert np.min(np.linalg.norm(x - CORNER, axis=1)) < path.length / 400

    def test_polyline_touches_its_pieces_and_cuts_its_corners(self):
        path = polyline(np.array([START, CORNER, GOAL]), 0.05)
        x = path(np.linspace(0.0, 1.0, 2001))[0]
        least = np.min(np.linalg.norm(x - CORNER, axis=1))
        assert 0.001 < least < 0.05

    def test_a_blended_corner_shortens_the_path(self):
        path = polyline(np.array([[0.0, -0.9, 0.1], [0.1, -0.9, 0.3], [0.2, -0.9, 0.1]]), 0.05)
        assert path.length == pytest.approx(0.4215, abs=5e-5)  # the polygon has 0.4472

    def test_taught_stays_within_the_tolerance(self):
        path = taught(RECORDED, 5e-4)
        x = path(np.linspace(0.0, 1.0, 4001))[0]
        off = [np.min(np.linalg.norm(x - p, axis=1)) for p in RECORDED]
        assert np.sqrt(np.mean(np.square(off))) <= 5e-4
        assert len(path.poly.x) < len(RECORDED) / 2  # smoothed, not followed


class TestSquaredSpeeds:
    def test_a_mass_on_a_rail(self):
        """Bang-bang by hand: 2 sqrt(length m / F), without friction and with the known speed limit."""
        x, v, a = (ca.SX.sym(n) for n in "xva")
        bounds = np.array([3.0]), np.array([2.0])  # half as much to brake with would be the same by symmetry

        def task(**more):
            f = ca.Function("f", [x, v, a], [2.0 * a])
            return PathTask(lambda s: (4 * s[:, None], 4 + 0 * s[:, None], 0 * s[:, None]), f, -bounds[0], bounds[1],
                            np.zeros(1), **more)  # fmt: skip

        # accelerate with 1, brake with 1.5 m/s2 over 4 m: v^2/2 + v^2/3 = 4
        top = np.sqrt(4 / (1 / 2 + 1 / 3))
        expected = top / 1.0 + top / 1.5
        errors = [abs(solve_path(task(), n).final_time - expected) / expected for n in (50, 200)]
        assert errors[0] < 2e-2 and errors[1] < errors[0] / 3
        assert solve_path(task(), 200).final_time == solve_path(task(), 200).final_time

    def test_motion_is_exact_between_its_nodes(self):
        motion = plan_of(asked(path=Line())).follower.fastest(60)
        t = np.linspace(0.0, motion.final_time, 3001)
        s, v, _ = motion.at(t)
        assert s[0] == 0.0 and s[-1] == pytest.approx(1.0, abs=1e-12) and np.all(np.diff(s) >= 0)
        assert np.trapezoid(v, t) == pytest.approx(1.0, abs=1e-5)
        assert motion.at(motion.t)[0] == pytest.approx(motion.s, abs=1e-12)

    def test_reference_instance(self):
        """1.041338 s on the line; errors at 50, 100, 200 cosine nodes as printed: 1.1e-3, 2.5e-4, 5e-5."""
        follower = plan_of(asked(path=Line())).follower
        for n, error in ((50, 1.1e-3), (100, 2.5e-4), (200, 5e-5)):
            motion = follower.fastest(n, bounded="middle")
            assert motion.final_time / LINE_BY_SPEEDS - 1 == pytest.approx(error, rel=0.1)
            assert motion.status is SolveStatus.SOLVED and motion.iterations <= 20

    def test_no_motion(self):
        """A force that cannot hold the weight: the status says so, nothing is thrown."""
        x, v, a = (ca.SX.sym(n) for n in "xva")
        f = ca.Function("f", [x, v, a], [a + 9.81])
        curve = lambda s: (s[:, None], 1 + 0 * s[:, None], 0 * s[:, None])  # noqa: E731
        motion = solve_path(PathTask(curve, f, np.array([-5.0]), np.array([5.0]), np.zeros(1)), 20, max_iterations=100)
        assert not motion.status.ok and motion.message.startswith(motion.status.message)

    def test_wrong_shapes(self):
        x = ca.SX.sym("x")
        f = ca.Function("f", [x, ca.SX.sym("v"), ca.SX.sym("a")], [x])
        with pytest.raises(ValueError, match="the number of rows of the quantities"):
            solve_path(PathTask(lambda s: (s, s, s), f, np.zeros(2), np.zeros(2), np.zeros(2)))

    def test_nodes(self):
        s = cosine_nodes(10)
        assert s[0] == 0 and s[-1] == 1 and np.all(np.diff(s) > 0) and s + s[::-1] == pytest.approx(1.0)


class TestLine:
    def test_reference(self):
        o = outcome()
        assert o.status is SolveStatus.SOLVED and o.message.startswith("solved and re-simulated")
        assert o.objective == pytest.approx(LINE, rel=PRINTED)
        assert o.iterations <= 40  # the optimum and the motion exported, at most 20 each
        assert o.cross_check_time == pytest.approx(LINE_BY_SPEEDS, rel=2 * PRINTED)

    def test_exported_motion_stays_on_the_line_and_within_the_force(self):
        o = outcome()
        step = GOAL - START
        s = (o.trajectory["T"] - START) @ step / (step @ step)
        assert o.trajectory["T"] == pytest.approx(START + np.outer(s, step), abs=1e-12)
        assert 600 < o.exported_peak_force <= 700.0
        assert o.exported_end_error < 1e-5
        assert 0 < o.exported_final_time / o.final_time - 1 < 0.003
        # motor 3 is at its limit nearly always, the others never (Dressler 2012, section 3.5)
        assert o.saturation[2] > 0.95 and max(o.saturation[:2]) == 0

    def test_free_is_faster_than_any_path(self):
        assert outcome().objective > 0.892486 * 1.05


class TestOtherPaths:
    @pytest.mark.parametrize(
        "path",
        [
            Polyline([CORNER.tolist()], intervals=150),
            pytest.param(Arc(CORNER.tolist(), intervals=150), marks=pytest.mark.proof),
        ],
        ids=["polyline", "arc"],
    )
    def test_solved_by_two_roads(self, path):
        o = outcome(path, mesh__elements=30)
        assert o.status is SolveStatus.SOLVED
        assert o.cross_check_time == pytest.approx(o.final_time, rel=COARSE)
        assert o.exported_peak_force <= 700.0 and o.exported_end_error < 1e-4
        assert o.path_length > np.linalg.norm(GOAL - START)

    def test_from_a_file(self, tmp_path):
        rows = "\n".join(",".join(f"{x:.17g}" for x in p) for p in RECORDED)
        (tmp_path / "taught.csv").write_text(f"# synthetic, seed 3\nx_m,y_m,z_m\n{rows}\n")
        points = read_points(tmp_path / "taught.csv")
        assert np.array_equal(points, RECORDED)
        ends = taught(RECORDED, 5e-4)(np.array([0.0, 1.0]))[0].tolist()
        o = outcome(Taught(points, intervals=100), start__tcp=ends[0], goal__tcp=ends[1], mesh__elements=20)
        assert o.status is SolveStatus.SOLVED and o.exported_peak_force <= 700.0


class TestRefusals:
    def test_a_path_that_leaves_the_workspace(self):
        error = refused(path=Polyline([[0.4, -3.0, 0.3]]))
        assert error.argument == "path" and error.message.startswith("the path leaves the workspace at (")
        assert error.message.endswith("% of the way")

    def test_a_path_to_the_boundary_of_the_workspace_names_the_link(self):
        error = refused(path=Polyline([[0.4, -1.7, 0.3]]), limits__link_along_guideway=0.5)
        assert error.argument == "path"
        assert re.search(r"the component of arm\[\d\] along its guideway is 0\.[0-4]\d* m, less than", error.message)

    def test_an_obstacle_on_the_path(self):
        error = refused(path=Line(), limits__obstacles=[Obstacle([0.45, -0.9, 0.275], [0.1, 0.1, 0.1])])
        assert error.argument == "path" and error.message.startswith("the path violates limits.obstacles[0] by ")
        assert error.message.endswith("% of the way")

    @pytest.mark.parametrize(
        ("path", "argument"),
        [
            (Arc([0.45, -0.9, 0.275]), "path.through"),
            (Polyline([[0.01, -0.9, 0.1]]), "path.blend"),
            (Polyline([START.tolist()]), "path.via"),
            (Spline(np.array([START, GOAL])), "path.points"),
            (Spline(np.array([START, START, GOAL])), "path.points"),
            (Taught(RECORDED[:4]), "path.points"),
            (Spline(np.array([START + np.array([0.1, 0.0, 0.0]), CORNER, GOAL])), "start.tcp"),
        ],
    )
    def test_what_cannot_be_a_path_is_named(self, path, argument):
        assert refused(path=path).argument == argument

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("x_m,y_m\n0,1\n", "has no column 'z_m'"),
            ("x_m,y_m,z_m\n0,1,two\n", "line 2, column 'z_m': found 'two'"),
            ("x_m,y_m,z_m\n0,1,nan\n0,1,2\n1,1,1\n", "line 2, column 'z_m': found 'nan'"),
            ("\xff", "not a UTF-8 text file"),
        ],
    )
    def test_wrong_files(self, tmp_path, text, words):
        (tmp_path / "points.csv").write_bytes(text.encode("latin-1"))
        with pytest.raises(ArgumentError) as caught:
            read_points(tmp_path / "points.csv")
        assert caught.value.argument == "file" and words in caught.value.message
