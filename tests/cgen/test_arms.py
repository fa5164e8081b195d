"""Closed forms of arms in C: hostile poses, answers judged by forward kinematics; instructions beside code by hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status
from gtmodel.cgen import generate
from gtmodel.cgen.interface import Interface, interfaces
from gtmodel.cgen.points import evaluate
from gtmodel.cgen.verification.comparison import call
from gtmodel.compiler.causal import CausalFunction
from gtmodel.geometry.rotations import rotation_by
from tests.bench.arm_pairs import PEER, UR5E, arm_pairs, inverse_of
from tests.bench.callgrind import body_call, count, generate as sources_of, guarded_call
from tests.bench.three_link_pairs import RATIO
from tests.cgen.calls import shared_library
from tests.cgen.hostile import Hostile

ARM = Path(__file__).parents[2] / "problems" / "models" / "arm.urdf"
FEW, MANY = 2_000, 100_000
TWISTS = 1e-4 * np.random.default_rng(0).standard_normal(6)
# pose errors of an answer: of a matrix that is a rotation, and per deviation of one that is none but is accepted
WRONG, PER_DEVIATION = 1e-9, 10.0
# slopes of roots, of size one or a length [m], within which two branches meet: round-off; the branches of a calibrated
# arm are those of its nominal one, whose singular positions are as far away as its twists are off
BORDER = {False: 1e-6, True: 1e-3}
REGULAR = 0.05  # slopes of all roots, of size one or a length: far from singular positions
ARMS = ["ur5e", "scara", *[pytest.param(k, marks=pytest.mark.proof) for k in ("wrist", "calibrated")]]


def inverse(key: str) -> tuple[gt.Model, CausalFunction]:
    """An arm with its inverse kinematics on the first branch; `calibrated` has three Newton steps, in C too."""
    if key in ("ur5e", "scara"):
        return inverse_of(key)
    arm = gt.robots.serial_arm(**{**UR5E, "alpha": np.add(UR5E["alpha"], TWISTS)})
    arm = gt.robots.from_urdf(ARM) if key == "wrist" else arm
    return arm, arm.causal(["T", "R"], "q", branches=dict.fromkeys(("shoulder", "elbow", "wrist"), 1))


class HostilePoses(Hostile):
    """Draws of poses: spoilt numbers of all sizes, edges of the reach, singular positions, matrices that are none."""

    def __init__(self, face: Interface, library, arm: Arm, seed: int) -> None:
        self.face, self.library, self.arm = face, library, arm
        self.rng = np.random.default_rng(seed)
        self.base = arm.poses(self.rng.uniform(-np.pi, np.pi, (1000, len(arm.chain))))
        self.rates = np.zeros(12, bool)
        self.kinds = [self.spoilt, self.tiny, self.one_huge, self.all_sizes, self.millimetres, self.edge, self.stale,
                      self.reached, self.singular, self.skewed, self.turned]  # fmt: skip

    def reached(self, rows: np.ndarray) -> np.ndarray:
        return rows

    def singular(self, rows: np.ndarray) -> np.ndarray:
        """Joints at multiples of a quarter turn, exactly or off by 1e-17 to 1e-2."""
        n = len(self.arm.chain)
        q = self.rng.uniform(-np.pi, np.pi, (len(rows), n))
        at = self.rng.random(q.shape) < 0.5
        off = self._powers(q.shape, -17, -2) * self.rng.integers(2, size=q.shape)
        return self.arm.poses(np.where(at, np.pi / 2 * self.rng.integers(-2, 3, size=q.shape) + off, q))

    def skewed(self, rows: np.ndarray) -> np.ndarray:
        """Matrices that are no rotations, by 1e-16 to 1; some mirrored."""
        R = rows[:, 3:] + self._powers((len(rows), 9), -16, 0) * self.rng.integers(2, size=(len(rows), 9))
        mirror = self.rng.random(len(rows)) < 0.1
        return np.column_stack([rows[:, :3], np.where(mirror[:, None], -R, R)])

    def turned(self, rows: np.ndarray) -> np.ndarray:
        """Any orientation at positions in reach."""
        turn = rotation_by(self.rng.uniform(-3, 3, (len(rows), 3)))
        return np.column_stack([rows[:, :3], turn.reshape(-1, 9)])


class Arm:
    """An arm, its generated inverse kinematics on one branch, and the judge: products of exponentials of its axes."""

    def __init__(self, key: str, place: Path) -> None:
        self.model, function = inverse(key)
        self.chain = gt.kinematics.chain_of(self.model)
        form = gt.kinematics.closed_form(self.chain)
        assert form is not None
        self.form = form
        assert not function.kernels  # no iteration
        functions = {"inverse": function}
        (self.face,) = interfaces(functions, key)
        self.library = shared_library(generate(functions, place / "out", name=key).folder, place)
        limits = self.model.joint_limits
        self.limits = np.tile([-np.inf, np.inf], (len(self.chain), 1)) if limits is None else limits

    def poses(self, q: np.ndarray) -> np.ndarray:
        T, R = self.chain.pose(q)
        return np.hstack([T, R.reshape(-1, 9)])

    def slopes(self, q: np.ndarray) -> np.ndarray:
        """Slopes of the roots (m, k): not negative if q is on the first branch."""
        return np.asarray(self.form.slope_function(q.T)).T

    def wrong(self, inputs: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Rows of answers that miss the pose, the limits or the branch."""
        R = inputs[:, 3:].reshape(-1, 3, 3)
        deviation = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max(axis=(1, 2))
        size = max(1.0, self.chain.size)
        off = np.abs(self.poses(q) - inputs).max(axis=1) / size
        outside = ((q < self.limits[:, 0] - WRONG) | (q > self.limits[:, 1] + WRONG)).any(axis=1)
        other = (self.slopes(q) < -BORDER[self.form.near]).any(axis=1)
        return ~(off <= WRONG + PER_DEVIATION * deviation) | outside | other


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Arm]:
    kept: dict[str, Arm] = {}
    return lambda key: kept.get(key) or kept.setdefault(key, Arm(key, tmp_path_factory.mktemp(key)))


@pytest.mark.parametrize("rows", [FEW, pytest.param(MANY, marks=pytest.mark.proof)])
@pytest.mark.parametrize("key", ARMS)
def test_what_is_ok_is_the_pose_within_limits_on_its_branch(key: str, rows: int, arm: Callable[[str], Arm]) -> None:
    it = arm(key)
    inputs = HostilePoses(it.face, it.library, it, seed=44).rows(rows)
    q, status = call(it.library, it.face, inputs)
    ok = status == Status.OK
    assert ok.sum() > rows / 50
    bad = np.flatnonzero(ok)[it.wrong(inputs[ok], q[ok])]
    assert bad.size == 0, f"{bad.size} wrong, first {inputs[bad[0]].tolist()} -> {q[bad[0]].tolist()}"
    if rows == FEW:
        expected, wanted = evaluate(it.face, inputs)
        np.testing.assert_array_equal(status, wanted)
        np.testing.assert_array_equal(q[ok], expected[ok])


@pytest.mark.parametrize("key", ARMS)
def test_a_posture_on_the_branch_comes_back(key: str, arm: Callable[[str], Arm]) -> None:
    it = arm(key)
    low, high = np.clip(it.limits, -np.pi, np.pi).T
    q = np.random.default_rng(3).uniform(low, high, (6000, len(it.chain)))
    q = q[(it.slopes(q) > REGULAR).all(axis=1)]
    assert len(q) > 100
    found, status = call(it.library, it.face, it.poses(q))
    np.testing.assert_array_equal(status, Status.OK)
    off = np.where(it.chain.revolute, np.abs(np.exp(1j * found) - np.exp(1j * q)), np.abs(found - q))
    assert off.max() < 1e-9


@pytest.mark.usefixtures("callgrind")
def test_a_closed_form_costs_no_more_than_half_as_much_again_as_by_hand(tmp_path: Path) -> None:
    pairs = arm_pairs()
    calls = {f"hand {p.key}": p.peer for p in pairs}
    calls |= {f"body {p.key}": body_call(p.key, p.function, p.peer.points) for p in pairs}
    calls |= {f"guarded {p.key}": guarded_call(p.key, p.function, p.peer.points) for p in pairs}
    sources = [*sources_of({p.key: p.function for p in pairs}, tmp_path / "generated"), PEER]
    counts = count(calls, sources)
    for p in pairs:
        hand, body, guarded = (counts[f"{what} {p.key}"] for what in ("hand", "body", "guarded"))
        for written in (hand.outputs, guarded.outputs):
            assert np.abs(np.exp(1j * written) - np.exp(1j * p.expected)).max() < 1e-12
        ratio = body.instructions / hand.instructions
        print(f"{p.key}: by hand {hand.instructions:.0f}, generated {body.instructions:.0f}, ratio {ratio:.2f}, "
              f"with guards {guarded.instructions:.0f}")  # fmt: skip
        assert ratio <= RATIO
