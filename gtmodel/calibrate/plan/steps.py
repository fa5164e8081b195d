"""The steps of a calibration plan, from the room to a simulated calibration (Dressler 2012, section 5.2): candidates,
tests that a point must pass, orientations of the plate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...compiler.causal import CausalFunction, compile_causal
from ...geometry.quaternions import exponential, product, quaternion_matrix
from ...inference import Identifiability
from ...kinematics.mechanism import Mechanism
from ...kinematics.workspace import InverseKinematics, Limit, Poses, Reach, box_grid, limited_mechanism, limits_of
from ...kinematics.workspace.reach import LONGEST_STROKE, refuse_disordered
from ...lang import ModelError
from ...results import ArgumentError, Status, naming
from ...robots.f1 import LINK_ENDS, link_guideways
from ...robots.links import family_of
from ...workers.mapped import mapped
from ..calibration import calibrate
from ..pose_information import PoseInformation, pose_information
from ..pose_selection import Candidates, candidates, condition_removal, exchange, regular_grid, require_enough
from ..positioning import ErrorCurve, Point, Positioning, error_curve, grid_point, positioning, sufficient_number
from ..problem import CalibrationProblem
from .device import Measuring
from .options import PlanLimits, Task, Tracker

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Turn:
    """The robot with its plate at the quaternion `e` (4,), scalar first; None if T alone gives the pose."""

    robot: Mechanism
    e: Array | None

    def poses(self, T: Array) -> Array:
        """Rows of tool centre points (n, 3), or with the quaternion appended (n, 7)."""
        return T if self.e is None else np.hstack([T, np.tile(self.e, (len(T), 1))])


@dataclass(frozen=True)
class Facing:
    """Limit of a target on the plate: a tracker sees it within an angle [rad] of its `direction` (3,)."""

    at: Array
    direction: Array
    acceptance: float
    name: str = "acceptance of the target"
    unit: str = "rad"
    assumes: str = ""
    parts: Sequence[str] = ("direction to the tracker",)

    def margins(self, poses: Poses) -> Array:
        """(n, 1) [rad]."""
        way = self.at - poses.T
        u = self.direction / np.linalg.norm(self.direction)
        angle = np.arctan2(np.linalg.norm(np.cross(way, u), axis=1), way @ u)
        return (self.acceptance - angle)[:, None]


def turns_of(task: Task) -> list[Turn]:
    """One Turn if T alone gives the pose; for an F1 one for each of room.turns. Raises ArgumentError."""
    turns, model = task.room.turns, task.robot
    if not turns:
        raise ArgumentError("is empty; leave it out, or give at least one turn", "room.turns")
    if family_of(model) != "f1":
        if np.any(np.array(turns)):
            raise ArgumentError("applies only to an F1, whose plate turns freely; leave it out", "room.turns")
        return [Turn(limited_mechanism(model, task.home, task.bodies), None)]
    if task.bodies.plate_joints is not None:
        raise ArgumentError("applies only to simplified joints; an F1 has its own", "bodies.plate_joints")
    f1: Any = model
    quaternions = product(np.array(f1.home_e, float), exponential(turns))
    function = compile_causal(f1, known=["T", "e"], targets=["q", *LINK_ENDS])
    return [Turn(_mechanism(f1, function, task.home, e), e) for e in quaternions]


def facing(task: Task, turn: Turn) -> list[Limit]:
    """The target's acceptance at this orientation of the plate, if declared."""
    device = task.device
    if not isinstance(device, Tracker) or device.target_axis is None:
        return []
    plate = np.eye(3) if turn.e is None else quaternion_matrix(turn.e)
    return [Facing(np.array(device.at), plate @ device.target_axis, device.acceptance)]


def _mechanism(f1: Any, function: CausalFunction, place: Sequence[float] | None, e: Array) -> Mechanism:
    def placed(T: Array) -> Any:
        return function(T, np.tile(e, (len(T), 1)))

    inverse = InverseKinematics(placed)
    T = np.array(f1.home if place is None else place, float)
    home = inverse(T[None])
    if home.status[0] != Status.OK:
        point = ", ".join(f"{x:g}" for x in T)
        turn = ", ".join(f"{x:.3g}" for x in e)
        raise ArgumentError(f"the home pose ({point}) m cannot be reached with the plate at ({turn})", "room.turns")
    A, v, L, B = link_guideways(f1)
    return Mechanism(f1, inverse, home, A, v, L, np.linalg.norm(B, axis=1), ())


def stages_of(task: Task, turn: Turn, measuring: Measuring) -> dict[str, Reach]:
    """Tests of a point, each including the former: workspace, obstacles, safety, seen by the device.

    Raises ArgumentError.
    """
    robot, safety, bodies = turn.robot, task.safety, task.bodies
    limits = _with_axes(task, turn, 0.0, 0.0)
    cone = limits.cone
    if cone is not None and safety.cone >= cone:
        off, whole = (f"{np.degrees(angle):g}" for angle in (safety.cone, cone))
        raise ArgumentError(f"subtracts {off} deg from cones of {whole} deg; nothing remains", "safety.cone")
    safe = replace(
        limits, cone=None if cone is None else cone - safety.cone,
        actuators=_with_axes(task, turn, safety.stroke, safety.axes).actuators,
    )  # fmt: skip
    wider = replace(
        bodies, link_radius=bodies.link_radius + safety.obstacles, plate_radius=bodies.plate_radius + safety.obstacles
    )
    boxes, beams = task.obstacles, task.beams
    within = limits_of(safe, wider, boxes, beams, robot)
    return {
        "workspace": Reach(robot.inverse, limits_of(limits, bodies, [], [], robot)),
        "obstacles": Reach(robot.inverse, limits_of(limits, bodies, boxes, beams, robot)),
        "safety": Reach(robot.inverse, within),
        "device": Reach(robot.inverse, [*within, *measuring.limits, *facing(task, turn)]),
    }


def _with_axes(task: Task, turn: Turn, stroke: float, angle: float) -> PlanLimits:
    """Limits of all actuators, narrowed by a stroke [m] for carts and an angle [rad] for the rotary axes after them.

    Raises ArgumentError."""
    limits, carts, axes = task.limits, task.limits.actuators, task.limits.axes
    rotary = turn.robot.home.q.shape[1] - 3 if turn.e is not None else 0
    if axes is not None and len(axes) != rotary:
        raise ArgumentError(f"needs one pair per rotary axis, {rotary}; found {len(axes)}", "limits.axes")
    if carts is not None:
        carts = [[a + stroke, b - stroke] for a, b in carts]
    if rotary and (carts is not None or axes is not None):
        if carts is not None and len(carts) != 3:
            raise ArgumentError(f"needs one pair per cart, 3; found {len(carts)}", "limits.actuators")
        wide = turn.robot.lengths.max() * LONGEST_STROKE / 2
        angles = [[-np.pi, np.pi]] * rotary if axes is None else [[a + angle, b - angle] for a, b in axes]
        carts = (carts or [[-wide, wide]] * 3) + angles
    return replace(limits, actuators=carts)


MOST_POINTS = 200_000  # of the room's grid
MOST_CANDIDATES = 3000  # the information of each candidate is kept in memory
MOST_EVALUATED = 400
Stop = Callable[[str, float], bool]


class Stopped(Exception):
    """The work was interrupted; the plan holds the finished steps."""


@dataclass(eq=False)
class PlanState:
    """Results of the steps so far. Poses are rows of T [m], for an F1 with the plate's quaternion appended."""

    task: Task
    turns: list[Turn]
    measuring: Measuring
    candidates: Candidates | None = None
    pool: Array = field(default_factory=lambda: np.zeros((0, 3)))
    info: PoseInformation = field(init=False)
    evaluation: Array = field(default_factory=lambda: np.zeros((0, 3)))
    target: Positioning = field(init=False)
    curve: ErrorCurve | None = None
    grids: tuple[Point, ...] = ()
    enough: int | None = None
    poses: Array = field(default_factory=lambda: np.zeros((0, 3)))
    held_out: Array = field(default_factory=lambda: np.zeros((0, 3)))
    chosen: PoseInformation | None = None
    units: tuple[str, ...] = ()  # of its unknowns
    identifiability: Identifiability | None = None
    rounds: list[int] = field(default_factory=list)
    errors: Array = field(default_factory=lambda: np.zeros((0, 0)))
    lost: int = 0
    unpredicted: str = ""

    @property
    def robot(self) -> Mechanism:
        """The robot, with the plate in the first of its orientations."""
        return self.turns[0].robot

    @property
    def width(self) -> int:
        """Number of columns of a pose."""
        return self.turns[0].poses(np.zeros((1, 3))).shape[1]

    def each_predicted(self) -> Array:
        """Predicted rms error [m] at each evaluation pose."""
        assert self.chosen is not None
        return self.target.errors(self.chosen).each

    def each_simulated(self) -> Array:
        """Rms error [m] of the simulated calibrations at each evaluation pose."""
        moved = np.einsum("mij,kj->kmi", self.target.jacobian, self.errors)
        return np.sqrt(np.mean(np.sum(moved**2, axis=2), axis=0))


def find_candidates(plan: PlanState, stop: Stop) -> None:
    """Apply workspace, obstacles, safety, device, distance from the edge. Raises ArgumentError if no point remains."""
    task, room = plan.task, plan.task.room
    low, high = np.array(room.low), np.array(room.high)
    refuse_disordered(low, high, "room.high")
    size = len(plan.turns) * float(np.prod((high - low) / room.step + 1))
    if size > MOST_POINTS:
        least = np.cbrt(len(plan.turns) * np.prod(high - low) / MOST_POINTS)
        raise ArgumentError(f"the grid would have {size:.1e} points; use a step of at least {least:.2g} m", "room.step")
    parts = []
    for turn in plan.turns:
        stages = stages_of(task, turn, plan.measuring)
        passed = candidates(box_grid(low, high, room.step), stages, task.safety.edge, stop=stop)
        parts.append(passed)
        names = [name for name in parts[0].stages if all(name in p.stages for p in parts)]
        plan.candidates = Candidates(
            np.vstack([t.poses(p.T) for t, p in zip(plan.turns, parts, strict=False)]),
            {name: np.concatenate([p.stages[name] for p in parts]) for name in names},
            passed.complete,
        )
        if not passed.complete:
            raise Stopped
    assert plan.candidates is not None
    for before, (name, count) in zip([None, *plan.candidates.counts], plan.candidates.counts.items(), strict=False):
        if not count:
            raise ArgumentError(_empty(name, before, plan.candidates.counts), "room")
    T = plan.candidates.chosen
    if len(T) > MOST_CANDIDATES:
        T = T[np.round(np.linspace(0, len(T) - 1, MOST_CANDIDATES)).astype(int)]
    plan.pool = T


def _empty(name: str, before: str | None, counts: dict[str, int]) -> str:
    points = f"of {counts[before]} points after the stage '{before}'" if before else "of the room's grid points"
    return f"none {points} passes the stage '{name}'; move the room, or use a smaller step or smaller safety distances"


def prepare_information(plan: PlanState) -> None:
    """Compute each candidate's information and the position's dependence on the unknowns. Raises ArgumentError."""
    plan.evaluation = _evaluation(plan)
    try:
        plan.info = pose_information(plan.measuring.prepared(plan.pool))
        plan.target = positioning(plan.measuring.whole(plan.evaluation))
    except ModelError as error:
        raise ArgumentError(str(error), "choice") from error
    try:
        plan.target.moment(plan.info)
    except ModelError as error:  # the device measures too little; the plan reports it
        plan.unpredicted = str(error)


def _evaluation(plan: PlanState) -> Array:
    box = plan.task.evaluation
    assert plan.candidates is not None
    if box is None:
        T = plan.candidates.T[plan.candidates.stages["obstacles"]]
        return T[np.round(np.linspace(0, len(T) - 1, min(len(T), MOST_EVALUATED))).astype(int)]
    refuse_disordered(np.array(box.low), np.array(box.high), "evaluation.high")
    lines = [np.linspace(a, b, n) for a, b, n in zip(box.low, box.high, box.counts, strict=True)]
    T = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    lost = np.any([turn.robot.inverse(T).status != 0 for turn in plan.turns], axis=0)
    if np.any(lost):
        where = ", ".join(f"{x:.4g}" for x in T[lost][0])
        raise ArgumentError(f"the robot cannot reach ({where}) m of the box; choose a smaller box", "evaluation")
    return np.vstack([turn.poses(T) for turn in plan.turns])


def grid_poses(plan: PlanState, number: int) -> Array:
    """A regular grid of about this number of candidates, from the volume of the measurable workspace."""
    assert plan.candidates is not None
    room, counts = plan.task.room, plan.candidates.counts
    low, high = np.array(room.low), np.array(room.high)
    step = (high - low) / (np.ceil((high - low) / room.step - 1e-9))
    volume = float(np.prod(step)) * counts[next(reversed(counts))]
    grid = regular_grid(low, high, volume, number)
    poses = []
    for turn in plan.turns:
        last = stages_of(plan.task, turn, plan.measuring)["device"]
        poses.append(turn.poses(candidates(grid, {"device": last}, plan.task.safety.edge).chosen))
    return np.vstack(poses)


def draw_curve(plan: PlanState, stop: Stop) -> None:
    """Predicted error against the number of poses, selected and on grids, and the sufficient number."""
    options = plan.task.poses
    if not plan.task.curve:
        return
    equations = plan.info.rows.shape[1]
    most = len(plan.pool)
    numbers = [n for n in plan.task.curve if plan.info.rank / equations <= n <= most]
    criterion = options.method if options.method in ("D", "E") else "I"
    plan.curve = error_curve(
        plan.info, plan.target, numbers, criterion, repeats=options.repeats, starts=options.starts, seed=options.seed,
        stop=lambda f: stop("number of poses", f),
    )  # fmt: skip
    if not plan.curve.complete:
        raise Stopped
    grids: dict[int, Point] = {}
    for n in numbers:
        T = grid_poses(plan, n)
        if len(T):
            try:
                grids[len(T)] = grid_point(pose_information(plan.measuring.prepared(T)), plan.target)
            except ModelError:  # a small grid may not determine all parameters
                continue
    plan.grids = tuple(grids[n] for n in sorted(grids))
    plan.enough = sufficient_number(
        plan.info, plan.target, plan.task.criteria.accuracy, criterion, repeats=options.repeats, starts=1,
        seed=options.seed, most=min(most, 4 * options.most),
    )  # fmt: skip


def refuse_number(plan: PlanState) -> None:
    """Raise ArgumentError if this number of poses cannot be selected; a grid chooses its number itself."""
    if plan.task.poses.method != "grid":
        with naming("poses.number", ModelError):
            require_enough(plan.info, plan.task.poses.number)


def select(plan: PlanState, number: int, stop: Stop) -> None:
    """Select poses to measure and held-out ones. Raises ArgumentError if there are too few candidates."""
    options, info = plan.task.poses, plan.info
    try:
        if options.method == "grid":
            plan.poses = grid_poses(plan, number)
            indices = np.zeros(0, int)
        else:
            if options.method in ("condition", "condition_one_by_one"):
                s = condition_removal(info, number, one_by_one=options.method != "condition",
                                      stop=lambda f: stop("poses", f))  # fmt: skip
            else:
                moment = None if plan.unpredicted else plan.target.moment(info)
                s = exchange(
                    info, number, "D" if moment is None else options.method, moment, repeats=options.repeats,
                    starts=options.starts, seed=options.seed, stop=lambda f: stop("poses", f),
                )  # fmt: skip
            if not s.complete:
                raise Stopped
            indices = s.indices
            plan.poses = plan.pool[indices]
        ready = plan.measuring.prepared(plan.poses)
        plan.chosen, plan.units = pose_information(ready), ready.unknowns.units
        if not plan.unpredicted:
            plan.target.moment(plan.chosen)  # raises if the few poses of a grid determine too little
    except ModelError as error:
        raise ArgumentError(str(error), "poses.number") from error
    rest = np.setdiff1d(np.arange(len(plan.pool)), indices)
    if options.method == "grid":
        near = np.min(np.linalg.norm(plan.pool[:, None] - plan.poses, axis=2), axis=1)
        rest = np.flatnonzero(near > 1e-6)
    if len(rest) < options.held_out:
        raise ArgumentError(
            f"poses.held_out needs {options.held_out} poses, but only {len(rest)} candidates are left; use a smaller "
            "room.step_m",
            "poses.held_out",
        )
    held = rest[np.round(np.linspace(0, len(rest) - 1, options.held_out)).astype(int)] if options.held_out else rest[:0]
    plan.held_out = plan.pool[held]
    plan.identifiability = plan.chosen.identifiability()
    plan.rounds.append(number)


def simulate(plan: PlanState, stop: Stop) -> None:
    """Synthetic calibrations of the robot with its nominal parameters: device noise, wrong start values.

    Start errors are only in directions that the poses determine; no calibration moves the others.
    """
    assert plan.chosen is not None
    basis, sizes = plan.chosen.basis, plan.chosen.sizes
    options = plan.task.simulation
    ready: CalibrationProblem = plan.measuring.prepared(plan.poses)
    u = ready.unknowns
    scale = np.array([options.start_error] * len(u.names))

    def simulated(seed: np.random.SeedSequence) -> Array | None:
        rng = np.random.default_rng(seed)
        off = sizes * (basis @ (basis.T @ (scale * rng.standard_normal(len(scale)) / sizes)))
        noisy = measuring.noisy(ready.measurements, rng)
        c = calibrate(ready.on(noisy), cost="orthogonal", start=u.named(u.start + off))
        return c.x - u.start if c.status.ok and np.all(np.isfinite(c.x)) else None

    measuring, seeds = plan.measuring, np.random.SeedSequence(options.seed).spawn(options.runs)
    runs = mapped(simulated, seeds)
    ended: list[Array | None] = []
    for k in range(options.runs):
        if stop("simulated calibration", k / options.runs):
            raise Stopped
        ended.append(next(runs))
    errors = [error for error in ended if error is not None]
    plan.errors, plan.lost = np.array(errors).reshape(-1, len(u.names)), len(ended) - len(errors)
