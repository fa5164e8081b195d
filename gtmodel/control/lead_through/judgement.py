"""Evaluation of a run of lead-through: contact force, alignment of a peg, and the operator's energy balance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ...geometry.rotations import rotation_by
from ...results import ArgumentError, Check, at_least, at_most
from .gains import SurfaceGains, TurningGains
from .law import LeadThroughLaw
from .options import GuideSetup, ServoChain
from .scenes import SyntheticHole, SyntheticSensor, SyntheticSurface
from .tool_run import ToolRun
from .wrench import rows_of


@dataclass(frozen=True, eq=False)
class PassivityBook:
    """Energy balance at the operator's port.

    energy (n,): energy supplied by the operator up to each instant [J]. stored (n,): energy stored in the apparent mass
    and the contact [J]. worst: least energy supplied over any window [J], negative if the operator received energy;
    window: its beginning and end [s]. deficit: most energy received by the operator over any window beyond the energy
    stored at its beginning [J]; about 0 for a passive robot. passed: total energy exchanged in both directions [J].
    """

    energy: np.ndarray
    stored: np.ndarray
    worst: float
    window: tuple[float, float]
    deficit: float
    passed: float

    @property
    def share(self) -> float:
        """deficit over the largest stored energy, so it does not depend on the length of the run."""
        if self.deficit == 0.0:
            return 0.0
        most = float(self.stored.max())
        return self.deficit / most if most > 0 else float("inf")

    def __str__(self) -> str:
        return (
            f"{self.passed:.3g} J exchanged at the handle; least energy over any window {self.worst:.3g} J, from "
            f"{self.window[0]:.3g} to {self.window[1]:.3g} s; returned beyond the stored energy {self.deficit:.3g} J"
        )


def passivity_book(
    time: ArrayLike,
    force: ArrayLike,
    moved: ArrayLike,
    stored: ArrayLike,
    *,
    moment: ArrayLike | None = None,
    turned: ArrayLike | None = None,
) -> PassivityBook:
    """Compute the energy balance at the operator's port over all windows.

    Args:
        time: (n,) [s]. force: (n, 3) [N] of the hand on the tool. moved: (n, 3) [m] positions of the tool.
        stored: (n,) [J] at least 0, the energy that the robot may return.
        moment: (n, 3) [N m] of the hand about the tool's point; turned: (n, 3) [rad] accumulated rotation.

    The work between two rows is that of the mean force. Raises ArgumentError if shapes do not fit or if numbers are not
    finite.

    >>> t = np.linspace(0.0, 1.0, 101)  # a mass of 2 kg is pushed and stopped
    >>> force = np.outer(4.0 * np.cos(np.pi * t), [1.0, 0.0, 0.0])
    >>> moved = np.outer(2.0 / np.pi**2 * (1.0 - np.cos(np.pi * t)), [1.0, 0.0, 0.0])
    >>> speed = 2.0 / np.pi * np.sin(np.pi * t)
    >>> book = gt.control.lead_through.passivity_book(t, force, moved, 0.5 * 2.0 * speed**2)
    >>> round(book.worst, 2), round(book.deficit, 3)  # all returned energy had been stored
    (-0.41, 0.0)
    """
    f, x = rows_of(force, "force"), rows_of(moved, "moved")
    t, s = (np.asarray(a, float).reshape(-1) for a in (time, stored))
    for name, a in (("time", t), ("moved", x), ("stored", s)):
        if len(a) != len(f) or not np.all(np.isfinite(a)):
            raise ArgumentError(f"expected {len(f)} finite rows, as in force; found {len(a)}", name)
    if np.any(s < 0):
        raise ArgumentError("must not be negative", "stored")
    if (moment is None) != (turned is None):
        raise ArgumentError("moment and turned must be set together", "turned")
    work = _work(f, x)
    if moment is not None and turned is not None:
        work = work + _work(rows_of(moment, "moment", len(f)), rows_of(turned, "turned", len(f)))
    energy = np.concatenate([[0.0], np.cumsum(work)])
    highest = np.maximum.accumulate(energy)
    end = int(np.argmin(energy - highest))
    begin = int(np.argmax(energy[: end + 1]))
    spare = energy + np.minimum.accumulate(s - energy)
    return PassivityBook(
        energy, s, float(energy[end] - energy[begin]), (float(t[begin]), float(t[end])),
        max(0.0, float(-spare.min())), float(np.abs(work).sum()),
    )  # fmt: skip


def _work(force: np.ndarray, moved: np.ndarray) -> np.ndarray:
    return np.einsum("ni,ni->n", (force[1:] + force[:-1]) / 2, np.diff(moved, axis=0))


TOO_MUCH = 1e-2  # of the largest stored energy, which is accurate to first order in the servo's times
STEP = 1e-6  # [m], [rad] of finite differences
ALIKE = 0.9  # of the force with which the hand releases contact, because the sensor is noisy
Answers = tuple[dict[str, Any], list[str], dict[str, Check]]


def along_normal(run: ToolRun, surface: SyntheticSurface) -> np.ndarray:
    """Return the force on the tool along the surface's true normal, (n,) [N]."""
    return np.array([surface.normal_at(x) @ f for x, f in zip(run.position, run.force, strict=True)])


def forces(
    run: ToolRun, surface: SyntheticSurface, law: LeadThroughLaw, gains: SurfaceGains, setup: GuideSetup,
    tool: SyntheticSensor,
) -> Answers:  # fmt: skip
    """Evaluate the force along the normal in settled contact, and the losses of contact."""
    pressed, contact = along_normal(run, surface), run.contact
    ends = np.flatnonzero(contact[:-1] & ~contact[1:]) + 1
    released = run.hand_force[ends] @ np.array(law.translation.normal) >= ALIKE * gains.release_force
    losses = int(np.count_nonzero(~released))
    checks = {"contact_losses": at_most(losses, 0, "press less when making contact, or lower the gain")}
    answers: dict[str, Any] = {
        "contact_losses": losses, "peak_force": float(pressed.max()), "gain_share": float(run.share[-1])
    }  # fmt: skip
    touching = np.flatnonzero(contact)
    settled = contact & (run.time >= (run.time[touching[0]] if len(touching) else np.inf) + setup.settled)
    if np.count_nonzero(settled) < 2:
        checks["settled_contact_s"] = Check(0.0, gains.cycle, "make contact and keep it longer", least=True)
        return answers, ["the tool was in contact too briefly to judge its force"], checks
    force = pressed[settled]
    normals = np.array([surface.normal_at(x) for x in run.position[settled]])
    off = np.arccos(np.clip(np.einsum("ni,ni->n", normals, run.normal[settled]), -1.0, 1.0))
    spectrum = np.abs(np.fft.rfft(np.hanning(len(force)) * (force - force.mean())))
    frequency = np.fft.rfftfreq(len(force), gains.cycle)[int(np.argmax(spectrum))]
    error = float(force.mean()) - gains.force_reference
    checks["mean_force_error_N"] = at_most(
        abs(error), setup.tolerance, "move slower, filter the normal more, or raise the gain within its limit"
    )
    answers |= {
        "mean_force": float(force.mean()), "least_force": float(force.min()),
        "force_deviation": float(np.sqrt(np.mean((force - gains.force_reference) ** 2))),
        "force_frequency": float(frequency), "normal_error": float(off.mean()),
    }  # fmt: skip
    notes = [f"{losses} losses of contact without a release by the hand"] if losses else []
    return answers, notes, checks


def at_the_handle(run: ToolRun, gains: SurfaceGains, turning: TurningGains, servo: ServoChain) -> PassivityBook:
    """Compute the energy balance at the handle, with energy stored in the apparent masses and in the contact.

    To first order, a servo delay of T increases the apparent mass by damping times T.
    """
    late = servo.lag + servo.delay + 1.5 * gains.cycle
    speeds, rates = np.sum(run.velocity**2, axis=1), np.sum(run.rate**2, axis=1)
    stored = run.spring + (gains.mass + gains.damping * late) * speeds / 2
    if turning.by_handle or turning.about_axis == "guide":
        stored = stored + (turning.inertia + turning.damping * late) * rates / 2
    steps = np.einsum("nij,nkj->nik", run.turn[1:], run.turn[:-1])
    turned = np.concatenate(
        [np.zeros((1, 3)), np.cumsum(scipy.spatial.transform.Rotation.from_matrix(steps).as_rotvec(), axis=0)]
    )
    return passivity_book(run.time, run.hand_force, run.position, stored, moment=run.hand_moment, turned=turned)


def misaligned(run: ToolRun, hole: SyntheticHole) -> np.ndarray:
    """Return the angle between the axes of peg and hole, (n,) [rad]."""
    return np.arccos(np.clip(run.turn[:, :, 2] @ hole.axis, -1.0, 1.0))


def peg_stiffness(hole: SyntheticHole) -> np.ndarray:
    """Return the stiffness (6, 6) against small motions of an aligned peg without clearance, at full depth."""
    tight = replace(hole, clearance=0.0, friction=0.0, tilt=0.0)
    tip = np.array([0.0, 0.0, -hole.depth])
    columns = []
    for n in range(6):
        wrenches = []
        for sign in (1.0, -1.0):
            x = sign * STEP * np.eye(6)[n]
            turn = rotation_by(x[3:])
            wrenches.append(np.concatenate(tight.wrench(tip + x[:3], turn, np.zeros(3), np.zeros(3), 0.0)))
        columns.append((wrenches[1] - wrenches[0]) / (2 * STEP))
    return np.column_stack(columns)


def aligned(
    run: ToolRun, hole: SyntheticHole, law: LeadThroughLaw, gains: SurfaceGains, setup: GuideSetup,
    tool: SyntheticSensor,
) -> Answers:  # fmt: skip
    """Evaluate the insertion of a peg: contact time, depth, tilt within its play, remaining torque, and the rotation
    about the axis, which the contact does not determine."""
    torque = np.linalg.norm(run.moment, axis=1)
    second = round(1.0 / gains.cycle)
    last = float(np.sqrt(np.mean(torque[-second:] ** 2)))
    off = misaligned(run, hole)
    turning, cycles = law.rotation.gains, int(np.count_nonzero(run.contact))
    along = tool.matrix.T @ np.array(law.rotation.axis)
    noise = np.hypot(tool.moment_noise, tool.force_noise * float(np.linalg.norm(np.cross(along, tool.point))))
    free = turning.about_axis == "free"
    expected = turning.torque_gain * float(noise) * gains.cycle * np.sqrt(cycles) if free else 0.0
    each = float(np.hypot(tool.moment_noise, tool.force_noise * float(np.linalg.norm(tool.point))))
    undetected = max(np.sqrt(3.0) * each, 1e-6)  # noise about the tip, all three axes together
    touched = gains.cycle * int(np.count_nonzero(np.any(run.force != 0.0, axis=1)))
    depth, goal = float(-hole.axis @ run.position[-1]), setup.goal * hole.depth
    pressed = float(np.sqrt(np.mean(np.sum(run.force[-second:] ** 2, axis=1))))
    play = 2 * (hole.clearance + pressed / hole.stiffness) / goal  # contact at two points, both compliant
    checks = {
        "contact_s": at_least(touched, gains.cycle, "the peg never touched: start above the hole, or push longer"),
        "depth_mm": at_least(
            1e3 * depth, 1e3 * goal, "the peg did not reach the depth: it jams, misses the hole, or needs more time"
        ),
        "misalignment_deg": at_most(
            float(np.rad2deg(off[-1])), float(np.rad2deg(play)),
            "the peg is not aligned with the hole: push longer, or raise the torque gain",
        ),
        "torque_left_Nm": at_most(last, undetected, "raise the torque gain, or push longer"),
    }  # fmt: skip
    answers = {
        "largest_torque": float(torque.max()), "last_torque": last, "misalignment": [float(off[0]), float(off[-1])],
        "depth": depth, "turned_about": float(run.about[-1]),
        "expected_about": float(expected), "peak_force": float(np.linalg.norm(run.force, axis=1).max()),
        "gain_share": float(run.share[-1]),
    }  # fmt: skip
    about = f"the peg rotated by {np.rad2deg(run.about[-1]):.3g} deg about its axis"
    if free:
        about += f", a random walk from the sensor's noise ({np.rad2deg(expected):.2g} deg expected): lock or hold it"
    return answers, [about], checks
