"""The robot's side of a calibration with cameras: its closure equations in the parameters, the pose and the carts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from ...calibrate.choice import Choice
from ...calibrate.closure import Closure, closure_equations
from ...calibrate.unknowns import Parameters, Unknowns, unknowns
from ...compiler.causal import compile_causal, flat_of
from ...compiler.rows import map_columns
from ...lang.model import Model
from ...results.refusal import ArgumentError

ROUNDS, ARRIVED = 40, 1e-12  # of Newton's method; m and rad
SINGULAR = 1e-6  # of rows of length one


@dataclass(frozen=True, eq=False)
class RobotLinks:
    """Length errors of a robot's links as a function of its free parameters, its pose and its actuators.

    `pose`: variables of the end-effector, the position first, then a quaternion where it turns; `unknowns`: the free
    parameters; `residual`: (parameters, pose, actuators) -> length errors [m].
    """

    robot: Model
    actuators: str
    pose: tuple[str, ...]
    closure: Closure
    unknowns: Unknowns
    residual: ca.Function
    made: dict[int, ca.Function] = field(default_factory=dict, repr=False)

    @property
    def turns(self) -> bool:
        """Whether the end-effector turns."""
        return len(self.pose) > 1

    @property
    def pose_size(self) -> int:
        """Numbers of a pose."""
        return 7 if self.turns else 3

    @cached_property
    def slopes(self) -> ca.Function:
        """Length errors with their derivatives in the parameters, the pose and the actuators."""
        x, z, q = (ca.SX.sym(f"a{k}", self.residual.size1_in(k)) for k in range(3))
        r = self.residual(x, z, q)
        return ca.Function("slopes", [x, z, q], [r, *(ca.densify(ca.jacobian(r, s)) for s in (x, z, q))], {"cse": True})

    def at(self, x: np.ndarray, poses: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, ...]:
        """Length errors (n, m) and Jacobians (n, m, .) at parameters (k,) or (n, k)."""
        n = len(q)
        x = np.broadcast_to(x, (n, np.shape(x)[-1]))
        out = map_columns(self.slopes, [x.T, poses.T, q.T], self.made)
        m = out[0].shape[0]
        return tuple([out[0].T, *(o.T.reshape(n, -1, m).transpose(0, 2, 1) for o in out[1:])])

    def forward(self, x: np.ndarray, q: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Poses (n, pose) at which the equations close, by Newton's method from `near`; NaN where there is none.

        Of a plate that turns, the steps of a quaternion keep its length to first order and it is made one after each.
        """
        z = np.array(np.broadcast_to(near, (len(q), self.pose_size)), float)
        size = np.full(len(q), np.inf)
        with np.errstate(all="ignore"):
            for _ in range(ROUNDS):
                r, _, B, _ = self.at(x, z, q)
                if self.turns:
                    unit = np.concatenate([np.zeros((len(z), 1, 3)), z[:, None, 3:]], axis=2)
                    B, r = np.concatenate([B, unit], axis=1), np.concatenate([r, np.zeros((len(z), 1))], axis=1)
                bad = ~np.isfinite(B).all(axis=(1, 2)) | (np.abs(np.linalg.det(np.nan_to_num(B))) < 1e-12)
                B[bad] = np.eye(B.shape[1])
                step = np.linalg.solve(B, r[..., None])[..., 0]
                step[bad] = np.nan
                z = z - step
                if self.turns:
                    z[:, 3:] /= np.linalg.norm(z[:, 3:], axis=1, keepdims=True)
                size = np.abs(step).max(axis=1)
                if np.all((size < ARRIVED) | np.isnan(size)):
                    break
        z[~(size < 1e-9)] = np.nan
        return z

    def start(self, q: np.ndarray) -> np.ndarray:
        """Poses (n, pose) of actuators by the robot as it was known before. Raises ArgumentError where one has none."""
        forward = compile_causal(self.robot, known=[self.actuators], targets=list(self.pose))
        *parts, status = forward(q)
        lost = np.flatnonzero(np.asarray(status) != 0)
        if len(lost):
            raise ArgumentError(
                f"row {lost[0] + 1} of the actuators has no pose of the robot as it was known before; check units and "
                "columns",
                self.actuators,
            )
        return np.concatenate([np.asarray(p).reshape(len(q), -1) for p in parts], axis=1)

    def require_all_links(self, x: np.ndarray, poses: np.ndarray, q: np.ndarray, noise: float) -> None:
        """Raises ArgumentError where the noise of the actuators does not reach every closure equation."""
        _, _, _, by_q = self.at(x, poses, q)
        by_q = by_q / np.maximum(np.linalg.norm(by_q, axis=2, keepdims=True), 1e-12)
        least = np.linalg.svd(by_q, compute_uv=False)[:, -1] if by_q.shape[1] <= by_q.shape[2] else np.zeros(1)
        if not noise > 0 or not np.all(least > SINGULAR):
            raise ArgumentError(
                "at a pose the noise of the actuators does not reach every closure equation: not all of this robot's "
                "actuators are measured, or it stands in a singular pose",
                "actuator_noise",
            )


def robot_side(robot: Model, choice: Choice, actuators: str = "q", pose: Sequence[str] = ()) -> RobotLinks:
    """The closure equations of a robot with all of its pose known. Raises ArgumentError and ModelError."""
    flat = flat_of(robot)
    pose = tuple(pose) or tuple(n for n in ("T", "e") if n in flat.groups)
    missing = [n for n in (actuators, *pose) if n not in flat.groups]
    if missing or not pose:
        raise ArgumentError(
            f"the robot has no variable '{missing[0] if missing else 'T'}'; name its actuators and its pose", "robot"
        )
    closure = closure_equations(flat, known=[actuators, *pose])
    u = unknowns(Parameters.of(flat, closure.touched), choice)
    (lengths,) = u.substituted([closure.lengths])
    z = ca.vertcat(*[closure.symbols[n] for n in pose])
    residual = ca.Function("lengths", [u.x, z, closure.symbols[actuators]], [lengths], {"cse": True})
    return RobotLinks(robot, actuators, pose, closure, u, residual)
