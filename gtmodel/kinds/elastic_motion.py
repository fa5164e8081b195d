"""Kind "elastic_motion": how an elastic tool swings after motions planned rigid, shaped, and planned elastic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from gtmodel.compiler.causal import compile_causal
from gtmodel.control import residual_vibration, zero_vibration, zero_vibration_derivative
from gtmodel.lang import Model, Optimization
from gtmodel.motion.finer_mesh import elements_after, refined, told
from gtmodel.optimize import Mesh, Solution, SolverOptions, resimulate
from gtmodel.optimize import solve as collocate
from gtmodel.problem_files.base import TRAJECTORY, Context, InputError, Outcome, Row, Section, at_most
from gtmodel.problem_files.path_keys import Point
from gtmodel.problem_files.robot_keys import RobotProblem
from gtmodel.problem_files.solver_keys import Barrier, MostElements
from gtmodel.results import SolveStatus, Status, Trajectory
from gtmodel.results.check import failed_of
from gtmodel.robots import GantryTau

from .elastic_motion_models import ElasticMotion, RigidMotion

NAME = "elastic_motion"

VALUES = {
    "motions": "for each of rigid, ZV, ZVD and elastic: final_time_s, residual_mm (amplitude of the tool against the "
    "plate once that stands, root of the sum of squares of three directions), residual_10_percent_mm (the worst of a "
    "mode 10 % slower and faster than planned), peak_force_N: of the plans their own, of shaped "
    "ones what the robot with a rigid tool needs",
    "frequency_Hz": "of the tool on its spring, the plate held",
    "static_mm": "by which the tool hangs",
    "elements": "elements of the mesh: those of the file, or more where a check failed on them",
    "resimulated_end_mm": "offset of the tool from where it hangs after an integrator ran the elastic plan's forces",
}

SAMPLES = 4001  # of a motion, at least
PER_PERIOD = 200  # samples of a swing's period, at least
MOST_SAMPLES = 400_001
OFF = 0.1  # error of the frequency that is reported
RATIOS = np.linspace(0.6, 1.4, 81)
SHARE = 0.01  # of the rigid plan's swing; 40 elements leave 0.4 %, shaping a part in a million
MENDED = ("elastic_share_of_rigid", "resimulated_end_mm")  # by a finer mesh
RESIMULATED_MM = 0.5  # collocation's error, as an integrator shows it
FORCE_SHARE = 1e-3  # of the limit: beyond, a motion passes it
GRAVITY = 9.81
TO_A_PERIOD = 5  # elements: six leave 0.4 % of the rigid plan's swing, 3.8 leave 3 %, 1.8 leave half
MOST_ELEMENTS = 1000


class Point3(Section):
    """Where the motion begins or ends, at rest."""

    tcp_m: Point = Field(description="tool centre point, three coordinates in the robot's frame")


class Limits(Section):
    """What the motors can."""

    force_N: PositiveFloat = Field(description="largest force of each motor")


class Tool(Section):
    """A mass on a spring at the plate, alike in all directions."""

    mass_kg: PositiveFloat = Field(description="of what swings; the plans with a rigid tool carry it as payload")
    frequency_Hz: PositiveFloat = Field(description="with the plate held")
    damping: float = Field(default=0.0, ge=0, lt=1, description="damping ratio")


class Cost(Section):
    """Final time plus weighted energy."""

    energy: NonNegativeFloat = Field(default=0.01, description="weight w of sum int (F / force_unit_N)^2")
    force_unit_N: PositiveFloat = Field(default=112.90322580645162, description="unit of force in the energy")


class MeshKeys(Section):
    """Where the equations are collocated."""

    elements: PositiveInt = Field(default=40, le=MOST_ELEMENTS, description="of the horizon, three points each")
    most_elements: MostElements = 160


class Solver(Section):
    """How the plans are found."""

    barrier: Barrier = "auto"


class Schema(RobotProblem):
    """Residual vibration of an elastic tool of a three-link robot."""

    start: Point3
    goal: Point3
    limits: Limits
    tool: Tool
    cost: Cost = Cost()
    mesh: MeshKeys = MeshKeys()
    solver: Solver = Solver()


@dataclass(frozen=True, eq=False)
class _Motion:
    """A motion of the plate, its name, and the largest force on the way [N]."""

    name: str
    plate: Trajectory
    peak: float

    def residual(self, ratios: Any, tool: Tool) -> np.ndarray:
        """Amplitude [m] for modes at these ratios to the planned frequency."""
        v = self.plate["der(T)"]
        by_direction = residual_vibration(self.plate.time, v, np.asarray(ratios) * tool.frequency_Hz, tool.damping)
        return np.linalg.norm(by_direction, axis=-1)


def solve(problem: Schema, context: Context) -> Outcome:
    """The rigid optimum, its shaped versions, the elastic optimum, and what each leaves; on a finer mesh where a check
    fails that it can mend."""
    if context.start is not None:
        raise InputError("--start: the elastic plan starts from the rigid one; leave it out")
    tool, heavy = problem.tool, problem.model_copy(
        update={"payload_kg": (problem.payload_kg or 0.0) + problem.tool.mass_kg}
    )  # fmt: skip
    robot = _three_link(heavy.model(context))
    _refuse_unreachable(robot, problem)
    if np.linalg.norm(np.subtract(problem.goal.tcp_m, problem.start.tcp_m)) < 1e-6:
        raise InputError("is where the motion starts; nothing moves, nothing swings: give another place", "goal.tcp_m")
    k = _stiffness(tool)
    d = 2 * tool.damping * np.sqrt(k * tool.mass_kg)
    bare = _values(_three_link(problem.model(context)), problem)
    elastic = ElasticMotion(**bare, mass=tool.mass_kg, K=k * np.eye(3), D=d * np.eye(3))
    models = RigidMotion(**_values(robot, problem)), elastic
    given = _on_this_mesh(problem, robot, models, None, context)
    if isinstance(given, Outcome):
        return given
    iterations = given.iterations

    def again(before: _Found, finer: Schema) -> _Found | str:
        nonlocal iterations
        after = _on_this_mesh(finer, robot, models, before, context)
        iterations += after.iterations or 0
        return f"on {finer.mesh.elements} elements: {after.message}" if isinstance(after, Outcome) else after

    found, trouble = refined(given, _finer, again, context.interrupted)
    failed = failed_of(given.checks)
    finer = told(problem.mesh.elements, found.problem.mesh.elements, failed)
    return _outcome(found, iterations, finer, trouble)


@dataclass(frozen=True, eq=False)
class _Found:
    """The plans on one mesh, their iterations, the motions compared by name, and the checks.

    left: offset of the tool [m] from where it hangs after an integrator ran the elastic plan's forces.
    """

    problem: Schema
    rigid: Solution
    elastic: Solution
    motions: list[_Motion]
    table: dict[str, dict[str, float]]
    left: float
    checks: dict[str, Any]

    @property
    def iterations(self) -> int:
        return self.rigid.iterations + self.elastic.iterations


def _finer(found: _Found) -> Schema | None:
    """The problem on a finer mesh where a check failed that it can mend."""
    mesh = found.problem.mesh
    elements = elements_after(mesh.elements, mesh.most_elements, found.checks, MENDED)
    if elements is None:
        return None
    return found.problem.model_copy(update={"mesh": mesh.model_copy(update={"elements": elements})})


def _on_this_mesh(
    problem: Schema,
    robot: GantryTau,
    models: tuple[RigidMotion, ElasticMotion],
    before: _Found | None,
    context: Context,
) -> _Found | Outcome:
    """The plans on the problem's mesh, from those before, and what they leave; an outcome where one is not found."""
    tool = problem.tool
    rigid = _planned(models[0], problem, context, "rigid plan", before.rigid if before else None)
    if not rigid.status.ok:
        return Outcome(status=rigid.status, message=f"rigid plan: {rigid.message}", iterations=rigid.iterations)
    plate = _sampled(rigid, tool)
    elastic = _planned(models[1], problem, context, "elastic plan", before.elastic if before else rigid.trajectory)
    if not elastic.status.ok:
        coarse = _too_coarse(problem, rigid.final_time)
        message = "; ".join([f"elastic plan: {elastic.message}", *coarse])
        return Outcome(status=elastic.status, message=message, iterations=rigid.iterations + elastic.iterations)
    context.progress("comparing", 0.9)
    motions = [_Motion("rigid", plate, float(np.abs(plate["tau"]).max()))]
    for name, make in (("ZV", zero_vibration), ("ZVD", zero_vibration_derivative)):
        shaped = make(tool.frequency_Hz, tool.damping)(plate, ["T", "der(T)", "der(T,2)"])
        motions.append(_Motion(name, shaped, _peak(robot, shaped)))
    own = _sampled(elastic, tool)
    motions.append(_Motion("elastic", own, float(np.abs(own["tau"]).max())))
    return _judged(problem, motions, rigid, elastic)


def _judged(problem: Schema, motions: list[_Motion], rigid: Solution, elastic: Solution) -> _Found:
    tool, table = problem.tool, {}
    for m in motions:
        off = m.residual([1 - OFF, 1 + OFF], tool)
        table[m.name] = {
            "final_time_s": m.plate.duration, "residual_mm": 1e3 * float(m.residual([1.0], tool)[0]),
            "residual_10_percent_mm": 1e3 * float(off.max()), "peak_force_N": m.peak,
        }  # fmt: skip
    again = resimulate(elastic)
    hang = np.array([0.0, 0.0, -_static(tool)])
    left = np.inf if again.trajectory is None else float(np.linalg.norm(again.trajectory["spring.offset"][-1] - hang))
    whole = table["rigid"]["residual_mm"]
    checks = {f"{n}_share_of_rigid": at_most(table[n]["residual_mm"] / whole, SHARE) for n in ("ZV", "ZVD", "elastic")}
    checks["resimulated_end_mm"] = at_most(1e3 * left, RESIMULATED_MM)
    return _Found(problem, rigid, elastic, motions, table, left, checks)


def _stiffness(tool: Tool) -> float:
    return tool.mass_kg * (2 * np.pi * tool.frequency_Hz) ** 2


def _static(tool: Tool) -> float:
    """By which the tool hangs [m]."""
    return GRAVITY * tool.mass_kg / _stiffness(tool)


def explain(problem: Schema, context: Context) -> str:
    """What is planned and compared."""
    _three_link(problem.model(context))
    t = problem.tool
    return "\n".join(
        [
            f"{problem.title or NAME}: {t.mass_kg:g} kg on a spring, {t.frequency_Hz:g} Hz, damping {t.damping:g}",
            "  rigid: time and energy with the tool as payload; ZV, ZVD: that motion shaped",
            "  elastic: the spring in the equations, the tool at rest at the end as a constraint",
            *(f"  {sentence}" for sentence in ASSUMED),
        ]
    )


ASSUMED = (
    "the plate follows its motion exactly: the tool's swing does not push it back",
    "plans keep the force limit at every instant; shaped motions need what the table says",
    "shaped motions leave the planned path, within its convex hull",
)


def _three_link(model: Model) -> GantryTau:
    if not isinstance(model, GantryTau):
        raise InputError(
            f"is a {type(model).__name__}; elastic plans are made for three-link robots such as l1_tape", "robot"
        )
    return model


def _refuse_unreachable(robot: GantryTau, problem: Schema) -> None:
    inverse = compile_causal(robot, known="T", targets="q")
    for key, end in (("start.tcp_m", problem.start), ("goal.tcp_m", problem.goal)):
        if inverse(end.tcp_m)[-1] != Status.OK:
            raise InputError(f"cannot be reached: {inverse.diagnose(end.tcp_m)}", key)


def _values(robot: GantryTau, problem: Schema) -> dict[str, Any]:
    return {
        **robot.__dict__["_modifiers"],
        "F_max": problem.limits.force_N,
        "weight": problem.cost.energy,
        "F_unit": problem.cost.force_unit_N,
        "start": problem.start.tcp_m,
        "goal": problem.goal.tcp_m,
    }


def _planned(model: Optimization, problem: Schema, context: Context, stage: str, guess: Any) -> Solution:
    def progress(iteration: int, objective: float, violation: float) -> bool:
        numbers = {"iteration": iteration, "objective": objective, "violation": violation}
        context.progress(stage, None, numbers)
        return context.interrupted()

    mesh = Mesh(elements=problem.mesh.elements, control="bernstein")  # forces keep their limit at every instant
    options = SolverOptions(barrier=problem.solver.barrier, error_bound=None)  # the plan is judged by its re-simulation
    return collocate(model, mesh=mesh, guess=guess, solver=options, progress=progress, throw=False)


def _sampled(solution: Solution, tool: Tool) -> Trajectory:
    """The plate along the collocated polynomials; its ends, at rest to the solver's tolerance, are put to rest."""
    n = _samples(solution.trajectory.duration, tool)
    found = solution.sample(np.linspace(0.0, 1.0, n)).select(["T", "der(T)", "der(T,2)", "tau"])
    v = found["der(T)"].copy()
    v[[0, -1]] = 0.0
    return found.with_values({"der(T)": v}, {"der(T)": "m/s"})


def _samples(duration: float, tool: Tool) -> int:
    """Instants of a motion that follow its swing; raises InputError for a frequency that they cannot follow."""
    n = max(SAMPLES, int(np.ceil(PER_PERIOD * duration * tool.frequency_Hz)) + 1)
    if n > MOST_SAMPLES:
        most = MOST_SAMPLES / PER_PERIOD / duration
        raise InputError(f"is too fast to be followed; at most {most:.3g} Hz in {duration:.3g} s", "tool.frequency_Hz")
    return n


def _peak(robot: GantryTau, plate: Trajectory) -> float:
    inverse = compile_causal(robot, known="T", targets="tau")
    tau, status = inverse(plate["T"], plate["der(T)"], plate["der(T,2)"])
    return float(np.abs(tau).max()) if np.all(status == Status.OK) else np.inf


def _outcome(found: _Found, iterations: int, finer: str, trouble: str) -> Outcome:
    """finer: what is to be said of a refined mesh. trouble: what ended its refinement."""
    problem, elastic, table = found.problem, found.elastic, found.table
    tool, static, left = problem.tool, _static(problem.tool), found.left
    rows = [
        Row(name, f"{t['final_time_s']:.4f} s, swings {t['residual_mm']:.3g} mm; {100 * OFF:g} % off "
            f"{t['residual_10_percent_mm']:.3g} mm; largest force {t['peak_force_N']:.4g} N")
        for name, t in table.items()
    ]  # fmt: skip
    rows += [
        Row("the tool hangs by", 1e3 * static, "mm"),
        Row("elastic plan, re-simulated: tool off", 1e3 * left, "mm"),
    ]
    rows += [Row("look at this", sentence) for sentence in _too_coarse(problem, elastic.final_time)]
    if finer:
        rows.append(Row("elements of the mesh, refined", problem.mesh.elements))
    limit = problem.limits.force_N
    for name, m in table.items():
        over = m["peak_force_N"] / limit - 1
        if over > FORCE_SHARE:
            said = f"by {100 * over:.2g} %: plan with limits.force_N = {limit / (1 + over):.3g} to stay near it"
            rows.append(Row(f"{name} passes the force limit", said))
    rows += [Row("assumed", sentence) for sentence in ASSUMED]
    title = problem.title or f"vibration of {problem.robot}"
    ends = "; ".join(f"{n} {t['final_time_s']:.4g} s, {t['residual_mm']:.3g} mm" for n, t in table.items())
    outcome = Outcome(
        status=SolveStatus.SOLVED,
        message=ends,
        objective=elastic.objective,
        iterations=iterations,
        checks=found.checks,
        values={"motions": table, "frequency_Hz": tool.frequency_Hz, "static_mm": 1e3 * static,
                "elements": problem.mesh.elements, "resimulated_end_mm": 1e3 * left},
        trajectory=elastic.trajectory,
        machine_files=(TRAJECTORY,),
        rows=rows,
        figures={"swing": lambda: _figure(found.motions, tool, title)},
    )  # fmt: skip
    plans = (("rigid", found.rigid), ("elastic", elastic))
    open_ends = [f"{name} plan: {plan.reservation}" for name, plan in plans if plan.reservation]
    return outcome.with_(message="; ".join(filter(None, [outcome.message, finer.strip(), trouble, *open_ends])))


def _too_coarse(problem: Schema, duration: float) -> list[str]:
    """A sentence where the elements of the mesh are too long for the tool's swing."""
    elements, frequency = problem.mesh.elements, problem.tool.frequency_Hz
    wanted = int(np.ceil(TO_A_PERIOD * duration * frequency))
    if elements >= wanted:
        return []
    found = f"mesh.elements = {elements} are {elements / (duration * frequency):.2g} to a period of the tool's swing"
    if wanted <= MOST_ELEMENTS:
        return [f"{found}, which the elastic plan cannot follow: take at least {wanted}"]
    return [f"{found}; no mesh here follows it, a tool so stiff hardly swings: plan with it as payload"]


def _figure(motions: list[_Motion], tool: Tool, title: str) -> Any:
    from gtmodel.plot.elastic_motion import swing_figure

    swings = {m.name: _swing(m.plate, tool) for m in motions}
    curves = {m.name: m.residual(RATIOS, tool) for m in motions}
    return swing_figure(swings, RATIOS, curves, title=title)


def _swing(plate: Trajectory, tool: Tool) -> tuple[np.ndarray, np.ndarray]:
    """Times and offsets (n, 3) [m] of the tool during the motion and six periods after it, integrated exactly for
    velocities linear between samples."""
    from scipy.signal import StateSpace, lsim

    w = 2 * np.pi * tool.frequency_Hz
    n = _samples(plate.duration, tool)
    step = plate.duration / (n - 1)
    after = np.arange(1, int(6 / tool.frequency_Hz / step)) * step
    t = np.linspace(0.0, plate.duration, n)
    v = np.vstack([plate(t + plate.time[0], "der(T)"), np.zeros((len(after), 3))])
    # z' = -w^2 x - 2 zeta w (z - v), x' = z - v: driven by the velocity, so that steps of the acceleration need no care
    c = 2 * tool.damping * w
    system = StateSpace([[0.0, 1.0], [-(w**2), -c]], [[-1.0], [c]], [[1.0, 0.0]], [[0.0]])
    time = np.concatenate([t, t[-1] + after])
    return time, np.column_stack([lsim(system, v[:, k], time)[1] for k in range(3)])
