"""The whole scene turned and mirrored, closed loop with both sensors: the result turns and is mirrored with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import scipy

import gtmodel as gt

L = gt.control.lead_through
OK = L.SignTest(None, L.WrenchStatus.OK)
ROUNDING = 1e-12  # [m], [m/s], [rad/s], after thousands of cycles
OF_FORCES = 1e-11  # [N]: 5 kN/m times positions whose last digit is 1e-16 m, a few of them
TURN = scipy.spatial.transform.Rotation.from_rotvec([0.7, -1.3, 0.4]).as_matrix()
MIRROR = np.diag([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Elsewhere:
    """A contact in a world that was turned or mirrored by Q."""

    inner: Any
    Q: np.ndarray

    def wrench(self, position: Any, turn: Any, velocity: Any, rate: Any, time: float) -> Any:
        Q, axial = self.Q, np.linalg.det(self.Q) * self.Q
        own = Q if np.linalg.det(Q) < 0 else np.eye(3)  # the mirrored tool's frame is mirrored too
        f, m = self.inner.wrench(Q.T @ position, Q.T @ turn @ own, Q.T @ velocity, axial.T @ rate, time)
        return Q @ f, axial @ m

    def energy(self, position: Any, turn: Any, time: float) -> float:
        own = self.Q if np.linalg.det(self.Q) < 0 else np.eye(3)
        return self.inner.energy(self.Q.T @ position, self.Q.T @ turn @ own, time)


def plain(values: Any) -> Any:
    return tuple(float(x) for x in values)


def scene(task: str, Q: np.ndarray | None = None, noise: float = 1.0) -> Any:
    peg = task == "peg"
    gains = L.SurfaceGains(force_gain=0.008, friction=0.1)
    contact: Any = L.SyntheticSurface(tilt=np.radians(4.0), curvature=0.3, friction=0.1)
    phases = [((0.0, 0.2, -1.0), (0.0, 0.0, 0.0), 1.0), ((4.0, 2.0, -3.0), (0.0, 0.0, 0.0), 3.0),
              ((0.0, 0.0, 15.0), (0.1, 0.05, -0.2), 1.0)]  # fmt: skip
    if peg:
        gains = L.SurfaceGains(
            force_gain=0.002, any_direction=True, force_reference=0.0, enter_force=0.3, leave_force=0.05,
            least_force=0.05, normal_filter=0.0, dwell=0.02, contact_arm=0.01,
        )  # fmt: skip
        contact = L.SyntheticHole(np.radians(5.0), 0.25e-3, 0.08, stiffness=5e3, friction=0.1)
        phases = [((0.1, 0.05, -1.0), (0.0, 0.0, 0.0), 6.0)]
    turning = L.TurningGains(by_handle=True, torque_gain=1.0 if peg else 0.0, about_axis="hold" if peg else "free")
    normal, start, turn = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 0.002]), np.eye(3)
    sensor = L.SyntheticSensor(mass=0.0, force_noise=0.005 * noise, moment_noise=0.0005 * noise)
    if Q is not None:
        contact = Elsewhere(contact, Q)
        axial = np.linalg.det(Q) * Q
        phases = [(Q @ f, axial @ m, t) for f, m, t in phases]
        normal, start = Q @ normal, Q @ start
        turn = Q if np.linalg.det(Q) > 0 else turn
    law = L.LeadThroughLaw(
        L.SurfaceLaw(gains, plain(normal), L.OscillationWatch(level=0.3)), L.TurningLaw(turning)
    )  # fmt: skip
    done = [L.GuidePhase(t, plain(f), plain(m)) for f, m, t in phases]
    return L.guide_tool(
        law, done, contact, handle=sensor, tool=replace(sensor, point=(0.0, 0.0, 0.1)), tests=(OK, OK), start=start,
        turn=turn, grip=(0.0, 0.0, 0.15), seed=6,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("task", "way"),
    [
        ("surface", "mirrored"), ("peg", "turned"),
        *(pytest.param(*both, marks=pytest.mark.proof) for both in (("surface", "turned"), ("peg", "mirrored"))),
    ],
)  # fmt: skip
def test_the_whole_scene_turned_or_mirrored_turns_or_mirrors_the_result(task: str, way: str) -> None:
    Q = TURN if way == "turned" else MIRROR
    noise = 1.0 if way == "turned" else 0.0  # noise is drawn in the sensor's frame, which a mirror does not carry over
    a, b = scene(task, noise=noise), scene(task, Q, noise)
    axial = np.linalg.det(Q) * Q
    assert 0 < a.contact.mean() < 1 and (a.contact == b.contact).all()
    for polar in ("position", "velocity", "hand_force", "force"):
        most = OF_FORCES if polar == "force" else ROUNDING
        assert np.abs(getattr(a, polar) @ Q.T - getattr(b, polar)).max() < most, polar
    for turned in ("rate", "moment", "hand_moment"):
        assert np.abs(getattr(a, turned) @ axial.T - getattr(b, turned)).max() < ROUNDING, turned
    for part, by in ((slice(3), Q), (slice(3, 6), axial)):
        assert np.abs(a.command[:, part] @ by.T - b.command[:, part]).max() < ROUNDING
    assert np.abs(a.rate).max() > 0.01 and np.abs(a.force).max() > 0.5


def test_the_energy_of_a_hand_that_also_turns_is_held_over_every_window() -> None:
    from gtmodel.control.lead_through.judgement import TOO_MUCH, at_the_handle

    law = L.LeadThroughLaw(rotation=L.TurningLaw(L.TurningGains(by_handle=True)))
    sensor = L.SyntheticSensor(mass=0.0, force_noise=0.02, moment_noise=0.002)
    there = L.GuidePhase(1.0, (2.0, 0.0, 0.0), (0.0, 0.3, 0.1))
    back = L.GuidePhase(1.0, (-2.0, 1.0, 0.0), (0.2, -0.3, 0.0))
    phases = [there, back, L.GuidePhase(1.0)]
    run = L.guide_tool(
        law, phases, L.SyntheticSurface(), handle=sensor, tool=sensor, tests=(OK, OK), start=(0.0, 0.0, 1.0),
        grip=(0.0, 0.0, 0.15), seed=2,
    )  # fmt: skip
    book = at_the_handle(run, law.translation.gains, law.rotation.gains, L.ServoChain())
    assert np.abs(run.rate).max() > 0.1 and book.worst < 0
    assert book.share <= TOO_MUCH
