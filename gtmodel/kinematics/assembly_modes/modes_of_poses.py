"""The modes study: assembly modes of many poses, from arguments or a file, the commanded mode of each, certificate and
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
from ..causality.point_table import UNIT_LENGTH
from .modes import AssemblyModes
from .options import COLUMNS, CommandedPose, ModesStudy
from .six_links import Hands, SixLinks, six_links_of
from .solve import assembly_modes_batch

# largest difference of a commanded pose from its mode, over the size or in rad
COMMANDED = 1e-9


@dataclass(frozen=True)
class Judged:
    """Poses with their modes. commanded: index of the commanded mode of each pose, or None.

    errors: relative distance or angle [rad], whichever is larger, between the commanded pose and the closest mode; NaN
    without a commanded pose.
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
        """Return whether a pose was searched."""
        return self.results[i].status not in (ModesStatus.INTERRUPTED, ModesStatus.BAD_INPUT)

    def refused(self) -> list[str]:
        """Return sentences on why poses could not be searched."""
        return [self.message(i) for i, r in enumerate(self.results) if r.status is ModesStatus.BAD_INPUT]

    def message(self, i: int) -> str:
        """Return the message of a pose."""
        return self.hands.faults.get(i) or self.results[i].message

    def leg_error(self, i: int) -> float:
        """Return the largest error of a leg length at a real mode over the size, for the unscaled legs."""
        hands, modes = self.hands, self.results[i]
        joints = modes.T[:, None] + hands.B[i] @ np.swapaxes(modes.R, 1, 2)
        errors = np.abs(np.linalg.norm(joints - hands.A[i], axis=2) - hands.L[i])
        return float(np.max(errors, initial=0.0)) / modes.size if errors.size else 0.0

    def commanded_nearest(self, i: int) -> tuple[float, float]:
        """Return distance [m] and angle [deg] from the commanded mode to the closest one; NaN or infinite if none."""
        k = self.commanded[i]
        if k is None:
            return math.nan, math.nan
        return float(self.results[i].nearest_distance[k]), float(self.results[i].nearest_angle_deg[k])


def read_poses(path: str | Path) -> list[CommandedPose]:
    """Read the poses of a CSV file, one per row, with column names as in COLUMNS. Raises ArgumentError.

    >>> from pathlib import Path
    >>> from gtmodel.kinematics.assembly_modes import read_poses
    >>> _ = Path("poses.csv").write_text("q1_m,q2_m,q3_m,q4_deg,q5_deg,q6_deg\\n0.7,0.3,0.2,90,0,0\\n")
    >>> read_poses("poses.csv")[0].axes
    [1.5707963267948966, 0.0, 0.0]
    """
    path = path_of(path)
    with naming("poses"):
        table = CsvTable(path)
    head = table.names
    groups = [
        (name, columns, f) for name, all_ in COLUMNS.items() for columns, f in all_.items() if {*columns} & {*head}
    ]
    known = [column for _, columns, _ in groups for column in columns]
    missing = [column for column in known if column not in head]
    if missing or not groups:
        expected = ", ".join(missing) or "q1_m, q2_m, q3_m or x_m, y_m, z_m"
        raise ArgumentError(f"{path.name} lacks the columns {expected}; it has {', '.join(head)}", "poses")
    foreign = [column for column in head if column not in known]
    if foreign:
        raise ArgumentError(f"{path.name} has columns that do not belong to a pose: {', '.join(foreign)}", "poses")
    twice = [columns for name, columns, _ in groups if sum(name == n for n, _, _ in groups) > 1]
    if twice:
        raise ArgumentError(f"{path.name} has {' and '.join(c[0] for c in twice)}; remove one of them", "poses")
    with naming("poses"):
        numbers = {c: table.numbers(c).tolist() for c in known}
    return [
        CommandedPose(**{name: [f * numbers[c][k] for c in columns] for name, columns, f in groups})
        for k in range(len(table.lines))
    ]


def hands_of(robot: SixLinks, poses: Sequence[CommandedPose], argument: str) -> Hands:
    """Return the legs of the robot in poses that set the same quantities. Raises ArgumentError at `argument`."""
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


def orientations(poses: Sequence[CommandedPose], left_out: np.ndarray, argument: str) -> np.ndarray:
    """Return the unit quaternions (n, 4) of the poses; `left_out` is the default."""
    heads = [f"pose {i + 1} " if len(poses) > 1 else "" for i in range(len(poses))]
    return np.array([_orientation(pose, left_out, argument, head) for pose, head in zip(poses, heads, strict=True)])


def _orientation(pose: CommandedPose, left_out: np.ndarray, argument: str, head: str) -> np.ndarray:
    if pose.quaternion is not None:
        e = np.array(pose.quaternion)
        length = float(np.linalg.norm(e))
        if abs(length - 1.0) > UNIT_LENGTH:
            raise ArgumentError(
                f"{head}must be of length 1; found {pose.quaternion} of length {length:.6g}", f"{argument}.quaternion"
            )
        return e / length
    if pose.zyz is not None:
        return zyz_quaternion(*pose.zyz)
    return left_out


def _check(robot: SixLinks, names: tuple[str, ...], argument: str) -> None:
    """Raise ArgumentError for quantities that contradict each other or do not belong to the robot."""
    if "tcp" in names and "q" in names:
        raise ArgumentError("set either the carts q_m or tcp_m", argument)
    rotations = [name for name in ("zyz", "quaternion") if name in names]
    if len(rotations) > 1:
        raise ArgumentError("set either zyz or quaternion", argument)
    if "axes" in names and not robot.carts_and_axes[1]:
        raise ArgumentError("the robot has no rotary axes; remove them", f"{argument}.axes")
    if rotations and not robot.turns:
        raise ArgumentError("tcp_m determines the orientation of the robot; remove it", f"{argument}.{rotations[0]}")
    if "axes" in names and "q" not in names:
        raise ArgumentError("rotary axes also need the carts q_m", f"{argument}.axes")
    if rotations and "tcp" not in names:
        raise ArgumentError("an orientation also needs tcp_m", f"{argument}.{rotations[0]}")


# residual of the scaled equations at a mode: rounding of a dozen terms of size one
RESIDUAL = 1e-12
# error of the leg lengths over the size: rounding, amplified near a singularity
LEG_ERROR = 1e-12
# values of the certificate, reported as the smallest or the largest over many poses
LEAST = ("finite", "distinct", "certified", "real", "conjugate_pairs")
GREATEST = ("infinite", "multiple", "lost")
CERTIFIED = (*LEAST, *GREATEST, "retries", "worst_residual")


@study_function
def modes_study(
    robot: Model | Hands,
    poses: CommandedPose | Sequence[CommandedPose] | None = None,
    **work_options: Unpack[WorkOptions],
) -> ModesStudy:
    """Compute all assembly modes of six links, with a certificate of completeness, and identify the commanded mode.

    Args:
        robot: a robot with six links of fixed length, or legs of platforms from `bare` or `draw`.
        poses: pose of the robot, or several that set the same quantities; default: home.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    A pose without a solution of the inverse kinematics has a status and does not affect the others. An interrupted
    study holds the poses searched so far. Raises ArgumentError for wrong arguments.

    >>> import gtmodel as gt
    >>> from gtmodel.kinematics.assembly_modes import CommandedPose
    >>> s = gt.kinematics.modes_study(gt.robots.six_link_gantry_tau(), CommandedPose(q=[-0.2, 0.0, -0.2]))
    >>> s.finite, s.real, s.commanded
    (40, 6, 6)
    """
    work = Work(**work_options)
    work.step("building equations")
    hands = legs_of(robot, poses)
    work.step("tracking paths")

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
    """Return the legs to be studied. Raises ArgumentError."""
    if isinstance(robot, Hands):
        if poses is not None:
            raise ArgumentError("legs of a platform already have poses; remove the poses", _named(poses))
        return robot
    commanded = [poses or CommandedPose()] if poses is None or isinstance(poses, CommandedPose) else list(poses)
    if not commanded:
        raise ArgumentError("has no poses", "poses")
    try:
        return hands_of(six_links_of(robot), commanded, _named(poses))
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
    )


def _pose_values(judged: Judged, i: int) -> dict[str, Any]:
    modes, hands = judged.results[i], judged.hands
    c = modes.certificate
    near = judged.commanded_nearest(i)
    mine = judged.commanded[i]
    return {
        "pose": i + 1,
        "status": modes.status.value,
        "message": judged.message(i),
        **{name: getattr(c, name) for name in CERTIFIED},
        "worst_leg_error": judged.leg_error(i),
        "nearest_mm": 1e3 * c.nearest_distance,
        "nearest_deg": c.nearest_angle_deg,
        "commanded": None if mine is None else mine + 1,
        "commanded_nearest_mm": 1e3 * near[0],
        "commanded_nearest_deg": near[1],
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
                "commanded": k == mine,
            }
            for k in range(c.real)
        ],
    }


def _summary(judged: Judged, each: list[dict[str, Any]], done: list[int]) -> dict[str, Any]:
    def over(choose: Callable[[Sequence[Any]], Any], name: str) -> Any:
        return choose([each[i][name] for i in done]) if done else None

    counts = Counter(each[i]["real"] for i in done)
    certificates = [r.certificate for r in judged.results]
    near = _nearest(judged, done, lambda i: (certificates[i].nearest_distance, certificates[i].nearest_angle_deg))
    mine = _nearest(judged, done, judged.commanded_nearest)
    only = each[0] if len(each) == 1 else None
    return {
        "poses": len(each),
        "whole": sum(r.status.ok for r in judged.results),
        **{name: over(min, name) for name in LEAST},
        "real_most": over(max, "real"),
        "real_counts": {str(n): counts[n] for n in sorted(counts)},
        **{name: over(max, name) for name in (*GREATEST, "worst_residual", "worst_leg_error")},
        "retries": over(sum, "retries"),
        "nearest_distance": near[0],
        "nearest_angle_deg": near[1],
        "commanded": only["commanded"] if only else None,
        "commanded_nearest_distance": mine[0],
        "commanded_nearest_angle_deg": mine[1],
        "modes": only["modes"] if only else [],
        "each": each,
    }


def _nearest(judged: Judged, done: list[int], of: Callable[[int], tuple[float, float]]) -> tuple[float, float]:
    """Return the smallest distance [m], with its angle [deg], over the poses, by the measure of `AssemblyModes`; NaN if
    no pose has two modes."""

    def measure(i: int) -> float:
        distance, angle = of(i)
        return math.hypot(distance / judged.results[i].size, math.radians(angle))

    several = [i for i in done if math.isfinite(of(i)[0])]
    return of(min(several, key=measure)) if several else (math.nan, math.nan)


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
        return f"{status.message}; {sum(map(judged.done, range(n)))} of {n} poses were searched"
    if status is SolveStatus.FAILED:
        bad = [i for i in range(n) if not judged.results[i].status.ok]
        head = f"pose {bad[0] + 1}: " if n > 1 else ""
        more = f"; {len(bad)} of {n} poses have no complete set of modes" if n > 1 else ""
        return f"{head}{judged.message(bad[0])}{more}"
    text = judged.results[0].message if n == 1 else f"all finite modes of {n} poses were found"
    lacking = [i for i in range(n) if judged.hands.q.shape[1] and math.isnan(judged.errors[i])]
    if lacking and n == 1:
        real = judged.results[0].certificate.real
        text += "; no real one: the links cannot be assembled at these carts" if real == 0 else ""
        text += f"; Newton reached none of the {real} real ones from home" if real else ""
    elif lacking:
        text += f"; Newton found no pose for {len(lacking)} of them"
    return text


def _csv(each: list[dict[str, Any]]) -> str:
    """Return a CSV with one line per real mode."""
    lines = ["pose,mode,x_m,y_m,z_m,e0,e1,e2,e3,commanded,nearest_mode,nearest_mm,nearest_deg"]
    for pose in each:
        for mode in pose["modes"]:
            numbers = [repr(float(x)) for x in (*mode["tcp_m"], *mode["quaternion"])]
            near = [f"{mode[name]:.9g}" if math.isfinite(mode[name]) else "" for name in ("nearest_mm", "nearest_deg")]
            cells = [pose["pose"], mode["mode"], *numbers, int(mode["commanded"]), mode["nearest_mode"] or "", *near]
            lines.append(",".join(map(str, cells)))
    return "\n".join(lines) + "\n"


def _panels(judged: Judged, title: str) -> Any:
    from ...plot.robot3d import modes_figure

    hands, modes = judged.hands, judged.results[0]
    return modes_figure(
        hands.A[0], hands.B[0], modes.R, modes.T,
        commanded=judged.commanded[0], carts=hands.carts, directions=hands.directions, title=title,
    )  # fmt: skip


def _statistics(judged: Judged, title: str) -> Any:
    from ...plot.robot3d import real_counts_figure

    synthetic = judged.hands.synthetic
    if synthetic and "synthetic" not in title:
        title += f" ({synthetic})"
    done = [i for i in range(len(judged.hands)) if judged.done(i)]
    near = np.array([judged.commanded_nearest(i) for i in done]).reshape(-1, 2) * [1e3, 1.0]
    return real_counts_figure([judged.results[i].certificate.real for i in done], near, title=title)
