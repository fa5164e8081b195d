"""Synthetic measurements problems/data/*_poses_synthetic.csv: three parallel robots with known errors of geometry.

`python -m tests.support.mechanism_poses` writes them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import gtmodel as gt
from problems.models import mechanisms

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
SEED = 4405
POSITION = 3e-5  # m, noise of each coordinate
ANGLE = 1e-4  # rad, noise of the platform's angle
ENCODER = 2e-5  # rad, noise of each motor angle
LENGTH_ERROR, ZERO_ERROR = 1e-3, 5e-3  # standard deviations of the errors [m, rad]


@dataclass(frozen=True)
class Poses:
    """A robot, the box of its poses by variable, and the number of poses."""

    model: type[gt.Model]
    box: dict[str, tuple[list[float], list[float]]]
    count: int

    @property
    def truth(self) -> gt.Model:
        """The robot with errors in all its lengths and zeros."""
        rng = np.random.default_rng(SEED)
        nominal = self.model()
        names = [n for n in ("A", "B", "radius", "upper", "lower", "zero") if hasattr(self.model, n)]
        errors = {n: (ZERO_ERROR if n == "zero" else LENGTH_ERROR) for n in names}
        values = {n: np.asarray(getattr(nominal, n)) for n in names}
        return self.model(**{n: x + errors[n] * rng.standard_normal(x.shape) for n, x in values.items()})

    def rows(self) -> dict[str, np.ndarray]:
        """Readings by variable (count, n), in m and rad, with noise."""
        rng = np.random.default_rng(SEED + 1)
        poses = {n: rng.uniform(low, high, (self.count, len(low))) for n, (low, high) in self.box.items()}
        arguments = [x[:, 0] if n == "angle" else x for n, x in poses.items()]
        q, status = self.truth.causal(list(poses), "q")(*arguments)
        assert np.all(status == gt.Status.OK)
        noise = {n: ANGLE if n == "angle" else POSITION for n in poses} | {"q": ENCODER}
        poses["q"] = q
        return {n: x + noise[n] * rng.standard_normal(x.shape) for n, x in poses.items()}


ALL = {
    "delta": Poses(mechanisms.Delta, {"T": ([-0.25, -0.25, -0.9], [0.25, 0.25, -0.6])}, 60),
    "five_bar": Poses(mechanisms.FiveBar, {"x": ([-0.1, 0.45], [0.5, 0.75])}, 50),
    "planar_3rrr": Poses(mechanisms.ThreeArms, {"x": ([0.3, 0.15], [0.5, 0.35]), "angle": ([-0.4], [0.6])}, 70),
}


def text(name: str) -> str:
    """The file: lengths in mm, angles in degrees."""
    rows = ALL[name].rows()
    columns = [f"{n}[{k}]" if x.shape[1] > 1 else n for n, x in rows.items() for k in range(x.shape[1])]
    table = np.hstack([np.degrees(x) if n in ("q", "angle") else 1e3 * x for n, x in rows.items()])
    note = (
        f"# synthetic: seed {SEED}, noise {1e6 * POSITION:g} um of each coordinate, {1e6 * ENCODER:g} urad of each "
        f"motor, {1e6 * ANGLE:g} urad of the platform; tests/support/mechanism_poses.py writes it"
    )
    lines = [",".join(f"{v:.5f}" for v in row) for row in table]
    return "\n".join([note, ",".join(columns), *lines]) + "\n"


def file_of(name: str) -> Path:
    return PROBLEMS / "data" / f"{name}_poses_synthetic.csv"


if __name__ == "__main__":
    for each in ALL:
        file_of(each).write_text(text(each), encoding="utf-8")
