"""The study of assembly modes: poses from arguments or from a file, the commanded mode of each pose, certificates and
checks."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from ...geometry.quaternions import quaternion_of, zyz_quaternion
from ...lang import Model, ModelError
from ...measurements.signal_table import CsvTable
from ...results import ArgumentError, Check, SolveStatus, Work, at_most, naming
from ...results.disk import path_of
from ...results.status import ModesStatus
from ...results.work import WorkOptions, study_function
from ...view.bodies import COLOURS
from ...view.space import RobotScene, VisiblePart
from ..causality.point_table import UNIT_LENGTH
from .modes import AssemblyModes
from .options import COLUMNS, CommandedPose, ModesStudy
from .six_links import Hands, SixLinks, six_links_of
from .solve import assembly_modes_batch

# largest difference of a commanded pose from its mode, relative to the size or in rad: rounding times condition number
COMMANDED = 1e-9


@dataclass(frozen=True)
class Judged:
    """Poses with their modes. commanded: index of each pose's commanded mode, or None.

    errors: difference between the commanded pose and the nearest mode, the larger of relative distance and angle
    [rad]; NaN without a commanded pose.
    """

    hands: Hands
    results: list[AssemblyModes]
    commanded: list[int | None]
    errors: list[float]

    @classmethod
    def of(cls, hands: Hands, results: list[AssemblyModes]) -> Judged:
        """Find every commanded pose among the real modes."""
        commanded: list[int | None] = []
        errors = []
        for i, modes in enumerate(results):
            if not np.isfinite(hands.T[i]).all() or not np.isfinite(hands.R[i]).all():
                commanded.append(None)
                errors.append(math.nan)
                continue
            k, distance, angle = modes.nearest(hands.R[i], hands.T[i])
            error = max(distance / modes.size, math.radians(angle)) if k >= 0 else math.inf
            commanded.append(k if error <= COMMANDED else None)
            errors.append(error)
        return cls(hands, results, commanded, errors)

    def done(self, i: int) -> bool:
        """Return True if the search for a pose was completed."""
        return self.results[i].status not in (ModesStatus.INTERRUPTED, ModesStatus.BAD_INPUT)

    def refused(self) -> list[str]:
        """Return the messages of invalid poses."""
        return [self.message(i) for i, r in enumerate(self.results) if r.status is ModesStatus.BAD_INPUT]

    def message(self, i: int) -> str:
        """Return the message of a pose."""
        return self.hands.faults.get(i) or self.results[i].message

    def leg_error(self, i: int) -> float:
        """Return the largest error of an unscaled leg length at a real mode, relative to the size."""
        hands, modes = self.hands, self.results[i]
        joints = modes.T[:, None] + hands.B[i] @ np.swapaxes(modes.R, 1, 2)
        errors = np.abs(np.linalg.norm(joints - hands.A[i], axis=2) - hands.L[i])
        return float(np.max(errors, initial=0.0)) / modes.size if errors.size else 0.0

    def commanded_nearest(self, i: int) -> tuple[float, float]:
        """Return distance [m] and angle [deg] between the commanded mode and its nearest real mode.

        NaN without a commanded mode, infinite without another real mode.
        """
        k = self.commanded[i]
        if k is None:
            return math.nan, math.nan
        return float(self.results[i].nearest_distance[k]), float(self.results[i].nearest_angle_deg[k])


def read_poses(path: str | Path) -> list[CommandedPose]:
    """Read poses from a CSV file, one per row, with the columns of COLUMNS. Raises ArgumentError.

    >>> from pathlib import Path
    >>> from gtmodel.kinematics.assembly_modes import read_poses
    >>> _ = Path("poses.csv").write_text("q1_m,q2_m,q3_m,q4_deg,q5_deg,q6_deg\\n0.7,0.3,0.2,90,0,0\\n")
    >>> read_poses("poses.csv")[0].axes
    [1.5707963267948966, 0.0, 0.0]
    """
    path = path_of(path)
    with naming("poses"):
        table = CsvTable(path)
    header = table.names
    groups = [
        (name, columns, f) for name, units in COLUMNS.items() for columns, f in units.items() if {*columns} & {*header}
    ]
    known = [column for _, columns, _ in groups for column in columns]
    missing = [column for column in known if column not in header]
    if missing or not groups:
        expected = ", ".join(missing) or "q1_m, q2_m, q3_m or x_m, y_m, z_m"
        raise ArgumentError(f"{path.name} lacks the columns {expected}; it has {', '.join(header)}", "poses")
    unknown = [column for column in header if column not in known]
    if unknown:
        raise ArgumentError(f"{path.name} has unknown columns: {', '.join(unknown)}; remove them", "poses")
    twice = [columns for name, columns, _ in groups if sum(name == n for n, _, _ in groups) > 1]
    if twice:
        raise ArgumentError(f"{path.name} has {' and '.join(c[0] for c in twice)}; give only one of them", "poses")
    with naming("poses"):
        numbers = {c: table.numbers(c).tolist() for c in known}
    return [
        CommandedPose(**{name: [f * numbers[c][k] for c in columns] for name, columns, f in groups})
        for k in range(len(table.lines))
    ]


def hands_of(robot: SixLinks, poses: Sequence[CommandedPose], argument: str) -> Hands:
    """Return the legs of the robot in poses with the same quantities. Raises ArgumentError at `argument`."""
    names = poses[0].given()
    _check(robot, names, argument)
    if "q" in names:
        q = np.array([pose.q for pose in poses])
        if robot.carts_and_axes[1]:
            q = np.hstack([q, np.array([pose.axes or [0.0, 0.0, 0.0] for pose in poses])])
        return robot.at_carts(q)
    T, e = robot.home
    if "tcp" in names:
        return robot.at_poses(np.array([pose.tcp for pose in poses]), orientations(poses, e, argument))
    return robot.at_poses(T[None], e[None])


def orientations(poses: Sequence[CommandedPose], default: np.ndarray, argument: str) -> np.ndarray:
    """Return unit quaternions (n, 4) of the poses; `default` for a pose without orientation."""
    prefixes = [f"pose {i + 1} " if len(poses) > 1 else "" for i in range(len(poses))]
    return np.array([_orientation(p, default, argument, prefix) for p, prefix in zip(poses, prefixes, strict=True)])


def _orientation(pose: CommandedPose, default: np.ndarray, argument: str, prefix: str) -> np.ndarray:
    if pose.quaternion is not None:
        e = np.array(pose.quaternion)
        length = float(np.linalg.norm(e))
        if abs(length - 1.0) > UNIT_LENGTH:
            raise ArgumentError(
                f"{prefix}must have length 1; found {pose.quaternion}, length {length:.6g}", f"{argument}.quaternion"
            )
        return e / length
    if pose.zyz is not None:
        return zyz_quaternion(*pose.zyz)
    return default


def _check(robot: SixLinks, names: tuple[str, ...], argument: str) -> None:
    """Raise ArgumentError for quantities that contradict each other or that the robot does not have."""
    if "tcp" in names and "q" in names:
        raise ArgumentError("give either the carts q_m or tcp_m", argument)
    rotations = [name for name in ("zyz", "quaternion") if name in names]
    if len(rotations) > 1:
        raise ArgumentError("give either zyz or quaternion", argument)
    if "axes" in names and not robot.carts_and_axes[1]:
        raise ArgumentError("the robot has no rotary axes; remove axes", f"{argument}.axes")
    if rotations and not robot.turns:
        raise ArgumentError("tcp_m determines the robot's orientation; remove it", f"{argument}.{rotations[0]}")
    if "axes" in names and "q" not in names:
        raise ArgumentError("rotary axes need the carts; add q_m", f"{argument}.axes")
    if rotations and "tcp" not in names:
        raise ArgumentError("an orientation needs a tool centre point; add tcp_m", f"{argument}.{rotations[0]}")


# scaled equations at a mode: rounding of about a dozen terms of size one
RESIDUAL = 1e-12
# leg lengths relative to the size: rounding, amplified by the condition number near a singularity
LEG_ERROR = 1e-12
# values from the certificate; for many poses the minimum (LEAST) or the maximum (GREATEST) is reported
LEAST = ("finite", "distinct", "certified", "real", "conjugate_pairs")
GREATEST = ("infinite", "multiple", "lost")
CERTIFIED = (*LEAST, *GREATEST, "retries", "worst_residual")


@study_function
def modes_study(
    robot: Model | Hands,
    poses: CommandedPose | Sequence[CommandedPose] | None = None,
    **work_options: Unpack[WorkOptions],
) -> ModesStudy:
    """Find all assembly modes of six links, with a certificate that none is missing, and the commanded mode.

    Args:
        robot: a robot with six links of fixed length, or legs of platforms from `bare` or `draw`.
        poses: one or many poses of the robot, with the same quantities; default: home.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    A pose without a solution for the legs has a status and does not affect the others. After an interruption, the study
    contains the completed poses. Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.kinematics.assembly_modes import CommandedPose
    >>> s = gt.kinematics.modes_study(gt.robots.six_link_gantry_tau(), CommandedPose(q=[-0.2, 0.0, -0.2]))
    >>> s.finite, s.real, s.commanded
    (40, 6, 6)
    """
    work = Work(**work_options)
    work.step("equations")
    hands = legs_of(robot, poses)
    work.step("tracking")

    def report(done: int, count: int) -> bool:
        work.progress("tracking 40 paths per pose", done / count, {"poses": float(done)})
        return work.interrupted()

    report(0, len(hands))
    judged = Judged.of(hands, assembly_modes_batch(hands.A, hands.B, hands.L, progress=report))
    refused = judged.refused()
    if len(hands) == 1 and refused:
        raise ArgumentError(refused[0], "legs" if isinstance(robot, Hands) else _named(poses) if poses else "robot")
    return _study_of(judged, work.title)


def legs_of(robot: Model | Hands, poses: CommandedPose | Sequence[CommandedPose] | None) -> Hands:
    """Return the legs of a study. Raises ArgumentError."""
    if isinstance(robot, Hands):
        if poses is not None:
            raise ArgumentError("a platform without a robot takes no poses; remove them", _named(poses))
        return robot
    all_poses = [poses or CommandedPose()] if poses is None or isinstance(poses, CommandedPose) else list(poses)
    if not all_poses:
        raise ArgumentError("no poses; give at least one", "poses")
    try:
        return hands_of(six_links_of(robot), all_poses, _named(poses))
    except ModelError as error:
        raise ArgumentError(str(error), "robot") from error


def _named(poses: CommandedPose | Sequence[CommandedPose] | None) -> str:
    return "pose" if poses is None or isinstance(poses, CommandedPose) else "poses"


def _study_of(judged: Judged, title: str) -> ModesStudy:
    done = [i for i in range(len(judged.hands)) if judged.done(i)]
    each = [_pose_values(judged, i) for i in range(len(judged.hands))]
    checks = _checks(judged, done)
    statuses = [r.status for r in judged.results]
    if ModesStatus.INTERRUPTED in statuses:
        status = SolveStatus.INTERRUPTED
    else:
        status = SolveStatus.SOLVED if all(s.ok for s in statuses) else SolveStatus.FAILED
    figures = {"modes": partial(_panels, judged, title)} if len(each) == 1 else {
        "real_modes": partial(_statistics, judged, title)}  # fmt: skip
    return ModesStudy(
        status=status,
        message=_message(judged, status, checks),
        title=title,
        checks=checks,
        **_summary(judged, each, done),
        files={"modes.csv": _csv(each)},
        figures=figures,
        scenes={"modes": partial(_in_space, judged, title)} if len(each) == 1 and len(judged.results[0].T) else {},
    )


def _pose_values(judged: Judged, i: int) -> dict[str, Any]:
    modes, hands = judged.results[i], judged.hands
    c = modes.certificate
    distance, angle = judged.commanded_nearest(i)
    commanded = judged.commanded[i]
    return {
        "pose": i + 1,
        "status": modes.status.value,
        "message": judged.message(i),
        **{name: getattr(c, name) for name in CERTIFIED},
        "worst_leg_error": judged.leg_error(i),
        "nearest_mm": 1e3 * c.nearest_distance,
        "nearest_deg": c.nearest_angle_deg,
        "commanded": None if commanded is None else commanded + 1,
        "commanded_nearest_mm": 1e3 * distance,
        "commanded_nearest_deg": angle,
        "q_m": hands.q[i, :3],
        "q_rad": hands.q[i, 3:],
        "tcp_m": hands.T[i],
        "quaternion": quaternion_of(hands.R[i]),
        "modes": [
            {
                "mode": k + 1,
                "tcp_m": modes.T[k],
                "quaternion": modes.quaternion[k],
                "nearest_mode": int(modes.nearest_other[k]) + 1 or None,
                "nearest_mm": 1e3 * modes.nearest_distance[k],
                "nearest_deg": modes.nearest_angle_deg[k],
                "commanded": k == commanded,
            }
            for k in range(c.real)
        ],
    }


def _summary(judged: Judged, each: list[dict[str, Any]], done: list[int]) -> dict[str, Any]:
    def over(choose: Callable[[Sequence[Any]], Any], name: str) -> Any:
        return choose([each[i][name] for i in done]) if done else None

    counts = Counter(each[i]["real"] for i in done)
    certificates = [r.certificate for r in judged.results]
    nearest = _nearest(judged, done, lambda i: (certificates[i].nearest_distance, certificates[i].nearest_angle_deg))
    commanded_nearest = _nearest(judged, done, judged.commanded_nearest)
    single = each[0] if len(each) == 1 else None
    return {
        "poses": len(each),
        "whole": sum(r.status.ok for r in judged.results),
        **{name: over(min, name) for name in LEAST},
        "real_most": over(max, "real"),
        "real_counts": {str(n): counts[n] for n in sorted(counts)},
        **{name: over(max, name) for name in (*GREATEST, "worst_residual", "worst_leg_error")},
        "retries": over(sum, "retries"),
        "nearest_distance": nearest[0],
        "nearest_angle_deg": nearest[1],
        "commanded": single["commanded"] if single else None,
        "commanded_nearest_distance": commanded_nearest[0],
        "commanded_nearest_angle_deg": commanded_nearest[1],
        "modes": single["modes"] if single else [],
        "each": each,
    }


def _nearest(judged: Judged, done: list[int], gap: Callable[[int], tuple[float, float]]) -> tuple[float, float]:
    """Return the smallest `gap`, distance [m] and angle [deg], over the poses, with the measure of `AssemblyModes`; NaN
    if no pose has two modes."""

    def measure(i: int) -> float:
        distance, angle = gap(i)
        return math.hypot(distance / judged.results[i].size, math.radians(angle))

    several = [i for i in done if math.isfinite(gap(i)[0])]
    return gap(min(several, key=measure)) if several else (math.nan, math.nan)


def _checks(judged: Judged, done: list[int]) -> dict[str, Check]:
    certificates = [judged.results[i].certificate for i in done]
    if not certificates:
        return {}
    numbers = {
        "residual": (max(c.worst_residual for c in certificates), RESIDUAL),
        "leg_error": (max(judged.leg_error(i) for i in done), LEG_ERROR),
        "not_distinct": (float(max(c.finite - c.distinct for c in certificates)), 0.0),
        "without_conjugate": (float(max(c.finite - c.real - 2 * c.conjugate_pairs for c in certificates)), 0.0),
        "lost": (float(max(c.lost for c in certificates)), 0.0),
    }
    errors = [judged.errors[i] for i in done if not math.isnan(judged.errors[i])]
    if errors:
        numbers["commanded_error"] = (max(errors), COMMANDED)
    return {name: at_most(value, bound) for name, (value, bound) in numbers.items()}


def _message(judged: Judged, status: SolveStatus, checks: dict[str, Check]) -> str:
    n = len(judged.hands)
    if status is SolveStatus.INTERRUPTED:
        return f"{status.message}; {sum(map(judged.done, range(n)))} of {n} poses are complete"
    if status is SolveStatus.FAILED:
        bad = [i for i in range(n) if not judged.results[i].status.ok]
        prefix = f"pose {bad[0] + 1}: " if n > 1 else ""
        suffix = f"; {len(bad)} of {n} poses have no complete set of modes" if n > 1 else ""
        return f"{prefix}{judged.message(bad[0])}{suffix}"
    text = judged.results[0].message if n == 1 else f"all finite modes of {n} poses were found"
    lacking = [i for i in range(n) if judged.hands.q.shape[1] and math.isnan(judged.errors[i])]
    if lacking and n == 1:
        real = judged.results[0].certificate.real
        text += "; none is real: the links cannot be assembled at these carts" if real == 0 else ""
        text += f"; Newton's method from home reached none of the {real} real modes" if real else ""
    elif lacking:
        text += f"; Newton's method found no pose for {len(lacking)} of them"
    return text


def _csv(each: list[dict[str, Any]]) -> str:
    """Return one line per real mode."""
    lines = ["pose,mode,x_m,y_m,z_m,e0,e1,e2,e3,commanded,nearest_mode,nearest_mm,nearest_deg"]
    for pose in each:
        for mode in pose["modes"]:
            numbers = [repr(float(x)) for x in (*mode["tcp_m"], *mode["quaternion"])]
            gaps = [f"{mode[name]:.9g}" if math.isfinite(mode[name]) else "" for name in ("nearest_mm", "nearest_deg")]
            cells = [pose["pose"], mode["mode"], *numbers, int(mode["commanded"]), mode["nearest_mode"] or "", *gaps]
            lines.append(",".join(map(str, cells)))
    return "\n".join(lines) + "\n"


def _panels(judged: Judged, title: str) -> Any:
    from ...plot.robot3d import modes_figure

    hands, modes = judged.hands, judged.results[0]
    return modes_figure(
        hands.A[0], hands.B[0], modes.R, modes.T,
        commanded=judged.commanded[0], carts=hands.carts, directions=hands.directions, title=title,
    )  # fmt: skip


def _in_space(judged: Judged, title: str) -> RobotScene:
    """The modes one after another, at their numbers."""
    hands, modes = judged.hands, judged.results[0]
    joints = modes.T[:, None] + hands.B[0] @ np.swapaxes(modes.R, 1, 2)
    links = range(len(hands.A[0]))
    points: dict[str, Any] = {f"cart joint {k + 1}": hands.A[0][k] for k in links}
    points |= {f"plate joint {k + 1}": joints[:, k] for k in links} | {"tool centre point": modes.T}
    colours = {k: COLOURS[n % len(COLOURS)] for n, legs in enumerate(hands.carts) for k in legs}
    ends = [(f"cart joint {k + 1}", f"plate joint {k + 1}") for k in links]
    parts = [VisiblePart("bar", ends[k], f"link {k + 1}", colours[k]) for k in links]
    parts += [VisiblePart("bar", ("tool centre point", f"plate joint {k + 1}"), "plate") for k in links]
    parts += [VisiblePart("joint", (name,), name) for name in points]
    return RobotScene(points, parts, time=np.arange(1.0, len(modes.T) + 1), title=title, unit="mode")


def _statistics(judged: Judged, title: str) -> Any:
    from ...plot.robot3d import real_counts_figure

    note = judged.hands.synthetic
    if note and "synthetic" not in title:
        title += f" ({note})"
    done = [i for i in range(len(judged.hands)) if judged.done(i)]
    gaps = np.array([judged.commanded_nearest(i) for i in done]).reshape(-1, 2) * [1e3, 1.0]
    return real_counts_figure([judged.results[i].certificate.real for i in done], gaps, title=title)
