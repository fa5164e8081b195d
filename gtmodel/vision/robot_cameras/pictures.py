"""Corners observed by cameras at poses of a robot, with the readings of its actuators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...results.refusal import ArgumentError


@dataclass(frozen=True, eq=False)
class SecondDevice:
    """Positions of the tool centre point measured by another device at some poses, in the device's own frame.

    `pose` (k,) indices, `T` (k, 3) [m], `noise` [m] of each coordinate.
    """

    pose: np.ndarray
    T: np.ndarray
    noise: float


@dataclass(frozen=True, eq=False)
class RobotPictures:
    """n corners: `camera`, `pose` and `mark` (n,) are indices of the names; `uv` (n, 2), `sigma` (n,) [pixel].

    `actuators` (N, k): readings at each pose; `rates` (N, k): their rates of change, if the robot moved. `target`
    (M, 3) [m]: marks in the frame of the target. `truth` (N, 3): true positions of synthetic pictures. `synthetic`:
    seed and noise as text; "" for measured ones.

    Raises ArgumentError for shapes that do not match, numbers that are not finite, a repeated name or corner, and an
    index out of range.
    """

    cameras: Sequence[str]
    poses: Sequence[str]
    marks: Sequence[str]
    camera: np.ndarray
    pose: np.ndarray
    mark: np.ndarray
    uv: np.ndarray
    sigma: np.ndarray
    actuators: np.ndarray
    target: np.ndarray
    device: SecondDevice | None = None
    truth: np.ndarray | None = None
    rates: np.ndarray | None = None
    synthetic: str = ""

    def __post_init__(self) -> None:
        n = len(self.camera)
        shapes = [np.shape(a) for a in (self.camera, self.pose, self.mark, self.uv, self.sigma)]
        if shapes != [(n,), (n,), (n,), (n, 2), (n,)] or not n:
            raise ArgumentError(
                f"found corner columns of the shapes {shapes}; expected n rows in each, (n, 2) for u and v", "corners"
            )
        if len(self.actuators) != len(self.poses) or np.shape(self.target) != (len(self.marks), 3):
            raise ArgumentError(
                f"found {len(self.actuators)} rows of actuators for {len(self.poses)} poses, and a target of shape "
                f"{np.shape(self.target)} for {len(self.marks)} marks",
                "actuators",
            )
        if self.rates is not None and np.shape(self.rates) != np.shape(self.actuators):
            raise ArgumentError(f"found rates of shape {np.shape(self.rates)}; expected that of the actuators", "rates")
        values = {"corners": self.uv, "actuators": self.actuators, "target": self.target, "truth": self.truth,
                 "rates": self.rates, "device": None if self.device is None else self.device.T}  # fmt: skip
        wrong = [name for name, x in values.items() if x is not None and not np.all(np.isfinite(x))]
        if wrong:
            raise ArgumentError("found a number that is not finite", wrong[0])
        if not np.all(np.isfinite(self.sigma) & (self.sigma > 0)):
            raise ArgumentError("found a sigma that is not finite and positive", "corners")
        self._require_names()
        key = (self.camera * len(self.poses) + self.pose) * len(self.marks) + self.mark
        keys, count = np.unique(key, return_counts=True)
        if np.any(count > 1):
            k = int(np.flatnonzero(key == keys[np.argmax(count)])[0])
            raise ArgumentError(f"{self.where(k)} occurs more than once; keep one", "corners")

    def _require_names(self) -> None:
        """Raise ArgumentError for a repeated name, and for an index out of range."""
        columns = (
            ("camera", self.camera, self.cameras),
            ("pose", self.pose, self.poses),
            ("mark", self.mark, self.marks),
        )
        for kind, index, names in columns:
            if len(set(names)) < len(names):
                twice = next(n for k, n in enumerate(names) if n in names[:k])
                raise ArgumentError(f"two {kind}s are named '{twice}'; use unique names", "corners")
            low, high = np.min(index), np.max(index)
            if not np.issubdtype(np.asarray(index).dtype, np.integer) or low < 0 or high >= len(names):
                raise ArgumentError(
                    f"found {kind} indices {low} to {high}; expected whole numbers from 0, of {len(names)} {kind}s",
                    "corners",
                )

    def __len__(self) -> int:
        return len(self.camera)

    @property
    def picture(self) -> np.ndarray:
        """Index (n,) of the picture of each corner: camera * poses + pose."""
        return self.camera * len(self.poses) + self.pose

    def where(self, k: int) -> str:
        """Return a description of a corner."""
        return f"mark {self.marks[self.mark[k]]} of pose {self.poses[self.pose[k]]} in {self.cameras[self.camera[k]]}"

    def picture_name(self, number: int) -> str:
        """Return a description of a picture."""
        camera, pose = divmod(int(number), len(self.poses))
        return f"pose {self.poses[pose]} in {self.cameras[camera]}"

    def corners(self, keep: np.ndarray) -> RobotPictures:
        """Return some of the corners, by index or mask; poses stay."""
        return replace(self, **{n: getattr(self, n)[keep] for n in ("camera", "pose", "mark", "uv", "sigma")})

    def part(self, rows: np.ndarray) -> RobotPictures:
        """Return some of the poses (k,), by index, with their corners."""
        place = np.full(len(self.poses), -1)
        place[rows] = np.arange(len(rows))
        keep = place[self.pose] >= 0
        device = self.device
        if device is not None:
            inside = place[device.pose] >= 0
            device = SecondDevice(place[device.pose][inside], device.T[inside], device.noise)
        columns = {n: getattr(self, n)[keep] for n in ("camera", "mark", "uv", "sigma")}
        return replace(
            self, **columns, pose=place[self.pose[keep]], poses=[self.poses[int(k)] for k in rows],
            actuators=self.actuators[rows], device=device, truth=None if self.truth is None else self.truth[rows],
            rates=None if self.rates is None else self.rates[rows],
        )  # fmt: skip
