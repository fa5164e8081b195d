"""Calibration of a force sensor's bias and load from readings at rest in several poses, with tests of the readings."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ...geometry.rotations import angle_between, cross_matrix, nearest_rotation
from ...inference import (
    RandomWalkFit,
    chi_squared_over_noise,
    freedom_of,
    held_out_ratio,
    linear_fit,
    newey_west,
    random_walk_fit,
)
from ...inference.residuals import SMALL_P, shown_p
from ...measurements.drift import DriftBasis, drift_basis
from ...measurements.inspection import residual_tests
from ...measurements.inspection.data_tests import Data, tested
from ...measurements.inspection.misread_columns import NEARER, OtherReading, compared
from ...results import ArgumentError, Estimate, naming
from ...results.suspicion import Suspicion, alarms, suspicion_checks
from .drift import Word, by_blocks, drift_names, drift_suspicions, walk_notes
from .options import Drift, WrenchAlarm
from .scenes import GRAVITY
from .wrench import WrenchStatus, axes, rows_of, sigma_of, turns_of, vector_of

ROUNDING = 1e-9  # of the largest reading: smaller residuals are rounding errors
SAME = 3  # equal extreme readings that suggest saturation
UNEXPLAINED = 0.2  # largest rms of the residuals over that of the weight, our choice; a frame 10 degrees off gives 0.14
REACH = 3.0  # m, largest distance from a sensor to the centre of its load, our choice
KEPT = 2 / 3  # share of the poses, from the first on, that predict the others
LOOK = "look at the row with the largest residual: contact, motion, a saturated reading, or units"
FRAMES = "give turns whose columns are the sensor's axes in the world frame, and readings in the sensor's frame"


@dataclass(frozen=True, eq=False)
class FittedReadings:
    """A linear fit of `readings` (poses, 3) [SI]: `values` (poses, 3) with the regressor J (poses, 3, n), both whitened
    if the bias performs a random walk, `walk`. `load`: columns of the load; `load_of`: computes them, not whitened,
    from gravity in the sensor's frame (poses, 3)."""

    word: Word
    estimate: Estimate
    sigma: float | None
    J: np.ndarray
    values: np.ndarray
    load: slice
    load_of: Callable[[np.ndarray], np.ndarray]
    readings: np.ndarray
    walk: RandomWalkFit | None = None

    def white(self, rows: np.ndarray) -> np.ndarray:
        """Return rows (poses, 3, ...) as they are fitted."""
        return rows if self.walk is None else self.walk.white(rows)

    @property
    def rest(self) -> np.ndarray:
        """Residuals (poses, 3) in the unit of the readings, or in standard deviations with a random walk."""
        return self.values - self.J @ self.estimate.values

    @property
    def least(self) -> float:
        """Residuals below this are rounding errors."""
        return ROUNDING * float(np.abs(self.values).max())


def suspicions_of(part: FittedReadings, turns: np.ndarray, drift: DriftBasis, gravity: np.ndarray) -> list[Suspicion]:
    """Run all tests of the forces or of the moments."""
    word, e, J, rest = part.word, part.estimate, part.J, part.rest
    outcomes = [
        *drift_suspicions(drift, word, e.units[0], J, rest, part.least),
        residual_tests.one_far_off(J, rest, LOOK, name=f"{word}_largest_residual", least=part.least),
        _held_out(part),
        _other_frame(part, turns, gravity),
        _other_axes(part, turns, gravity),
        *tested(Data(residuals=rest, row="pose")),
    ]  # fmt: skip
    if part.sigma is not None:
        squares = float(np.sum(np.square(rest))) / (part.sigma**2 if part.walk is None else 1.0)
        outcomes.append(chi_squared_over_noise(squares, e.degrees_of_freedom).suspicion(f"{word}_over_noise", LOOK))
    return outcomes


def beside_the_weight(part: FittedReadings, mass: float, gravity: np.ndarray) -> Suspicion:
    """Test whether the residuals of the forces are too large a share of the weight; not with a stated noise."""
    weight = abs(mass) * float(np.linalg.norm(gravity)) / np.sqrt(3)
    noise = part.estimate.noise if part.walk is not None else _rms(part.rest, part.estimate.degrees_of_freedom)
    share = noise / weight
    beyond = part.sigma is None and share > UNEXPLAINED
    return Suspicion(
        "force_unexplained_share", f"the residuals of the forces are {100 * share:.3g} % of the weight",
        0.0 if beyond else 1.0, f"{LOOK}; {FRAMES}; or state the noise if it is as large",
    )  # fmt: skip


def far_centre(centre: Estimate) -> Suspicion:
    """Test whether the centre is farther from the sensor than any tool reaches, as with moments in N mm."""
    distance, std = float(np.linalg.norm(centre.values)), float(np.linalg.norm(centre.std))
    return Suspicion(
        "moment_unit",
        f"the centre of mass would be {distance:.3g} m from the sensor; with moments in N mm it is {distance:.3g} mm",
        0.0 if distance - 3 * std > REACH else 1.0,
        "give the moments in N m",
    )


def _held_out(part: FittedReadings) -> Suspicion:
    """Predict the last poses from a fit of the first ones."""
    word, J, y = part.word, part.J, part.values
    n, first = J.shape[2], round(KEPT * len(J))
    A, b = J[:first].reshape(-1, n), y[:first].reshape(-1)
    C, d = J[first:].reshape(-1, n), y[first:].reshape(-1)
    spare = len(A) - n
    growth, degrees, ratio = np.nan, 0.0, np.nan
    x, _, rank, _ = np.linalg.lstsq(A, b, rcond=None)
    variance = float(np.sum((b - A @ x) ** 2)) / max(spare, 1)
    if spare > 0 and rank == n and variance > part.least**2:
        extra = C @ np.linalg.pinv(A)
        S = extra @ extra.T + np.eye(len(C))
        growth, degrees = float(np.trace(S)) / len(C), freedom_of(float(np.trace(S)), float(np.sum(S**2)))
        ratio = float(np.sqrt(np.mean((d - C @ x) ** 2) / variance))
    remedy = "the last poses contradict the first ones: look for another load, a drift, a changed bias or contact"
    return held_out_ratio(ratio, growth, spare, degrees).suspicion(f"{word}_held_out", remedy)


def _other_frame(part: FittedReadings, turns: np.ndarray, gravity: np.ndarray) -> Suspicion:
    """Compare fits with transposed turns, with readings in the world frame, and with both."""
    world = turns.transpose(0, 2, 1)
    data = {
        "with transposed turns": (world, part.readings),
        "read in the world frame": (turns, np.einsum("nji,nj->ni", turns, part.readings)),
        "with transposed turns and read in the world frame": (world, np.einsum("nij,nj->ni", turns, part.readings)),
    }
    dof = float(part.values.size - part.J.shape[2])

    def residual(r: OtherReading) -> float:
        R, values = data[r.when]
        A, y = part.J.copy(), part.white(values).reshape(-1)
        A[:, :, part.load] = part.white(part.load_of(R.transpose(0, 2, 1) @ gravity))
        A = A.reshape(len(y), -1)
        return _rms(y - A @ np.linalg.lstsq(A, y, rcond=None)[0], dof)

    readings = [OtherReading(f"{part.word}_frame", f"{part.word}s {case}", case) for case in data]
    best = compared(_rms(part.rest, dof), readings, residual, dof, least=part.least)
    evidence = f"{best.reading.looks}: they fit {best.ratio:.3g} times better ({shown_p(best.p)})"
    return Suspicion(best.reading.name, evidence, best.p, FRAMES)


def _rms(rest: np.ndarray, degrees_of_freedom: float) -> float:
    return float(np.sqrt(np.sum(rest**2) / max(degrees_of_freedom, 1)))


def _other_axes(part: FittedReadings, turns: np.ndarray, gravity: np.ndarray) -> Suspicion:
    """Test whether the sensor's axes are rotated or scaled against the turns, with a full matrix on gravity."""
    g = turns.transpose(0, 2, 1) @ gravity
    every = part.white(np.einsum("nk,ij->nijk", g, np.eye(3)).reshape(len(g), 3, 9))
    test = residual_tests.explained_by(part.J, part.rest, every, least=part.least)
    evidence = "axes: there are too few rows to test"
    p = test.p
    if not np.isnan(p):
        before = float(np.sum(part.rest**2)) / (test.more + test.rest)
        after = float(np.sum((part.rest - test.moved) ** 2)) / test.rest
        times = float(np.sqrt(before / max(after, part.least**2, np.finfo(float).tiny)))
        p = p if times > NEARER else 1.0
        evidence = f"with axes different from the turns the sensor's {part.word}s fit {times:.3g} times better"
        if part.word == "force":
            modelled = part.J @ part.estimate.values + test.moved
            A = np.concatenate([np.delete(part.J, part.load, axis=2), every], axis=2).reshape(3 * len(g), -1)
            B = np.linalg.lstsq(A, modelled.reshape(-1), rcond=None)[0][-9:].reshape(3, 3)
            angle = np.rad2deg(angle_between(nearest_rotation(B), np.eye(3)))
            evidence += f", rotated by {angle:.3g} degrees"
    return Suspicion(f"{part.word}_axes", evidence, p, f"correct the mounting assumed by the turns; {FRAMES}")


def ends_of_range(readings: np.ndarray, name: str) -> list[str]:
    """Return notes on components (rows, 3) whose extreme reading is the same number in several poses."""
    notes = []
    for axis, values in zip("xyz", readings.T, strict=True):
        for end in (float(values.max()), float(values.min())):
            count = int(np.count_nonzero(values == end))
            if SAME <= count < len(values) and end != 0.0:
                notes.append(
                    f"{name} {axis} reads exactly {end:g}, its extreme, in {count} poses: check for saturation"
                )
    return notes


LEVEL = 0.95  # confidence of the interval of the mass that must exclude zero
UNSEEN = 1.0  # of a reading's noise: if the weight is less certain, the poses do not determine it


@dataclass(frozen=True, eq=False)
class WrenchCalibration:
    """Bias of a force sensor, and mass and centre of mass of its load.

    force: Estimate of bias_force_x, _y, _z [N] and mass [kg].
    moment: Estimate of bias_moment_x, _y, _z [N m] and first_moment_x, _y, _z [kg m], mass times centre.
    centre: Estimate of centre_x, _y, _z [m], from the sensor's origin in the sensor's frame; None if the mass does not
        differ significantly from zero.
    status: OK; NO_FORCE if the interval of the mass contains zero: the bias is usable, the centre is not; WRONG_SIGN if
        the mass is negative; DOUBTFUL if a test of the readings raises an alarm that was not accepted.
    gravity: (3,) [m/s2] in the world frame.
    suspicions: result of each test of the readings. accepted: names of alarms that do not change the status.
    notes: sentences on a random walk of the bias.
    """

    force: Estimate
    moment: Estimate
    centre: Estimate | None
    status: WrenchStatus
    gravity: np.ndarray
    suspicions: tuple[Suspicion, ...] = ()
    accepted: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def reversed(self) -> bool:
        """Whether the mass is negative, including its interval."""
        return self.force.interval("mass", LEVEL)[1] < 0

    @property
    def alarms(self) -> list[Suspicion]:
        """Alarms of the tests, including accepted ones, strongest first."""
        return alarms(self.suspicions)

    def weight(self, turns: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return force (poses, 3) [N] and moment (poses, 3) [N m] of the load's weight in the sensor's frame.

        turns (poses, 3, 3) as in `calibrate_wrench`. Raises ArgumentError if one is not a rotation matrix.
        """
        g = turns_of(turns, "turns").transpose(0, 2, 1) @ self.gravity
        return self.force.value("mass") * g, np.cross(self.moment.values[3:6], g)

    def contact(self, turns: ArrayLike, forces: ArrayLike, moments: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return readings without bias and weight: the external wrench on the load, at rest, in the sensor's frame.

        turns (poses, 3, 3), forces and moments (poses, 3) [N], [N m] as in `calibrate_wrench`. Raises ArgumentError if
        shapes do not fit, if numbers are not finite, or if the calibrated mass is negative.
        """
        if self.reversed:
            why = WrenchStatus.WRONG_SIGN.message
            raise ArgumentError(f"this calibration gives no contact forces: {why}")
        weight, weight_moment = self.weight(turns)
        f, m = rows_of(forces, "forces", len(weight)), rows_of(moments, "moments", len(weight))
        return f - self.force.values[:3] - weight, m - self.moment.values[:3] - weight_moment

    def __str__(self) -> str:
        parts = [str(self.force), str(self.moment), *([str(self.centre)] if self.centre else [])]
        return "\n".join(
            [*parts, self.status.message, *suspicion_checks(self.suspicions, self.accepted)[1], *self.notes]
        )


def calibrate_wrench(
    turns: ArrayLike,
    forces: ArrayLike,
    moments: ArrayLike,
    *,
    gravity: ArrayLike = GRAVITY,
    sigma_force: float | None = None,
    sigma_moment: float | None = None,
    time: ArrayLike | None = None,
    drift: bool | Drift | Sequence[Drift] = "none",
    session: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    accept: Collection[str] = (),
) -> WrenchCalibration:
    """Fit bias, mass and centre of mass of a force sensor's load, ten parameters, by linear least squares.

    At rest and without contact, force = bias_force + mass g and moment = bias_moment + (mass centre) x g, with g in
    the sensor's frame; readings are the wrench *on* the load. The two equations share no parameter and are fitted
    separately. Handle and tool sensor are each calibrated with their own readings.

    The readings are tested for drift over time, sessions and temperature, coloured residuals, a large single residual,
    prediction of the last poses from the first ones, other frames and axes, moments in N mm, and residuals above the
    stated noise or, without a stated noise, above a fifth of the weight. Clean readings raise an alarm in 1 % of all
    calibrations. With coloured residuals the intervals are widened (`gt.inference.newey_west`).

    Args:
        turns: (poses, 3, 3) rotation matrices whose columns are the sensor's axes in the world frame. In the sensor's
            frame gravity must have at least three directions whose tips do not lie on a line.
        forces, moments: (poses, 3) readings [N], [N m] about the sensor's origin, in its frame.
        gravity: (3,) [m/s2] in the world frame.
        sigma_force, sigma_moment: standard deviation of one reading [N], [N m]; by default from the residuals.
        time: (poses,) [s], increasing in each session, of each reading; by default the index of the pose.
        drift: drifts of the biases to estimate, one or several: "linear" in time, drift_force_x, ... [N/s] and
            drift_moment_x, ... [N m/s]; "session", with a bias for each; "temperature", thermal_force_x, ... [N/K];
            "blocks" alone, with a bias for each of up to 10 blocks of poses, for an irregular drift: its intervals
            come from the scatter of the blocks and hold for residuals of any colour; "random_walk", whose size is
            estimated (`gt.inference.random_walk_fit`). True is "linear", False "none". The biases are then those at the
            last reading.
        session: (poses,) number of the recording of each reading; a session is contiguous.
        temperature: (poses,) [K] of the sensor at each reading.
        accept: names of alarms that do not change the status, such as "force_coloured".

    The interval of the centre is that of a quotient to first order, from Student's distribution with the degrees of
    freedom of the moments. Raises ArgumentError if shapes do not fit, if numbers are not finite, if there are too few
    poses, or if the poses do not determine a parameter, by rank or within the noise.

    >>> rng = np.random.default_rng(1)  # synthetic readings, noise 0.05 N and 0.002 N m, seed 1
    >>> turns = np.linalg.qr(rng.normal(size=(30, 3, 3)))[0]
    >>> turns *= np.linalg.det(turns)[:, None, None]
    >>> g = turns.transpose(0, 2, 1) @ [0.0, 0.0, -9.81]
    >>> forces = [1.0, -2.0, 0.5] + 0.8 * g + 0.05 * rng.normal(size=(30, 3))
    >>> moments = np.cross([0.0, 0.0, 0.8 * 0.1], g) + 0.002 * rng.normal(size=(30, 3))
    >>> c = gt.control.lead_through.calibrate_wrench(turns, forces, moments)
    >>> c.status.name, round(c.force.value("mass"), 2), round(c.centre.value("centre_z"), 3)
    ('OK', 0.8, 0.1)
    """
    R, down = turns_of(turns, "turns"), vector_of(gravity, "gravity")
    if not np.any(down):
        raise ArgumentError("must not be zero: the calibration uses the weight", "gravity")
    f, m = rows_of(forces, "forces", len(R)), rows_of(moments, "moments", len(R))
    sigma_of(sigma_force, "sigma_force")
    sigma_of(sigma_moment, "sigma_moment")
    g = R.transpose(0, 2, 1) @ down
    drifts = drift_basis(drift, len(R), time, session, temperature)
    with naming("turns"):
        of_force = _fitted("force", "mass", f, g, sigma_force, drifts)
        of_moment = _fitted("moment", axes("first_moment"), m, g, sigma_moment, drifts)
    outcomes = [*suspicions_of(of_force, R, drifts, down), *suspicions_of(of_moment, R, drifts, down)]
    outcomes += tested(Data({"turn": R, "force": f, "moment": m}, row="pose"))
    force, moment = (_with_colour(part, outcomes, drifts) for part in (of_force, of_moment))
    low, high = force.interval("mass", LEVEL)
    status = WrenchStatus.OK if low > 0 else WrenchStatus.WRONG_SIGN if high < 0 else WrenchStatus.NO_FORCE
    unsure = float(force.std[3] * np.linalg.norm(down))  # [N]
    if status is WrenchStatus.NO_FORCE and unsure > UNSEEN * (sigma_force or force.noise):
        raise ArgumentError(
            f"hardly change gravity's direction in the sensor's frame: the standard deviation of weight and bias is "
            f"{unsure:.3g} N; take poses that differ more",
            "turns",
        )
    centre = None if status is WrenchStatus.NO_FORCE else _centre(force, moment)
    outcomes += [beside_the_weight(of_force, force.value("mass"), down)] if centre is not None else []
    outcomes += [far_centre(centre)] if centre is not None else []
    unknown = [name for name in accept if name not in get_args(WrenchAlarm)]
    if unknown:
        names = ", ".join(get_args(WrenchAlarm))
        raise ArgumentError(f"'{unknown[0]}' is not an alarm of a force sensor; expected {names}", "accept")
    if any(s.name not in accept for s in alarms(outcomes)):
        status = WrenchStatus.DOUBTFUL
    notes = () if of_force.walk is None else walk_notes(of_force.walk, _regressor(of_force, g), force.value("mass"))
    return WrenchCalibration(force, moment, centre, status, down, tuple(outcomes), tuple(accept), notes)


def _regressor(part: FittedReadings, g: np.ndarray) -> np.ndarray:
    """Regressor (poses, 3, 4) of bias and load."""
    return np.concatenate([np.broadcast_to(np.eye(3), (len(g), 3, 3)), part.load_of(g)], axis=2)


def _fitted(
    word: Word, load: str | Sequence[str], values: np.ndarray, g: np.ndarray, sigma: float | None, drift: DriftBasis
) -> FittedReadings:
    """Fit readings (poses, 3) with a bias, the load and drifts relative to the last reading."""
    force = word == "force"
    unit = "N" if force else "N m"
    names, units = list(axes(f"bias_{word}")), [unit] * 3
    names += [load] if isinstance(load, str) else load
    units += ["kg"] if force else ["kg m"] * 3

    def load_of(g: np.ndarray) -> np.ndarray:
        return g[:, :, None] if force else -cross_matrix(g)

    one = np.broadcast_to(np.eye(3), (len(g), 3, 3))
    drifts = [column[:, None, None] * one for _, _, column in drift.columns()]
    more = drift_names(drift, word, unit)
    J = np.concatenate([one, load_of(g), *drifts], axis=2)
    place = slice(3, 4 if force else 6)
    estimate = linear_fit(
        J.reshape(values.size, -1), values.reshape(-1), names + more[0], sigma=sigma, units=units + more[1]
    )
    if "random_walk" not in drift.kinds:
        return FittedReadings(word, estimate, sigma, J, values, place, load_of, values)
    walk = random_walk_fit(J, values, drift.running, estimate.names, sigma=sigma, units=estimate.units)
    return FittedReadings(word, walk.estimate, sigma, walk.white(J), walk.white(values), place, load_of, values, walk)


def _with_colour(part: FittedReadings, outcomes: Sequence[Suspicion], drift: DriftBasis) -> Estimate:
    """The estimate, with the covariance by blocks, or that of Newey and West if the residuals are coloured."""
    e = part.estimate
    if "blocks" in drift.kinds:
        covariance = by_blocks(drift, part.J, part.values, e.values, part.load)
        return replace(e, covariance=covariance, degrees_of_freedom=float(drift.blocks[-1]), known_noise=False)
    if part.walk is not None:
        return e
    p = next(s.p for s in outcomes if s.name == f"{part.word}_coloured")
    return replace(e, covariance=newey_west(part.J, part.rest, starts=drift.starts)) if p < SMALL_P else e


def _centre(force: Estimate, moment: Estimate) -> Estimate:
    """first moment / mass; the two fits have independent noise."""
    mass, first = force.value("mass"), moment.values[3:6]
    J = np.column_stack([np.eye(3) / mass, -first / mass**2])
    covariance = J @ scipy.linalg.block_diag(moment.covariance[3:6, 3:6], force.covariance[3:4, 3:4]) @ J.T
    return Estimate(
        tuple(axes("centre")), first / mass, (covariance + covariance.T) / 2, moment.degrees_of_freedom, moment.noise,
        moment.known_noise, moment.residuals, (), units=("m",) * 3,
    )  # fmt: skip
