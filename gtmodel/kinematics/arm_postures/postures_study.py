"""The study of postures: all of them for each pose, limits by joint, a way along a path, distances out of reach."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Unpack

import numpy as np

from ... import view
from ...geometry.chains import Chain, ElbowAngle, LockedJoint, PostureJump, PosturePath, Postures, along_path, postures
from ...geometry.chains.numerical import shortfall
from ...lang import Model
from ...lang.units import parse_unit
from ...measurements.signal_table import read
from ...results import ArgumentError, Row, SolveStatus, Status, Trajectory, Work, at_most
from ...results.disk import path_of
from ...results.options import Within
from ...results.refusal import naming
from ...results.work import WorkOptions, study_function
from ..serial_chain import chain_of
from .options import PosturesStudy, ToolColumns, ToolPose, ToolPoses, rotations

Array = np.ndarray
LARGEST_STEP = float(np.radians(30.0))
CHUNK = 500  # poses between two looks at the time limit
BEYOND = "beyond_limits"
MISSED = 5e-3  # rad: an orientation that differs more is not one of the arm's
SHOWN_ROWS = 3  # rows that a message names


def read_tool_poses(path: str | Path, columns: ToolColumns | None = None) -> ToolPoses:
    """Read poses of a tool from a file, one in each row. Raises ArgumentError with the line.

    >>> from pathlib import Path
    >>> _ = Path("seam.csv").write_text("x,y,z,A,B,C\\n400,100,300,90,0,180\\n")
    >>> columns = gt.kinematics.ToolColumns(["x", "y", "z"], "mm", ["A", "B", "C"], "KUKA A B C")
    >>> gt.kinematics.read_tool_poses("seam.csv", columns).T
    array([[0.4, 0.1, 0.3]])
    """
    c, path = columns or ToolColumns(), path_of(path)
    angles, wanted = c.orientation is not None, {"position": (c.position, c.position_unit)}
    if c.orientation is not None:
        from ...measurements.orientations import in_angles

        with naming("representation"):
            angles = in_angles(c.representation)
        wanted["orientation"] = (c.orientation, c.unit if angles else "1")
    with naming(
        {"signals.position.column": "position", "signals.position.unit": "position_unit",
         "signals.orientation.column": "orientation", "signals.orientation.unit": "unit"}
    ):  # fmt: skip
        table = read(path, wanted)
    if parse_unit(c.position_unit).si_text != "m":
        raise ArgumentError(f"is {c.position_unit}; expected a unit of length, such as mm", "position_unit")
    R = None
    if c.orientation is not None:
        R = rotations(table.values["orientation"], c.representation, "rad" if angles else "1")
    return ToolPoses(table.values["position"], R, table.lines)


@study_function
def postures_study(
    robot: Model,
    poses: ToolPose | ToolPoses,
    *,
    path: bool = False,
    near: Sequence[float] | Array | None = None,
    largest_step: Annotated[float, Within(above=0.0)] = LARGEST_STEP,
    redundancy: LockedJoint | ElbowAngle | None = None,
    **work_options: Unpack[WorkOptions],
) -> PosturesStudy:
    """Find all postures of a serial arm for poses of its tool, those within its joint limits, and a way along a path.

    Args:
        robot: an arm with q, T and R; its joint limits are `robot.joint_limits`, if it has any.
        poses: one pose, or poses as arrays.
        path: the poses are a path: choose postures without jumps from row to row.
        near: joint coordinates (n,) [rad, m] to which the chosen postures shall be near; the arm's start if left out.
        largest_step: of a joint between two rows of a path [rad, and times the arm's length, m]; more is a jump.
        redundancy: of an arm of seven joints, see `gtmodel.kinematics.postures`.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    A pose without a posture has a status and does not affect the others. Raises ArgumentError.

    >>> arm = gt.robots.serial_arm(a=[0.4, 0.3, 0.0], alpha=[0.0, np.pi, 0.0], joints="rrp",
    ...                            limits=[[-3.0, 3.0], [-2.0, 2.0], [0.0, 0.2]])
    >>> s = gt.kinematics.postures_study(arm, gt.kinematics.ToolPose([0.5, 0.3, -0.1]))
    >>> s.names, s.chosen.round(2)
    (('left', 'right'), array([[0.04, 1.19, 0.1 ]]))
    """
    work = Work(**work_options)
    work.step("axes of the arm")
    chain = chain_of(robot)
    rows = poses.poses if isinstance(poses, ToolPose) else poses
    joints, limits, start = _facts(robot, chain)
    if near is not None:
        start = np.asarray(near, float)
        if start.shape != (len(chain),):
            raise ArgumentError(f"has {start.size} numbers; expected {len(chain)}, one for each joint", "near")
    case = _Case(chain, rows, joints, limits, start, redundancy)
    solutions = case.all_postures(work)
    if solutions is None:
        return _stopped(case, work)
    way = None
    if path:
        step = largest_step * np.where(chain.revolute, 1.0, chain.size)
        R = rows.R
        way = along_path(chain, solutions, rows.T, R, limits=limits, near=start, largest_step=step)
    study = _study_of(case, solutions, way, work)
    unit = "rad" if np.all(chain.revolute) else "1"
    if study.each:
        return study.with_(scenes={"postures": partial(_in_space, robot, study, unit)})
    if not np.isfinite(study.chosen).all(axis=1).any():
        return study
    return study.with_(scenes={"path" if path else "poses": partial(_chosen_in_space, robot, study, unit)})


@dataclass(frozen=True, eq=False)
class _Case:
    chain: Chain
    rows: ToolPoses
    joints: tuple[str, ...]
    limits: Array
    near: Array
    redundancy: LockedJoint | ElbowAngle | None

    def all_postures(self, work: Work) -> Postures | None:
        """Return the postures of all poses, whatever the limits if they are all known; None if stopped before."""
        parts: list[Postures] = []
        for first in range(0, len(self.rows), CHUNK):
            if work.interrupted():
                return None
            work.progress("postures", first / len(self.rows), {"row": float(first)})
            part = slice(first, first + CHUNK)
            T, R = self.rows.T[part], None if self.rows.R is None else self.rows.R[part]
            made = postures(self.chain, T, R, redundancy=self.redundancy)
            if not made.complete and np.isfinite(self.limits).any():
                made = postures(self.chain, T, R, redundancy=self.redundancy, limits=self.limits)
            parts.append(made)
        k = max(p.q.shape[1] for p in parts)
        q, status, branch = (
            np.concatenate([_wide(getattr(p, name), k) for p in parts]) for name in ("q", "status", "branch")
        )
        p = parts[0]
        none = np.zeros(status.shape, bool)
        return Postures(q, status, branch, none, p.names, p.complete, p.method, p.revolute)

    def written(self, joint: int, value: float) -> str:
        """Return a coordinate in degrees or millimetres, with its unit."""
        return f"{np.degrees(value):.4g} deg" if self.chain.revolute[joint] else f"{1e3 * value:.4g} mm"

    def limit_text(self, excess: Array, q: Array) -> str:
        """Return the limits that joint coordinates (n,) exceed, in words; "" for none."""
        texts = []
        for j in np.flatnonzero(excess).tolist():
            side, limit = ("upper", self.limits[j, 1]) if excess[j] > 0 else ("lower", self.limits[j, 0])
            texts.append(
                f"{self.joints[j]} at {self.written(j, q[j])}, beyond its {side} limit {self.written(j, limit)}"
            )
        return ", ".join(texts)

    def jump_text(self, jump: PostureJump) -> str:
        joint, row = self.joints[jump.joint], self.rows.called(jump.row)
        if jump.kind == "gap":
            return f"{row} has no posture within limits"
        if jump.kind == "limit":
            side = "upper" if jump.amount > 0 else "lower"
            by = self.written(jump.joint, abs(jump.amount))
            return f"before {row}: {joint} would exceed its {side} limit by {by}"
        return f"before {row}: {joint} would move by {self.written(jump.joint, abs(jump.amount))} in one step"


def _wide(x: Array, k: int) -> Array:
    """Return rows of postures with k columns."""
    missing = k - x.shape[1]
    fill = np.nan if x.dtype == float else int(Status.OUT_OF_RANGE)
    return np.concatenate([x, np.full((len(x), missing, *x.shape[2:]), fill, x.dtype)], axis=1) if missing else x


def _facts(robot: Model, chain: Chain) -> tuple[tuple[str, ...], Array, Array]:
    """Return the names of the joints, their limits (n, 2) and the arm's start (n,)."""
    n, structure = len(chain), getattr(robot, "structure", None)
    limits = getattr(robot, "joint_limits", None)
    limits = np.tile([-np.inf, np.inf], (n, 1)) if limits is None else np.asarray(limits, float)
    names = tuple(f"q[{k}]" for k in range(n))
    start: Sequence[float] = ()
    if structure is not None:
        names = tuple(structure.joints[k].name for k in structure.leaders)
        start = structure.starts[0] if structure.starts else ()
    return names, limits, np.array(start) if len(start) else np.clip(np.zeros(n), *limits.T)


def _study_of(case: _Case, solutions: Postures, way: PosturePath | None, work: Work) -> PosturesStudy:
    m = len(case.rows)
    near = case.near if way is None else np.where(np.isfinite(way.q), way.q, case.near)
    q, excess = solutions.placed(case.limits, near)
    exists = np.asarray(np.isfinite(q).all(axis=2))
    inside = exists & (excess == 0).all(axis=2)
    words = [_word(solutions.status[i], exists[i], inside[i]) for i in range(m)]
    short = _shortfalls(case, words)
    if way is None:
        distance = np.where(inside, np.linalg.norm(q - case.near, axis=2), np.inf)
        best = np.argmin(distance, axis=1)
        chosen = np.where(inside.any(axis=1)[:, None], q[np.arange(m), best], np.nan)
    else:
        chosen = way.q
    breaks = () if way is None else way.jumps
    jumps = [{"row": j.row + 1, "kind": j.kind, "reason": case.jump_text(j)} for j in breaks if j.kind != "gap"]
    without = [i for i in range(m) if not inside[i].any()]
    checks = {}
    if m > 1:
        advice = "; ".join(_reason(case, i, words[i], q[i], excess[i], short) for i in without[:SHOWN_ROWS])
        checks["rows_without_posture"] = at_most(len(without), 0, advice)
    if way is not None:
        checks["jumps"] = at_most(len(jumps), 0, "; ".join(j["reason"] for j in jumps[:SHOWN_ROWS]))
    labels = _labels(solutions)
    each = [] if m > 1 else [
        {"name": labels[k], "q": q[0, k].tolist(), "status": Status(int(solutions.status[0, k])).name.lower(),
         "within_limits": bool(inside[0, k]), "limits_exceeded": case.limit_text(excess[0, k], q[0, k])}
        for k in np.flatnonzero(exists[0])]  # fmt: skip
    status = SolveStatus.SOLVED if inside.any() else SolveStatus.INFEASIBLE
    counts = {str(k): n for k, n in sorted(Counter(inside.sum(axis=1).tolist()).items())}
    title = work.title
    table = (q, excess, solutions, inside, labels)
    files = {"postures.csv": _csv(case, *table)}
    figures: dict[str, Any] = {"postures": partial(_postures_figure, case, q, inside, chosen, labels, title)}
    if way is not None:
        files["path.csv"] = _path_csv(case, way, labels)
        figures = {"path": partial(_path_figure, case, q, inside, way, title)}
    study = PosturesStudy(
        status=status, title=title, q=q, excess=excess, codes=solutions.status, branches=solutions.branch,
        chosen=chosen,
        names=solutions.names, joints=case.joints, poses=m, method=solutions.method, complete=solutions.complete,
        counts=counts, statuses=dict(Counter(words)), shortfall=short, jumps=jumps, each=each, checks=checks,
        notes=_notes(case, solutions, exists), files=files, machine_files=["path.csv"] if way is not None else [],
        figures=figures, lines=_lines(case, each, inside[0], q[0], chosen, m),
    )  # fmt: skip
    if study.status.ok or m == 1:
        study = study.with_(message=_message(case, study, without, words, q, excess, short))
    return study


def _in_space(robot: Model, study: PosturesStudy, unit: str) -> view.RobotScene:
    """The arm in one posture after the other, with the number, and whether the limits allow them as a signal."""
    q = np.array([row["q"] for row in study.each])
    inside = np.array([float(row["within_limits"]) for row in study.each])
    rows = Trajectory(np.arange(1.0, len(q) + 1), {"q": q, "within_limits": inside}, {"q": unit, "within_limits": "1"})
    names = "; ".join(f"{k}: {row['name']}" for k, row in enumerate(study.each, 1))
    drawn = view.scene(robot, rows, title=study.title or "postures")
    return drawn.with_(unit="posture", note=f"Postures by number, {names}.")


def _chosen_in_space(robot: Model, study: PosturesStudy, unit: str) -> view.RobotScene:
    """The arm in the chosen posture of one pose after the other."""
    there = np.isfinite(study.chosen).all(axis=1)
    rows = Trajectory(1.0 + np.flatnonzero(there), {"q": study.chosen[there]}, {"q": unit})
    drawn = view.scene(robot, rows, title=study.title or "postures")
    shown, all_ = len(np.atleast_1d(drawn.time)), len(study.chosen)
    part = "" if shown == all_ else f" {shown} of {all_} poses are shown."
    return drawn.with_(unit="pose", note=f"The chosen posture of each pose.{part}")


def _stopped(case: _Case, work: Work) -> PosturesStudy:
    m, n = len(case.rows), len(case.chain)
    empty = np.full((m, 0, n), np.nan)
    none = np.zeros((m, 0), int)
    return PosturesStudy(
        status=SolveStatus.INTERRUPTED, title=work.title, q=empty, excess=empty, codes=none, branches=none,
        chosen=np.full((m, n), np.nan), joints=case.joints, poses=m, method="", complete=False, counts={}, statuses={},
    )  # fmt: skip


def _word(status: Array, exists: Array, inside: Array) -> str:
    if inside.any():
        return "singular" if np.all(status[inside] == Status.SINGULAR) else "ok"
    if exists.any():
        return BEYOND
    return Status(int(status[0])).name.lower() if len(status) else "out_of_range"


def _shortfalls(case: _Case, words: list[str]) -> Array | None:
    """Return how far poses are out of reach [m]; None if none is. NaN if the arm does not have the orientation."""
    lost = [i for i, word in enumerate(words) if word == "out_of_range"]
    if not lost or isinstance(case.redundancy, ElbowAngle):
        return None
    chain = case.chain
    if isinstance(case.redundancy, LockedJoint):
        chain = chain.locked(case.redundancy.joint, case.redundancy.value)
    T, R = case.rows.T[lost], None if case.rows.R is None else case.rows.R[lost]
    distance, angle = shortfall(chain, T, R)
    distances = np.zeros(len(words))
    distances[lost] = np.where(angle < MISSED, distance, np.nan)
    return distances


def _reason(case: _Case, i: int, word: str, q: Array, excess: Array, short: Array | None) -> str:
    """Return why a pose has no posture within limits."""
    row = case.rows.called(i) if len(case.rows) > 1 else "the pose"
    if word == BEYOND:
        size = np.nansum(np.abs(excess), axis=1) + np.where(np.isfinite(q).all(axis=1), 0.0, np.inf)
        k = int(np.argmin(size))
        return f"{row} is reached only beyond limits: {case.limit_text(excess[k], q[k])}"
    if word != "out_of_range":
        return f"{row}: {Status[word.upper()].message}"
    if short is None:
        return f"{row} is out of reach"
    if np.isnan(short[i]):
        return f"{row} is out of reach: the arm cannot turn its tool that way"
    kept = "" if case.rows.R is None else " with this orientation"
    return f"{row} is out of reach by {1e3 * short[i]:.3g} mm{kept}"


def _message(
    case: _Case, study: PosturesStudy, without: list[int], words: list[str], q: Array, excess: Array,
    short: Array | None,
) -> str:  # fmt: skip
    if study.poses > 1:
        if len(without) < study.poses:
            what = "the path has no jump" if "jumps" in study.checks else "all poses have a posture within limits"
            return what
        return _reason(case, 0, words[0], q[0], excess[0], short)
    if without:
        return _reason(case, 0, words[0], q[0], excess[0], short)
    inside = sum(p["within_limits"] for p in study.each)
    count = len(study.each)
    return f"{count} posture{'s' * (count > 1)}, {inside} within limits"


def _labels(solutions: Postures) -> list[str]:
    """Return a name for each posture of a pose; numbers if the arm's postures have no names."""
    return [name or "the posture" for name in solutions.names] or [str(k + 1) for k in range(solutions.q.shape[1])]


def _notes(case: _Case, solutions: Postures, exists: Array) -> list[str]:
    notes = []
    if not solutions.complete:
        notes.append("the postures were found by iteration from many starts; there may be others")
    singular = np.flatnonzero((exists & (solutions.status == Status.SINGULAR)).any(axis=1))
    if len(singular):
        where = ", ".join(case.rows.called(i) for i in singular[:SHOWN_ROWS])
        more = f" and {len(singular) - SHOWN_ROWS} more" if len(singular) > SHOWN_ROWS else ""
        of = "the pose is" if len(case.rows) == 1 else f"{where}{more}:"
        notes.append(f"{of} next to a singular position, where joints can turn while the tool stands still")
    return notes


def _lines(case: _Case, each: Sequence[Mapping[str, Any]], inside: Array, q: Array, chosen: Array, m: int) -> list[Row]:
    """Rows of the table with the postures of a single pose."""
    if m > 1:
        return []
    rows = []
    slides = not all(case.chain.revolute)
    unit = "" if slides else "deg"
    for p in each:
        values = [case.written(j, x) if slides else f"{np.degrees(x):.2f}" for j, x in enumerate(p["q"])]
        rows.append(Row(p["name"] + (" (singular)" if p["status"] == "singular" else ""), ", ".join(values), unit))
        if p["limits_exceeded"]:
            rows.append(Row("  beyond limits", p["limits_exceeded"]))
    if np.isfinite(chosen).all():
        k = int(np.argmin(np.abs(q - chosen[0]).max(axis=1) + np.where(inside, 0.0, np.inf)))
        names = [p["name"] for p in each]
        places = [i for i in range(len(q)) if np.isfinite(q[i]).all()]
        rows.append(Row("nearest", names[places.index(k)]))
    return rows


def _heads(case: _Case) -> list[str]:
    return [f"{j} [{'deg' if r else 'mm'}]" for j, r in zip(case.joints, case.chain.revolute, strict=True)]


def _shown(case: _Case, q: Array) -> list[str]:
    return [repr(float(x)) for x in q * np.where(case.chain.revolute, np.degrees(1.0), 1e3)]


def _csv(case: _Case, q: Array, excess: Array, solutions: Postures, inside: Array, labels: list[str]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["row", "posture", "name", *_heads(case), "status", "within_limits", "limits_exceeded"])
    for i, k in np.argwhere(np.isfinite(q).all(axis=2)):
        name = labels[solutions.branch[i, k]] if solutions.names else ""
        status = Status(int(solutions.status[i, k])).name.lower()
        writer.writerow([i + 1, k + 1, name, *_shown(case, q[i, k]), status, bool(inside[i, k]),
                         case.limit_text(excess[i, k], q[i, k])])  # fmt: skip
    return out.getvalue()


def _path_csv(case: _Case, way: PosturePath, labels: list[str]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["row", *_heads(case), "name", "jump"])
    reasons = {j.row: case.jump_text(j) for j in way.jumps}
    for i, q in enumerate(way.q):
        numbers = _shown(case, q) if np.isfinite(q).all() else [""] * len(q)
        writer.writerow([i + 1, *numbers, labels[way.branch[i]] if way.branch[i] >= 0 else "", reasons.get(i, "")])
    return out.getvalue()


def _postures_figure(case: _Case, q: Array, inside: Array, chosen: Array, labels: list[str], title: str) -> Any:
    from ...plot.arms import postures_figure

    return postures_figure(q, inside, case.joints, case.chain.revolute, case.limits, labels, title=title)


def _path_figure(case: _Case, q: Array, inside: Array, way: PosturePath, title: str) -> Any:
    from ...plot.arms import path_figure

    jumps = [j.row for j in way.jumps]
    return path_figure(way.q, q, inside, case.joints, case.chain.revolute, case.limits, jumps, title=title)
