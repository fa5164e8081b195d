"""Every limit of a motion is active where it binds, and kept; files for a controller; what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import SolveStatus
from gtmodel.motion import JointCone, Limits, Line, Obstacle
from gtmodel.motion.motion_study import solved
from gtmodel.motion.planning import plan_of
from gtmodel.results import ArgumentError, Work
from gtmodel.results.options import declared, written_name
from tests.support.motions import GOAL, asked, l1, solution

COARSE = {"cost__energy": 0.01, "mesh__elements": 20}
FREE = 1.5095  # cost of the best free motion, 1.509980, less what 20 elements may be off
COARSE_COST = 1e-3  # of the cost, on 20 elements
ACTIVE = 0.03  # of a limit: so near it comes on a coarse mesh
KEPT = 0.01  # of a limit: between the collocation points, the bound that the study checks itself


def outcome(**changes):
    return solution(**{**COARSE, **changes})


def refused(**changes) -> ArgumentError:
    with pytest.raises(ArgumentError) as caught:
        plan_of(asked(**changes))
    return caught.value


# limit, value, what of the exported motion it bounds
MAGNITUDES = {
    "tcp_velocity": (0.8, lambda run: np.linalg.norm(run["der(T)"], axis=1)),
    "tcp_acceleration": (4.0, lambda run: np.linalg.norm(run["der(T,2)"], axis=1)),
    "tcp_jerk": (60.0, lambda run: np.linalg.norm(np.diff(run["der(T,2)"], axis=0), axis=1) / np.diff(run.time)),
    "cart_velocity": (0.8, lambda run: np.abs(run["der(q)"])),
    "cart_acceleration": (4.0, lambda run: np.abs(np.gradient(run["der(q)"], run.time, axis=0))[1:-1]),
}
# limit, value, sign, what of the motion it bounds, changes; the free optimum at w = 0.001 is outside each of them
LIVELY = {"cost__energy": 0.001}
ACROSS = {**LIVELY, "start__tcp": [0.4, -0.9, 0.8], "goal__tcp": [0.7, -0.9, 0.0]}  # cart 2 swings back by 2.7 mm
POSITIONS = {
    "cart_low": ([-2.0, -2.0, -0.9526], 1, "q", ACROSS),
    "cart_high": ([-0.5, -0.7, -0.5], -1, "q", LIVELY),
    "tcp_low": ([-0.2, -1.0, -0.2], 1, "T", {}),
    "tcp_high": ([1.0, -0.85, 0.6], -1, "T", LIVELY),
}


def written(limit: str) -> str:
    """The name of a limit in results, with its unit."""
    return written_name(limit, declared(Limits)[limit])


class TestLimits:
    # speed and jerk of the tool also bind along a path, below
    @pytest.mark.parametrize(
        "limit", [pytest.param(n, marks=[pytest.mark.proof] * (n in ("tcp_velocity", "tcp_jerk"))) for n in MAGNITUDES]
    )
    def test_magnitudes(self, limit):
        value, of = MAGNITUDES[limit]
        o = outcome(**{f"limits__{limit}": value})
        assert (1 - ACTIVE) * value < np.max(of(o.trajectory)) < (1 + KEPT) * value
        assert -2 * KEPT < o.exported_margins[written(limit)] < 2 * ACTIVE
        assert o.status is SolveStatus.SOLVED
        assert np.max(of(outcome().trajectory)) > 1.02 * value
        assert o.objective > FREE
        assert o.exported_peak_force <= 700.0 * (1 + 1e-9)

    @pytest.mark.parametrize(
        "limit", [pytest.param(n, marks=[pytest.mark.proof] * (n in ("cart_low", "tcp_high"))) for n in POSITIONS]
    )
    def test_positions(self, limit):
        value, sign, name, changes = POSITIONS[limit]
        free, o = outcome(**changes), outcome(**changes, **{f"limits__{limit}": value})
        room = lambda run: np.min(sign * (run[name] - np.array(value)))  # noqa: E731
        assert o.status is SolveStatus.SOLVED
        assert room(free.trajectory) < -0.001
        assert abs(room(o.trajectory)) < min(
            0.003, -room(free.trajectory) / 3
        )  # active, and kept up to the coarse mesh
        assert o.exported_margins[written(limit)] == pytest.approx(room(o.trajectory), abs=1e-6)
        assert o.objective > free.objective * (1 - COARSE_COST)

    def test_joint_cone(self):
        """The link of arm 0 against an axis on which it leans most at one end of the motion; half the way back."""
        plan = plan_of(asked())

        def angles(run, arm, axis):
            a, b = plan.links(run)[arm]
            d = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
            return np.rad2deg(np.arccos(d @ axis / np.linalg.norm(axis)))

        axis = np.array([1.0, -0.2, -0.3])
        free = angles(outcome().trajectory, 0, axis)
        ends = max(free[0], free[-1])
        assert free.max() > ends + 2.0
        half = round(float((ends + free.max()) / 2), 3)
        o = outcome(limits__joint_cones=[JointCone(0, "cart", axis.tolist(), float(np.radians(half)))])
        assert o.status is SolveStatus.SOLVED and o.objective > FREE
        assert np.max(angles(o.trajectory, 0, axis)) == pytest.approx(half, abs=0.15)

    def test_obstacle(self):
        """A box in the way of the tool centre point: what stays is at least the clearance, at most the smoothing's."""
        middle = outcome().trajectory
        point = middle["T"][len(middle) // 2]
        size = [0.1, 0.06, 0.06]
        center = [float(x) for x in point]
        o = outcome(limits__obstacles=[Obstacle(center, size, clearance=0.01)], mesh__elements=25)
        assert o.status is SolveStatus.SOLVED and o.objective > FREE
        (left,) = o.exported_clearance
        assert 0.008 < left < 0.03
        ends = plan_of(asked())
        samples = np.linspace(0.0, 1.0, 401)[:, None, None]
        points = np.concatenate([a + samples * (b - a) for a, b in ends.links(o.trajectory)])
        outside = np.maximum(np.abs(points - center) - np.array(size) / 2, 0.0)
        assert np.linalg.norm(outside, axis=-1).min() >= left

    def test_along_a_path(self):
        """The same margins in both roads along a line."""
        o = outcome(path=Line(intervals=120), cost__energy=0.0, limits__tcp_velocity=0.7, mesh__elements=30)
        assert o.status is SolveStatus.SOLVED
        assert np.max(np.linalg.norm(o.trajectory["der(T)"], axis=1)) == pytest.approx(0.7, rel=1e-3)
        assert o.cross_check_time == pytest.approx(o.final_time, rel=2e-3)

    def test_jerk_along_a_path(self):
        o = outcome(path=Line(), limits__tcp_jerk=60.0)
        assert o.status is SolveStatus.SOLVED and o.cross_check_time is None
        assert (1 - ACTIVE) * 60 < np.max(MAGNITUDES["tcp_jerk"][1](o.trajectory)) < (1 + KEPT) * 60


class TestFiles:
    def test_reference(self, tmp_path):
        o = outcome()
        (tmp_path / "reference.csv").write_text(o.files["reference.csv"])
        reference = gt.Trajectory.from_csv(tmp_path / "reference.csv")
        assert np.diff(reference.time) == pytest.approx(0.004, abs=1e-12)
        assert 0 <= reference.time[-1] - o.exported_final_time < 0.004
        q, tau, status = l1().causal("T", ["q", "tau"])(*(reference[n] for n in ("T", "der(T)", "der(T,2)")))
        assert np.all(status == 0)
        assert reference["q"] == pytest.approx(q, abs=1e-9) and reference["tau"] == pytest.approx(tau, abs=1e-5)
        assert np.max(np.abs(reference["tau"])) <= 700.0 * (1 + 1e-6)
        # velocities are those of the positions, accelerations up to 10 m/s2; the last row stands still
        slope = np.diff(reference["T"][:-1], axis=0) / 0.004
        mean = (reference["der(T)"][1:-1] + reference["der(T)"][:-2]) / 2
        assert slope == pytest.approx(mean, abs=0.01)
        assert np.all(reference["der(T)"][-1] == 0) and reference["T"][-1] == pytest.approx([0.9, -0.9, 0.45], abs=5e-3)

    def test_rapid_module(self):
        text = outcome().files["motion.mod"]
        lines = text.splitlines()
        assert lines[0] == "MODULE GtMotion" and lines[-1] == "ENDMODULE"
        assert "not tested on a controller" in text
        targets = [line for line in lines if line.startswith("    [[")]
        count = int(next(line for line in lines if "GtCount :=" in line).split(":=")[1].strip(" ;"))
        assert len(targets) == count and f"GtTargets{{{count}}} := [" in text
        first = [float(x) for x in targets[0].strip(" [").partition("]")[0].split(",")]
        assert first == pytest.approx([0.0, -900.0, 100.0], abs=1e-3)
        carts = [float(x) for x in targets[0].split("[")[-1].strip(" ],").split(",")]
        assert carts[:3] == pytest.approx(1e3 * outcome().trajectory["q"][0], abs=1e-3) and carts[3:] == [9e9] * 3


class TestRefusals:
    def test_force_below_the_weight(self):
        error = refused(limits__force=20.0)
        assert error.argument == "limits.force"
        assert error.message.startswith("20 N is too small: holding the weight at ")

    @pytest.mark.parametrize(
        ("changes", "argument", "words"),
        [
            ({"limits__tcp_low": [0.0, 0.0, 0.0], "limits__tcp_high": [1.0, -1.0, 1.0]}, "limits.tcp_low",
             "entry 2 is 0 m, not below -1 m in tcp_high"),
            ({"limits__tcp_high": [0.5, 0.0, 1.0]}, "goal.tcp", "violates limits.tcp_high_m by 0.4 m"),
            ({"limits__joint_cones": [JointCone(3, "cart", [1.0, 0.0, 0.0], 0.8)]}, "limits.joint_cones[0].arm",
             "expected an arm from 0 to 2"),
            ({"limits__joint_cones": [JointCone(0, "cart", [0.0, 0.0, 0.0], 0.8)]}, "limits.joint_cones[0].axis",
             "is zero"),
            ({"limits__obstacles": [Obstacle(GOAL, [0.1, 0.1, 0.1])]}, "goal.tcp", "violates limits.obstacles[0] by"),
        ],
    )  # fmt: skip
    def test_one_sentence(self, changes, argument, words):
        error = refused(**changes)
        assert error.argument == argument and words in error.message

    def test_too_little_force_to_move(self):
        """150 N hold the weight and overcome friction at a creep only: a hint, and the nearest iterate is kept."""
        seen = []

        def progress(stage=None, fraction=None, numbers=None):
            if numbers:
                seen.append(numbers["violation"])

        problem = asked(**{**COARSE, "mesh__elements": 8}, limits__force=150.0, solver__max_iterations=100)
        o = solved(problem, Work(progress=progress))
        assert o.status in (SolveStatus.ITERATION_LIMIT, SolveStatus.INFEASIBLE)
        assert "even a slow motion along the straight line needs " in o.message
        assert "which has the smallest violation" in o.message
        kept = o.checks["constraint_violation"]
        assert not kept.passed and kept.value <= 1.01 * min(seen[1:]) and max(seen) > 10 * kept.value
        assert o.trajectory is not None and np.all(np.isfinite(o.trajectory["T"]))

    def test_the_best_iterate_of_a_failed_search_is_kept(self):
        """Few iterations for all attempts together: what comes back keeps its constraints best of what was seen."""
        o = outcome(solver__max_iterations=25, cost__energy=0.0)
        assert o.status in (SolveStatus.ITERATION_LIMIT, SolveStatus.INFEASIBLE)
        assert o.trajectory is not None and o.final_time > 0
