"""Readings that no calibration should be built on: drift, colour, another frame or unit, contact, ends of a range."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...geometry.rotations import angle_between, nearest_rotation
from ...inference import chi_squared_over_noise, freedom_of, held_out_ratio
from ...inference.residuals import shown_p
from ...measurements.inspection import residual_tests
from ...measurements.inspection.data_tests import Data, tested
from ...measurements.inspection.readings import NEARER, OtherReading, compared
from ...results import Estimate
from ...results.suspicion import Suspicion

ROUNDING = 1e-9  # of the largest reading: below it residuals are no noise
SAME = 3  # equal readings at an end: noise does not repeat itself
UNEXPLAINED = 0.2  # rms of what is left over that of the weight: ours; readings of a frame 10 degrees off leave 0.14
REACH = 3.0  # m, from a sensor to the centre of what it carries, ours: tools are shorter
KEPT = 2 / 3  # of the poses, the first ones: they predict the others
LOOK = "look at the row where the residual is largest: contact, motion, a saturated reading, or units"
FRAMES = "give turns whose columns are the sensor's axes in the world frame, and readings in the sensor's frame"


@dataclass(frozen=True, eq=False)
class FittedReadings:
    """A linear fit of readings `values` (poses, 3) by J (poses, 3, n), in SI. Its columns `load` are those of the load,
    `load_of` makes them of gravity in the sensor's frame (poses, 3)."""

    word: str
    estimate: Estimate
    sigma: float | None
    J: np.ndarray
    values: np.ndarray
    load: slice
    load_of: Callable[[np.ndarray], np.ndarray]

    @property
    def left(self) -> np.ndarray:
        """Residuals (poses, 3) in the unit of the readings."""
        return self.values - self.J @ self.estimate.values

    @property
    def least(self) -> float:
        """Residuals below it are rounding."""
        return ROUNDING * float(np.abs(self.values).max())


def suspicions_of(part: FittedReadings, turns: np.ndarray, time: np.ndarray, gravity: np.ndarray) -> list[Suspicion]:
    """All tests of the forces or of the moments; `time` (poses,) may be the numbers of the poses."""
    word, e, J, left = part.word, part.estimate, part.J, part.left
    unit = e.units[0]
    drift = "estimate the drift (drift = true), let the sensor warm up, or take poses in random order"
    outcomes = [
        residual_tests.drifts(J, left, time, drift, name=f"{word}_drift", unit=unit, least=part.least),
        residual_tests.coloured(
            J, left, "estimate a drift, or average each pose over longer; intervals allow for it",
            name=f"{word}_coloured", least=part.least,
        ),
        residual_tests.one_far_off(J, left, LOOK, name=f"{word}_largest_residual", least=part.least),
        _held_out(part),
        _other_frame(part, turns, gravity),
        _other_axes(part, turns, gravity),
        *tested(Data(residuals=left, row="pose")),
    ]  # fmt: skip
    if part.sigma is not None:
        squares = float(np.sum(np.square(left))) / part.sigma**2
        judged = chi_squared_over_noise(squares, e.degrees_of_freedom)
        outcomes.append(judged.suspicion(f"{word}_over_noise", LOOK))
    return outcomes


def beside_the_weight(part: FittedReadings, mass: float, gravity: np.ndarray) -> Suspicion:
    """Whether forces leave too large a share of the weight; where their noise was stated it is judged by that."""
    weight = abs(mass) * float(np.linalg.norm(gravity)) / np.sqrt(3)
    share = _rms(part.left, part.estimate.degrees_of_freedom) / weight
    beyond = part.sigma is None and share > UNEXPLAINED
    return Suspicion(
        "force_unexplained_share", f"the forces leave {100 * share:.3g} % of the weight", 0.0 if beyond else 1.0,
        f"{LOOK}; {FRAMES}; or state the noise if it is as large",
    )  # fmt: skip


def far_centre(centre: Estimate) -> Suspicion:
    """Whether the centre is farther from the sensor than any tool reaches: moments in N mm."""
    at, sure = float(np.linalg.norm(centre.values)), float(np.linalg.norm(centre.std))
    return Suspicion(
        "moment_unit",
        f"the centre of mass would be {at:.3g} m from the sensor; read in N mm the moments have it at {at:.3g} mm",
        0.0 if at - 3 * sure > REACH else 1.0,
        "give the moments in N m",
    )


def _held_out(part: FittedReadings) -> Suspicion:
    """The last poses by a fit of the first ones."""
    word, J, y = part.word, part.J, part.values
    n, first = J.shape[2], round(KEPT * len(J))
    A, b = J[:first].reshape(-1, n), y[:first].reshape(-1)
    C, d = J[first:].reshape(-1, n), y[first:].reshape(-1)
    spare = len(A) - n
    growth, degrees, ratio = np.nan, 0.0, np.nan
    x, _, rank, _ = np.linalg.lstsq(A, b, rcond=None)
    own = float(np.sum((b - A @ x) ** 2)) / max(spare, 1)
    if spare > 0 and rank == n and own > part.least**2:
        extra = C @ np.linalg.pinv(A)
        S = extra @ extra.T + np.eye(len(C))
        growth, degrees = float(np.trace(S)) / len(C), freedom_of(float(np.trace(S)), float(np.sum(S**2)))
        ratio = float(np.sqrt(np.mean((d - C @ x) ** 2) / own))
    remedy = "the last poses contradict the first ones: look for another load, a drift, a changed bias or contact"
    return held_out_ratio(ratio, growth, spare, degrees).suspicion(f"{word}_held_out", remedy)


def _other_frame(part: FittedReadings, turns: np.ndarray, gravity: np.ndarray) -> Suspicion:
    """Turns read as transposed, readings as those of the world frame, or both: what is left by the same unknowns."""
    world = turns.transpose(0, 2, 1)
    given = {
        "with transposed turns": (world, part.values),
        "read in the world frame": (turns, np.einsum("nji,nj->ni", turns, part.values)),
        "with transposed turns and read in the world frame": (world, np.einsum("nij,nj->ni", turns, part.values)),
    }
    dof = part.estimate.degrees_of_freedom

    def left(r: OtherReading) -> float:
        R, values = given[r.when]
        A, y = part.J.copy(), values.reshape(-1)
        A[:, :, part.load] = part.load_of(R.transpose(0, 2, 1) @ gravity)
        A = A.reshape(len(y), -1)
        return _rms(y - A @ np.linalg.lstsq(A, y, rcond=None)[0], dof)

    readings = [OtherReading(f"{part.word}_frame", f"{part.word}s {said}", said) for said in given]
    best = compared(_rms(part.left, dof), readings, left, dof, least=part.least)
    evidence = f"{best.reading.looks}: they fit {best.ratio:.3g} times better ({shown_p(best.p)})"
    return Suspicion(best.reading.name, evidence, best.p, FRAMES)


def _rms(left: np.ndarray, degrees_of_freedom: float) -> float:
    return float(np.sqrt(np.sum(left**2) / max(degrees_of_freedom, 1)))


def _other_axes(part: FittedReadings, turns: np.ndarray, gravity: np.ndarray) -> Suspicion:
    """Sensor's axes that are turned against those of the turns, or scaled: gravity acts by a full matrix."""
    g = turns.transpose(0, 2, 1) @ gravity
    every = np.einsum("nk,ij->nijk", g, np.eye(3)).reshape(len(g), 3, 9)
    test = residual_tests.explained_by(part.J, part.left, every, least=part.least)
    evidence = "axes: too few rows are left to test"
    p = test.p
    if not np.isnan(p):
        before = float(np.sum(part.left**2)) / (test.more + test.rest)
        after = float(np.sum((part.left - test.moved) ** 2)) / test.rest
        times = float(np.sqrt(before / max(after, part.least**2, np.finfo(float).tiny)))
        p = p if times > NEARER else 1.0
        evidence = f"with axes of its own the sensor's {part.word}s fit {times:.3g} times better"
        if part.word == "force":
            modelled = part.J @ part.estimate.values + test.moved
            A = np.concatenate([np.delete(part.J, part.load, axis=2), every], axis=2).reshape(3 * len(g), -1)
            B = np.linalg.lstsq(A, modelled.reshape(-1), rcond=None)[0][-9:].reshape(3, 3)
            angle = np.rad2deg(angle_between(nearest_rotation(B), np.eye(3)))
            evidence += f", turned by {angle:.3g} degrees against those of the turns"
    return Suspicion(f"{part.word}_axes", evidence, p, f"correct the mounting that the turns assume; {FRAMES}")


def ends_of_range(readings: np.ndarray, name: str) -> list[str]:
    """Notes on components (rows, 3) that stop at the same number in several poses, below what else they reach."""
    notes = []
    for axis, values in zip("xyz", readings.T, strict=True):
        for end in (float(values.max()), float(values.min())):
            count = int(np.count_nonzero(values == end))
            if SAME <= count < len(values) and end != 0.0:
                notes.append(
                    f"{name} {axis} reads exactly {end:g} in {count} poses, an end of its readings: saturated?"
                )
    return notes
