"""Which parameters of a calibration are free, fixed, tied or known beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..inference import Prior


@dataclass(frozen=True)
class Choice:
    """What to do with the parameters that the closure equations hold; names are of scalars ("L[0]"), rows or columns
    of numbers that share a beginning ("v[1]") or whole parameters ("A").

    `free`: those to move, None for all, empty for none but those of the measurement; `fixed`: those to leave, stronger
    than free (turns of quaternions too).
    `tied`: name -> name of the same shape, which it follows. `unit`: quaternions (4), scalar first, that are turned and
    keep the length 1 (three unknowns each, "u1_2 turned about x" [rad], in the quaternion's own frame). `priors` by
    scalar name of an unknown. `sizes`: expected error of a parameter, the scale in which rank and observability
    are computed; default 1e-3, of compliances 1e-6 m/N.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> q, _ = robot.causal(known="T", targets="q")(np.array([robot.home]))
    >>> poses = gt.calibrate.Measurements({"q": q, "T": [robot.home]})
    >>> choice = gt.calibrate.Choice(free=["A", "L"], fixed=["A[2]"])
    >>> gt.calibrate.prepare(robot, poses, choice).unknowns.names[-4:]
    ('A[1,2]', 'L[0]', 'L[1]', 'L[2]')
    """

    free: Sequence[str] | None = None
    fixed: Sequence[str] = ()
    tied: Mapping[str, str] = field(default_factory=dict)
    unit: Sequence[str] = ()
    priors: Sequence[Prior] = ()
    sizes: Mapping[str, float] = field(default_factory=dict)
