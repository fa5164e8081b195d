"""Dynamics of a pose, from measured angles, joint stiffness or a field of oscillators; and the redundant angle about
the spindle axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..geometry.rotations import rotation_by
from ..kinematics import Chain, postures
from ..results import ArgumentError
from ..results.refusal import naming
from ..vibration import OscillatorField
from .options import Modal
from .oscillators import Oscillators

ANGLES = np.deg2rad(np.arange(-180.0, 181.0))  # 361, one degree apart


@dataclass(frozen=True, eq=False)
class AngleSweep:
    """All joint solutions with which an arm can hold the tool at one place, over the angle about the spindle.

    angles (n,) [rad]. q (s, 6) [rad]: solutions; solution i belongs to angle number row[i] and branch branch[i]; a
    branch has at most one solution per angle. in_reach (n,): whether the geometry allows the angle, regardless of joint
    limits.
    """

    angles: np.ndarray
    q: np.ndarray
    row: np.ndarray
    branch: np.ndarray
    in_reach: np.ndarray

    @property
    def reachable(self) -> np.ndarray:
        """Whether some branch holds the angle within the joint limits (n,)."""
        reachable = np.zeros(len(self.angles), bool)
        reachable[self.row] = True
        return reachable

    def least(self, value: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return per angle (n,) the least of the values (s,) of its solutions, and that solution; NaN and -1: none."""
        value = np.asarray(value, float)
        best, which = np.full(len(self.angles), np.nan), np.full(len(self.angles), -1)
        order = np.lexsort((value, self.row))
        first = order[np.unique(self.row[order], return_index=True)[1]]
        best[self.row[first]], which[self.row[first]] = value[first], first
        return best, which


def runs_of(mask: np.ndarray) -> np.ndarray:
    """Return first and last row (n, 2) of each run of true rows."""
    edges = np.diff(np.concatenate([[0], mask, [0]]).astype(int))
    return np.column_stack([np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1])


def tool_rotations(angles: ArrayLike, axis: ArrayLike, spindle: ArrayLike, zero: float = 0.0) -> np.ndarray:
    """Return flange orientations (n, 3, 3) with the spindle along `axis` (3), world coordinates, turned about it by
    angles (n,) [rad].

    spindle (3): from spindle to tip, flange coordinates. The angle turns about -axis: about the upward vertical for a
    tool that points down. At turn 0 the flange's z axis (x axis if the spindle is along z), projected perpendicular to
    the spindle, points towards world x (y if the tool is along x); at angle 0 the turn is `zero` [rad]. The thesis does
    not print its convention. Raises ValueError for a zero direction.

    >>> R = gt.milling.tool_rotations(np.radians([0.0, 90.0]), axis=[0.0, 0.0, -1.0], spindle=[0.0, 0.0, 1.0])
    >>> R[0].round(6) + 0.0
    array([[ 1.,  0.,  0.],
           [ 0., -1.,  0.],
           [ 0.,  0., -1.]])
    """
    frame_world, frame_flange = _frame(axis, (1, 0, 0), (0, 1, 0)), _frame(spindle, (0, 0, 1), (1, 0, 0))
    start = frame_world @ frame_flange.T
    turns = (np.asarray(angles, float).reshape(-1, 1) + zero) * -frame_world[:, 0]
    return rotation_by(turns) @ start


def angle_sweep(
    arm: Chain, limits: ArrayLike, place: ArrayLike, *, axis: ArrayLike = (0.0, 0.0, -1.0),
    tool: ArrayLike = (0.0, 0.0, 0.0), spindle: ArrayLike = (0.0, 0.0, 1.0), angles: ArrayLike = ANGLES,
    zero: float = 0.0,
) -> AngleSweep:  # fmt: skip
    """Return joint angles that hold the tool centre point at `place` (3) [m] at the angles (n,) [rad]: all branches
    within limits.

    limits (6, 2) [rad]; tool (3) [m]: tool centre point in flange coordinates; axis, spindle, zero: see
    `tool_rotations`. Of solutions that differ by whole turns, a branch keeps the one farthest from the limits. Raises
    ValueError for wrong shapes.

    >>> robot = gt.robots.kr500()
    >>> arm = gt.kinematics.chain_of(robot)
    >>> sweep = gt.milling.angle_sweep(arm, robot.joint_limits, place=[1.2, 0.0, 0.3], angles=[0.0, 1.5, 3.0])
    >>> sweep.reachable, sweep.q.shape
    (array([ True,  True,  True]), (6, 6))
    """
    angles = np.asarray(angles, float).ravel()
    low, high = np.asarray(limits, float).reshape(6, 2).T
    R = tool_rotations(angles, axis, spindle, zero)
    solutions = postures(arm, np.asarray(place, float) - R @ np.asarray(tool, float), R)
    q, row, branch = [], [], []
    for n in range(len(angles)):
        turns, branches = solutions.within(limits, n)
        margin = np.minimum(turns - low, high - turns).min(axis=1)
        for b in np.unique(branches):
            candidates = np.flatnonzero(branches == b)
            q.append(turns[candidates[np.argmax(margin[candidates])]])
            row.append(n)
            branch.append(b)
    in_reach = np.any(np.isfinite(solutions.q).all(axis=2), axis=1)
    return AngleSweep(angles, np.array(q).reshape(-1, 6), np.array(row, int), np.array(branch, int), in_reach)


def _frame(first: ArrayLike, second: tuple[int, int, int], instead: tuple[int, int, int]) -> np.ndarray:
    """Return a right-handed frame: x along `first`, y as near as possible to `second` (`instead` if parallel)."""
    x = np.asarray(first, float)
    length = np.linalg.norm(x)
    if x.shape != (3,) or not length > 0:
        raise ValueError(f"the direction is {x.tolist()}; expected three numbers, not all zero")
    x = x / length
    y = np.asarray(second if np.linalg.norm(np.cross(x, second)) > 1e-6 else instead, float)
    y = y - (x @ y) * x
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


ROUNDING = 1e-9  # rad, of an angle converted from degrees


class AngleTable:
    """Oscillators known at angles (n,) [rad]; in between, monotone cubics through log m, log c and log k.

    Angles are equal modulo whole turns. There is no extrapolation beyond the first and last angle. Raises ValueError
    for fewer than two angles, or another number of oscillators.

    >>> robots = gt.milling.Oscillators.with_damping_ratio([[350] * 3] * 2, [[2e6] * 3, [1.5e6] * 3], [[0.03] * 3] * 2)
    >>> table = gt.milling.AngleTable(np.radians([0.0, 60.0]), robots)
    >>> table.at(np.radians(30.0)).k.round(-3)
    array([[1732000., 1732000., 1732000.]])
    >>> table.covers(np.radians([30.0, 90.0]))
    array([ True, False])
    """

    def __init__(self, angles: ArrayLike, oscillators: Oscillators) -> None:
        angles = np.asarray(angles, float).ravel()
        if len(angles) != len(oscillators) or len(angles) < 2:
            raise ValueError(
                f"found {len(angles)} angles for {len(oscillators)} oscillators; expected two or more each"
            )
        order = np.argsort(angles)
        if np.any(np.diff(angles[order]) <= 0):
            raise ValueError("an angle appears twice; expected different angles")
        if angles[order[-1]] - angles[order[0]] > 2 * np.pi + ROUNDING:
            low, high = np.rad2deg(angles[order[[0, -1]]])
            raise ValueError(f"the angles run from {low:g} to {high:g} deg; expected at most one turn of 360 deg")
        self.angles = angles[order]
        o = oscillators[order]
        self._curve = scipy.interpolate.PchipInterpolator(
            self.angles, np.log(np.hstack([o.m, o.c, o.k])), extrapolate=False
        )

    def covers(self, angles: ArrayLike) -> np.ndarray:
        """Return whether angles [rad] are within the table, modulo whole turns (n,)."""
        return self.turned(angles) <= self.angles[-1] + ROUNDING

    def turned(self, angles: ArrayLike) -> np.ndarray:
        """Return angles (n,) [rad] shifted by whole turns to within one turn from the first angle of the table."""
        a, first = np.asarray(angles, float).ravel(), self.angles[0] - ROUNDING
        return np.where(self._within(a), a, first + (a - first) % (2 * np.pi))

    def _within(self, a: np.ndarray) -> np.ndarray:
        """Return whether angles [rad] are within the table without a shift (n,)."""
        return (a >= self.angles[0] - ROUNDING) & (a <= self.angles[-1] + ROUNDING)

    def at(self, angles: ArrayLike) -> Oscillators:
        """Return the oscillators at angles (n,) [rad]. Raises ValueError outside the table."""
        a = np.asarray(angles, float).ravel()
        if not np.all(self.covers(a)):
            worst = a[~self.covers(a)][0]
            low, high = np.rad2deg(self.angles[[0, -1]])
            raise ValueError(f"the angle {np.rad2deg(worst):g} deg is outside the table, {low:g} to {high:g} deg")
        values = np.exp(self._curve(np.clip(self.turned(a), *self.angles[[0, -1]])))
        return Oscillators(values[:, :3], values[:, 3:6], values[:, 6:])

    def casadi_function(self) -> Any:
        """Return the curve as a CasADi function A [rad] -> m, c, k (3 each); it extrapolates with the last cubics."""
        A = ca.SX.sym("A")
        pieces = []
        for i, knot in enumerate(self.angles[:-1]):
            d = A - knot
            c = self._curve.c[:, i, :]
            pieces.append(((ca.DM(c[0]) * d + ca.DM(c[1])) * d + ca.DM(c[2])) * d + ca.DM(c[3]))
        value = pieces[0]
        for knot, piece in zip(self.angles[1:-1], pieces[1:], strict=True):
            value = ca.if_else(A < knot, value, piece)
        p = ca.exp(value)
        return ca.Function("oscillators", [A], [p[:3], p[3:6], p[6:]], ["A"], ["m", "c", "k"])


NEIGHBOURS = 3  # grid angles on either side for a local table


class Dynamics(NamedTuple):
    """Oscillators by angle at one place. `rows`: grid rows where they are known; `smooth`: for a row, a CasADi function
    and the angles [rad] between which it is valid."""

    rows: np.ndarray
    oscillators: Oscillators
    at: Callable[[float], Oscillators]
    smooth: Callable[[int], tuple[Any, float, float]]


Given = AngleTable | Modal | OscillatorField


def dynamics_of(source: Given | None, name: str) -> tuple[Callable[..., Dynamics] | None, str | None]:
    """Return the function (angles, reachable (n,), compliance (n, 3, 3), branch (n,), place) -> Dynamics, and a
    description of the source; None without dynamics. name: of the source, such as a file."""
    if source is None:
        return None, None
    if isinstance(source, AngleTable):
        return _of_table(source), "measured at the listed angles, monotone cubics of the logarithms between them"
    if isinstance(source, Modal):
        about = "from joint stiffness with declared masses: an example, not a measurement"
        return _of_modal(source.mass, source.damping_ratio), about
    synthetic = f"; synthetic: {source.synthetic}" if source.synthetic else ""
    return _of_field(source), f"Gaussian processes over the pose{name and ', '}{name}{synthetic}"


def _of_table(table: AngleTable) -> Callable[..., Dynamics]:
    def dynamics(angles, reachable, compliance, branch, place) -> Dynamics:
        rows = np.flatnonzero(reachable & table.covers(angles))
        if not len(rows):
            low, high = np.rad2deg(table.angles[[0, -1]])
            raise ArgumentError(f"contains no reachable angle; it covers {low:g} to {high:g} deg", "dynamics")
        smooth = table.casadi_function()
        return Dynamics(rows, table.at(angles[rows]), table.at, lambda row: (smooth, *table.angles[[0, -1]]))

    return dynamics


def _of_modal(mass: list[float], zeta: list[float]) -> Callable[..., Dynamics]:
    def dynamics(angles, reachable, compliance, branch, place) -> Dynamics:
        rows = np.flatnonzero(reachable)
        k = 1 / np.einsum("nii->ni", compliance[rows])
        with naming("dynamics", ValueError):
            oscillators = Oscillators.with_damping_ratio(np.tile(mass, (len(rows), 1)), k, zeta)

        def near(row: int) -> AngleTable:
            local = [row]
            for way in (-1, 1):
                for neighbour in row + way * np.arange(1, NEIGHBOURS + 1):
                    if not 0 <= neighbour < len(angles) or not reachable[neighbour] or branch[neighbour] != branch[row]:
                        break
                    local.append(int(neighbour))
            if len(local) < 2:
                raise ValueError("no neighbour of this angle is reachable on the same branch")
            local.sort()
            return AngleTable(angles[local], oscillators[np.searchsorted(rows, local)])

        def at(angle: float) -> Oscillators:
            nearest = int(np.argmin(np.abs(angles[rows] - angle)))
            if abs(angles[rows[nearest]] - angle) < ROUNDING:  # works without neighbours
                return oscillators[np.array([nearest])]
            return near(rows[nearest]).at(angle)

        def smooth(row: int) -> tuple[Any, float, float]:
            table = near(row)
            return table.casadi_function(), *table.angles[[0, -1]]

        return Dynamics(rows, oscillators, at, smooth)

    return dynamics


def _of_field(field: OscillatorField) -> Callable[..., Dynamics]:
    def dynamics(angles, reachable, compliance, branch, place) -> Dynamics:
        def at(angle: Any) -> Oscillators:
            a = np.atleast_1d(angle)
            return Oscillators(*field.at(np.column_stack([np.tile(place, (len(a), 1)), a])))

        poses = np.column_stack([np.tile(place, (len(angles), 1)), angles])
        known = reachable & field.covers(poses)
        rows = np.flatnonzero(known)
        if not len(rows):
            point = ", ".join(f"{x:.4g}" for x in place)
            raise ArgumentError(
                f"covers no reachable angle at ({point}) m: the measured poses are too far away or too few; measure "
                "nearer to the work",
                "dynamics",
            )
        A = ca.SX.sym("A")
        along = ca.Function("oscillators", [A], field.casadi_function()(ca.vertcat(*place, A)), ["A"], ["m", "c", "k"])
        return Dynamics(rows, at(angles[rows]), at, lambda row: (along, *_run(angles, known, row)))

    return dynamics


def _run(angles: np.ndarray, reachable: np.ndarray, row: int) -> tuple[float, float]:
    """Return the ends of the run of reachable angles around a row."""
    low, high = next(run for run in runs_of(reachable) if run[0] <= row <= run[1])
    return float(angles[low]), float(angles[high])
