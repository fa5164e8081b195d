"""The compared plans on one mesh (rigid, shaped, elastic), and the vibration of an elastic tool after a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ... import lang as gt
from ..._pickling import Portable
from ...compiler.causal import CausalFunction, compile_causal
from ...control.input_shaping import residual_vibration, zero_vibration, zero_vibration_derivative
from ...lang import Model, Optimization
from ...mechanics import PointMass, PointSpringDamper
from ...optimize import Mesh as CollocationMesh, Solution, SolverOptions, resimulate, solve as collocate
from ...results import ArgumentError, Check, SolveStatus, Status, Trajectory, Work, at_most
from ...robots import GantryTau
from .options import MOST_ELEMENTS, OFF, ElasticCost, ElasticMesh, ElasticSolver, ElasticTool


class RigidMotion(GantryTau, gt.Optimization):
    """The optimal motion from rest to rest between two points: cost time plus energy, motor forces within +-F_max.

    `ElasticTask.models` builds it for a robot that carries the tool as payload.

    >>> from gtmodel.motion.elastic import ElasticCost, ElasticSolver, ElasticTask, ElasticTool
    >>> tool = ElasticTool(mass=5.0, frequency=6.0, damping=0.02)
    >>> task = ElasticTask(
    ...     robot=gt.robots.gantry_tau("l1_tape"), start=[0.0, -0.9, 0.1], goal=[0.2, -0.9, 0.2],
    ...     tool=tool, force=700.0, cost=ElasticCost(), solver=ElasticSolver(),
    ... )
    >>> rigid, _ = task.models
    >>> round(gt.solve(rigid, gt.Mesh(8)).final_time, 2)  # [s]
    0.37
    """

    final_time = gt.free(guess=1.2, min=0.2, unit="s")
    F_max = gt.parameter(unit="N", positive=True, description="largest force of a motor")
    weight = gt.parameter(0.0, unit="1", description="weight of the energy in the cost")
    F_unit = gt.parameter(unit="N", positive=True, description="reference force in the energy")
    start = gt.parameter(shape=3, unit="m", description="tool centre point at the start")
    goal = gt.parameter(shape=3, unit="m", description="tool centre point at the goal")

    def objective(self):
        return self.final_time + self.weight * gt.integral(gt.dot(self.tau, self.tau) / self.F_unit**2)

    def constraints(self):
        yield gt.between(-self.F_max, self.tau, self.F_max)
        for instant, place in ((0, self.start), (self.final_time, self.goal)):
            yield self.T.at(instant) == place
            yield gt.der(self.T).at(instant) == np.zeros(3)


class ElasticMotion(RigidMotion):
    """`RigidMotion` with a mass on a spring at the plate; the mass is in static equilibrium at the start and the end.

    Raises ModelError for a negative mass, and for a stiffness or damping that is not positive semidefinite.

    >>> from gtmodel.motion.elastic import ElasticCost, ElasticSolver, ElasticTask, ElasticTool
    >>> tool = ElasticTool(mass=5.0, frequency=6.0, damping=0.02)
    >>> task = ElasticTask(
    ...     robot=gt.robots.gantry_tau("l1_tape"), start=[0.0, -0.9, 0.1], goal=[0.2, -0.9, 0.2],
    ...     tool=tool, force=700.0, cost=ElasticCost(), solver=ElasticSolver(),
    ... )
    >>> rigid, elastic = task.models
    >>> solution = gt.solve(elastic, gt.Mesh(8), guess=gt.solve(rigid, gt.Mesh(8)).trajectory)
    >>> round(1e3 * float(solution.trajectory["spring.offset"][-1, 2]), 1)  # [mm]: static deflection
    -6.9
    """

    mass = gt.parameter(unit="kg", positive=True, description="mass on the spring")
    K = gt.parameter(shape=(3, 3), unit="N/m", kind="semidefinite", description="stiffness in world axes")
    D = gt.parameter(np.zeros((3, 3)), unit="N.s/m", kind="semidefinite", description="damping in world axes")
    spring = gt.part(PointSpringDamper, K=K, D=D)
    tool = gt.part(PointMass, m=mass)

    def equations(self):
        yield from super().equations()
        yield gt.connect(self.spring.a, self.plate.frame)
        yield gt.connect(self.spring.b, self.tool.frame)

    def constraints(self):
        yield from super().constraints()
        weight = self.mass * self.tool.world.g
        for instant in (0, self.final_time):
            yield (self.K @ self.spring.offset).at(instant) == weight
            yield gt.der(self.spring.offset).at(instant) == np.zeros(3)


Array = np.ndarray
SAMPLES = 4001  # smallest number of samples of a motion
PER_PERIOD = 200  # smallest number of samples per period of the vibration
MOST_SAMPLES = 400_001
AFTER = 6  # simulated periods after the motion


@dataclass(frozen=True, eq=False)
class PlateMotion:
    """A motion of the plate, its name, and its peak force [N]."""

    name: str
    plate: Trajectory
    peak: float

    def residual(self, ratios: Any, tool: ElasticTool) -> Array:
        """Return the residual amplitude [m] for modes at these ratios to the planned frequency."""
        v = self.plate["der(T)"]
        by_direction = residual_vibration(self.plate.time, v, np.asarray(ratios) * tool.frequency, tool.damping)
        return np.linalg.norm(by_direction, axis=-1)


def sampled(solution: Solution, tool: ElasticTool) -> Trajectory:
    """Sample the plate's motion from the collocation polynomials; end velocities are set to exactly zero."""
    n = _samples(solution.trajectory.duration, tool)
    plate = solution.sample(np.linspace(0.0, 1.0, n)).select(["T", "der(T)", "der(T,2)", "tau"])
    v = plate["der(T)"].copy()
    v[[0, -1]] = 0.0
    return plate.with_values({"der(T)": v}, {"der(T)": "m/s"})


def swing(plate: Trajectory, tool: ElasticTool) -> tuple[Array, Array]:
    """Return times and offsets (n, 3) [m] of the tool during a motion and for AFTER periods after it.

    The integration is exact for velocities linear between samples. plate: a trajectory from rest to rest with the
    velocity "der(T)" (n, 3) [m/s].

    >>> t = np.linspace(0.0, 0.5, 101)
    >>> velocity = np.outer(np.sin(np.pi * t / 0.5), [0.2, 0.0, 0.0])
    >>> plate = gt.Trajectory(t, {"der(T)": velocity}, {"der(T)": "m/s"})
    >>> tool = gt.motion.elastic.ElasticTool(mass=5.0, frequency=6.0)
    >>> time, offset = gt.motion.elastic.swing(plate, tool)
    >>> (1e3 * np.abs(offset[time > 0.5]).max(axis=0)).round(2)  # [mm], undamped
    array([1.82, 0.  , 0.  ])
    """
    from scipy.signal import StateSpace, lsim

    w = 2 * np.pi * tool.frequency
    n = _samples(plate.duration, tool)
    step = plate.duration / (n - 1)
    after = np.arange(1, int(AFTER / tool.frequency / step)) * step
    t = np.linspace(0.0, plate.duration, n)
    v = np.vstack([plate(t + plate.time[0], "der(T)"), np.zeros((len(after), 3))])
    # z' = -w^2 x - 2 zeta w (z - v), x' = z - v: the input is the velocity, so steps of the acceleration are harmless
    c = 2 * tool.damping * w
    system = StateSpace([[0.0, 1.0], [-(w**2), -c]], [[-1.0], [c]], [[1.0, 0.0]], [[0.0]])
    time = np.concatenate([t, t[-1] + after])
    return time, np.column_stack([lsim(system, v[:, k], time)[1] for k in range(3)])


def _samples(duration: float, tool: ElasticTool) -> int:
    """Return the number of samples that resolves the vibration. Raises ArgumentError for too high a frequency."""
    n = max(SAMPLES, int(np.ceil(PER_PERIOD * duration * tool.frequency)) + 1)
    if n > MOST_SAMPLES:
        most = MOST_SAMPLES / PER_PERIOD / duration
        raise ArgumentError(f"is too high; expected at most {most:.3g} Hz for {duration:.3g} s", "tool.frequency")
    return n


SHARE = 0.01  # of the rigid plan's residual; 40 elements leave 0.4 %, shaping one part in a million
RESIMULATED_M = 5e-4  # bound of the collocation error found by re-simulation
MENDED = ("elastic_share_of_rigid", "resimulated_end_mm")  # by a finer mesh
TO_A_PERIOD = 5  # elements per period: 6 leave 0.4 % of the rigid plan's residual, 3.8 leave 3 %, 1.8 leave half
SAME_M = 1e-6  # ends closer than this coincide


@dataclass(frozen=True, kw_only=True, eq=False)
class ElasticTask:
    """A planning task: a robot without its tool, ends [m], the motors' limit [N], and options.

    Raises ArgumentError for a robot that is not three-link, and for ends that are out of reach or equal.
    """

    robot: Model
    start: Sequence[float]
    goal: Sequence[float]
    tool: ElasticTool
    force: float
    cost: ElasticCost
    solver: ElasticSolver

    def __post_init__(self) -> None:
        three_link(self.robot)
        f = self.inverse
        for name, end in (("start", self.start), ("goal", self.goal)):
            if f(end)[-1] != Status.OK:
                raise ArgumentError(f"is out of reach: {f.diagnose(end)}", name)
        if np.linalg.norm(np.subtract(self.goal, self.start)) < SAME_M:
            raise ArgumentError("equals the start; give another goal", "goal")

    @cached_property
    def carrying(self) -> GantryTau:
        """The robot with the tool as payload."""
        robot = three_link(self.robot)
        return robot.with_(m_p=robot.m_p + self.tool.mass)

    @cached_property
    def inverse(self) -> CausalFunction:
        """T -> q of the robot with the tool as payload."""
        return compile_causal(self.carrying, known="T", targets="q")

    @cached_property
    def models(self) -> tuple[RigidMotion, ElasticMotion]:
        """The optimisations with the tool as payload and with the elastic tool."""
        k = self.tool.stiffness
        d = 2 * self.tool.damping * np.sqrt(k * self.tool.mass)
        elastic = ElasticMotion(**self._values(self.robot), mass=self.tool.mass, K=k * np.eye(3), D=d * np.eye(3))
        return RigidMotion(**self._values(self.carrying)), elastic

    def _values(self, robot: Model) -> dict[str, Any]:
        ends = {"start": self.start, "goal": self.goal}
        cost = {"weight": self.cost.energy, "F_unit": self.cost.force_unit}
        return {**robot._modifiers, "F_max": self.force, **cost, **ends}


def too_coarse(tool: ElasticTool, mesh: ElasticMesh, duration: float) -> list[str]:
    """Return a sentence if the elements of the mesh are too long for the tool's vibration."""
    elements, frequency = mesh.elements, tool.frequency
    required = int(np.ceil(TO_A_PERIOD * duration * frequency))
    if elements >= required:
        return []
    fact = f"mesh.elements = {elements} gives {elements / (duration * frequency):.2g} elements per vibration period"
    if required <= MOST_ELEMENTS:
        return [f"{fact}, too few for the elastic plan; use at least {required} elements"]
    return [f"{fact}, too few with any mesh; such a stiff tool hardly vibrates, so treat it as payload"]


def three_link(robot: Model) -> GantryTau:
    """Return the robot if it is three-link. Raises ArgumentError."""
    if type(robot) is not GantryTau:  # plans use its equations; a subclass may have others
        raise ArgumentError(
            f"is a {type(robot).__name__}; elastic plans need a three-link robot such as l1_tape", "robot"
        )
    return robot


@dataclass(frozen=True, eq=False)
class Plans(Portable):
    """The plans on one mesh, the compared motions, their table of results by name, and the checks.

    left: offset of the tool [m] from its static equilibrium after re-simulating the elastic plan's forces.
    """

    task: ElasticTask
    mesh: ElasticMesh
    rigid: Solution
    elastic: Solution
    motions: list[PlateMotion]
    table: dict[str, dict[str, float]]
    left: float
    checks: dict[str, Check]

    @property
    def iterations(self) -> int:
        return self.rigid.iterations + self.elastic.iterations


@dataclass(frozen=True)
class PlansFailure:
    """Why a plan was not solved, and the iterations of all plans."""

    status: SolveStatus
    message: str
    iterations: int


def plans_on(mesh: ElasticMesh, task: ElasticTask, before: Plans | None, work: Work) -> Plans | PlansFailure:
    """Compute the plans on a mesh, starting from previous plans, and evaluate them; or return the failure.

    >>> from gtmodel.motion.elastic import ElasticCost, ElasticMesh, ElasticSolver, ElasticTask, ElasticTool, plans_on
    >>> tool = ElasticTool(mass=5.0, frequency=6.0, damping=0.02)
    >>> task = ElasticTask(
    ...     robot=gt.robots.gantry_tau("l1_tape"), start=[0.0, -0.9, 0.1], goal=[0.2, -0.9, 0.2],
    ...     tool=tool, force=700.0, cost=ElasticCost(), solver=ElasticSolver(),
    ... )
    >>> plans = plans_on(ElasticMesh(elements=8), task, None, gt.results.Work())
    >>> plans.table["ZV"]["residual_mm"] < 1e-3 * plans.table["rigid"]["residual_mm"]
    True
    """

    def planned(model: Optimization, stage: str, guess: Any) -> Solution:
        # Bernstein control: forces keep their limit at every instant; the plan is assessed by its re-simulation
        fine = CollocationMesh(mesh.elements, control="bernstein")
        options = SolverOptions(barrier=task.solver.barrier, error_bound=None)
        progress = work.iterations(stage)
        return collocate(model, mesh=fine, guess=guess, solver=options, progress=progress, throw=False)

    of_rigid, of_elastic = task.models
    rigid = planned(of_rigid, "rigid plan", before.rigid if before else None)
    if not rigid.status.ok:
        return PlansFailure(rigid.status, f"rigid plan: {rigid.message}", rigid.iterations)
    plate = sampled(rigid, task.tool)
    elastic = planned(of_elastic, "elastic plan", before.elastic if before else rigid.trajectory)
    if not elastic.status.ok:
        message = "; ".join([f"elastic plan: {elastic.message}", *too_coarse(task.tool, mesh, rigid.final_time)])
        return PlansFailure(elastic.status, message, rigid.iterations + elastic.iterations)
    work.progress("comparing", 0.9)
    tool = task.tool
    motions = [PlateMotion("rigid", plate, _largest(plate["tau"]))]
    for name, make in (("ZV", zero_vibration), ("ZVD", zero_vibration_derivative)):
        shaped = make(tool.frequency, tool.damping)(plate, ["T", "der(T)", "der(T,2)"])
        motions.append(PlateMotion(name, shaped, _peak(task.carrying, shaped)))
    elastic_plate = sampled(elastic, tool)
    motions.append(PlateMotion("elastic", elastic_plate, _largest(elastic_plate["tau"])))
    return _judged(task, mesh, motions, rigid, elastic)


def _judged(
    task: ElasticTask, mesh: ElasticMesh, motions: list[PlateMotion], rigid: Solution, elastic: Solution
) -> Plans:
    tool, table = task.tool, {}
    for m in motions:
        detuned = m.residual([1 - OFF, 1 + OFF], tool)
        table[m.name] = {
            "final_time_s": m.plate.duration, "residual_mm": 1e3 * float(m.residual([1.0], tool)[0]),
            "residual_10_percent_mm": 1e3 * float(detuned.max()), "peak_force_N": m.peak,
        }  # fmt: skip
    run = resimulate(elastic)
    rest = np.array([0.0, 0.0, -tool.sag])
    left = np.inf if run.trajectory is None else float(np.linalg.norm(run.trajectory["spring.offset"][-1] - rest))
    rigid_mm = table["rigid"]["residual_mm"]
    checks = {
        f"{n}_share_of_rigid": at_most(table[n]["residual_mm"] / rigid_mm, SHARE) for n in ("ZV", "ZVD", "elastic")
    }
    checks["resimulated_end_mm"] = at_most(1e3 * left, 1e3 * RESIMULATED_M)
    return Plans(task, mesh, rigid, elastic, motions, table, left, checks)


def _peak(robot: GantryTau, plate: Any) -> float:
    inverse = compile_causal(robot, known="T", targets="tau")
    tau, status = inverse(plate["T"], plate["der(T)"], plate["der(T,2)"])
    return _largest(tau) if np.all(status == Status.OK) else np.inf


def _largest(tau: np.ndarray) -> float:
    return float(np.abs(tau).max())
