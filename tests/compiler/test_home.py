"""The home pose where start values are wrong: found with few changes, the same for FK and IK, and said."""

from __future__ import annotations

import re

import numpy as np
import pytest

import gtmodel as gt

BASE = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, np.sqrt(3) / 2]])
PLATFORM = 0.15 * np.array([[np.cos(a), np.sin(a)] for a in np.deg2rad([210, 330, 90])])
UPPER, LOWER = 0.4, 0.45
X, PHI = np.array([0.5, 0.29]), 0.0


def turned(phi: float) -> np.ndarray:
    return np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])


def by_hand(x: np.ndarray, phi: float, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles of the upper and lower links, elbows all on the same side."""
    d = x / scale + PLATFORM @ turned(phi).T - BASE
    length = np.linalg.norm(d, axis=1)
    inner = np.arccos((length**2 + UPPER**2 - LOWER**2) / (2 * UPPER * length))
    q = np.arctan2(d[:, 1], d[:, 0]) + inner
    w = d - UPPER * np.column_stack([np.cos(q), np.sin(q)])
    return q, np.arctan2(w[:, 1], w[:, 0])


class PlanarRobot(gt.Model):
    """3-RRR: three legs of two links turn and move a platform; q is driven, p are the lower links."""

    scale = gt.parameter(1.0)
    q0 = gt.parameter(shape=3)
    p0 = gt.parameter(shape=3)
    x0 = gt.parameter(X)
    phi0 = gt.parameter(PHI)
    q = gt.variable(3, start=q0)
    p = gt.variable(3, start=p0)
    x = gt.variable(2, start=x0)
    phi = gt.variable(start=phi0)

    def equations(self):
        c, s = gt.cos(self.phi), gt.sin(self.phi)
        for k, (b0, b1) in enumerate(PLATFORM):
            for i, (rotated, f) in enumerate(((c * b0 - s * b1, gt.cos), (s * b0 + c * b1, gt.sin))):
                end = BASE[k, i] + UPPER * f(self.q[k]) + LOWER * f(self.p[k])
                yield self.x[i] + self.scale * rotated == self.scale * end


def robot(q: np.ndarray, p: np.ndarray, **starts: object) -> PlanarRobot:
    return PlanarRobot(q0=q, p0=p, **starts)


def same_angles(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(np.max(np.abs(np.exp(1j * a) - np.exp(1j * b))) < 1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_wrong_guess_for_passive_links_changes_no_assembly(seed: int):
    rng = np.random.default_rng(seed)
    q, p = by_hand(X, PHI, 1.0)
    model = robot(q, p + rng.uniform(-3, 3, 3))
    forward, inverse = model.causal("q", ["x", "phi"]), model.causal(["x", "phi"], ["q", "p"])
    for _ in range(5):
        x, phi = X + rng.uniform(-0.04, 0.04, 2), rng.uniform(-0.2, 0.2)
        there = by_hand(x, phi, 1.0)
        found_q, found_p, status = inverse(x, phi)
        assert status is gt.Status.OK and same_angles(found_q, there[0]) and same_angles(found_p, there[1])
        found_x, found_phi, status = forward(there[0])
        assert status is gt.Status.OK
        np.testing.assert_allclose([*found_x, found_phi], [*x, phi], atol=1e-9)


def test_a_home_that_was_moved_is_said():
    q, p = by_hand(X, PHI, 1.0)
    wrong = robot(q, p + np.array([2.0, 0.0, 0.0]))
    for f in (wrong.causal("q", ["x", "phi"]), wrong.causal(["x", "phi"], "q")):
        (note,) = f.notes
        said = re.search(r"p\[0\] from (\S+) to (\S+);", note)
        assert said and "q[" not in note and float(said[1]) == pytest.approx(p[0] + 2.0, rel=1e-3)
        assert float(said[2]) == pytest.approx(p[0], abs=0.02)
        assert note in f.explain()
    right = robot(q, p).causal("q", ["x", "phi"])
    assert right.notes == ()
    home = re.search(r"home pose: q = \[(.*?)\]; p = .*; x = \[(.*?)\]; phi = ", right.explain())
    assert home is not None
    np.testing.assert_allclose([float(v) for v in home[1].split(",")], q, atol=0.03)


def test_a_home_pose_has_no_forces():
    inverse = gt.robots.six_link_gantry_tau("d1_six_link").causal("T", "tau")
    home = next(line for line in inverse.explain().splitlines() if "home pose: " in line)
    assert re.findall(r"(\w+) = ", home) == ["q", "T", "e", "R"]


@pytest.mark.parametrize("seed", range(2))
def test_functions_share_the_home_whatever_had_to_move(seed: int):
    rng = np.random.default_rng(seed)
    q, p = by_hand(X, PHI, 1.0)
    model = robot(q + rng.uniform(-1, 1, 3), p + rng.uniform(-2, 2, 3))
    forward, inverse = model.causal("q", ["x", "phi"]), model.causal(["x", "phi"], "q")
    place = {pair: n for n, pair in enumerate(forward.plan.pairs)}
    at = [place[p] for p in inverse.plan.pairs if p in place]
    there = [n for n, p in enumerate(inverse.plan.pairs) if p in place]
    home = forward.plan.samples[0]
    np.testing.assert_allclose(home[at], inverse.plan.samples[0][there], atol=0.1)
    assert forward.notes and inverse.notes
    # what one says of the other's home
    names = [forward.flat.symbol_name(*p) for p in forward.plan.pairs]
    q_home, x_home = (home[[names.index(f"{v}[{k}]") for k in range(n)]] for v, n in (("q", 3), ("x", 2)))
    phi_home = home[names.index("phi")]
    found, status = inverse(x_home, phi_home)
    assert status is gt.Status.OK and same_angles(found, q_home)
    found_x, found_phi, status = forward(q_home)
    assert status is gt.Status.OK
    np.testing.assert_allclose([*found_x, found_phi], [*x_home, phi_home], atol=1e-9)


@pytest.mark.parametrize("name", ["d1_nominal", "l1_tracker_2008"])
def test_a_start_that_fits_is_not_said_to_move(name: str):
    model = gt.robots.gantry_tau(name)
    for f in (model.causal("q", "T"), model.causal("T", "q")):
        assert f.notes == ()
