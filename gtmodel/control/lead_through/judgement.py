"""What a run of lead-through says: the force held, how a peg was aligned, and the energy that an operator puts into
a robot."""

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
    """energy (n,): what the operator put in up to each instant [J]. stored (n,): what the felt mass holds [J].

    worst: least energy that went in over any window [J], negative where the operator got some; window: its beginning
    and end [s]. deficit: most that the operator got over any window beyond what was stored at its beginning [J]; 0 or
    close to it for a robot that is passive. passed: all that went in or out [J].
    """

    energy: np.ndarray
    stored: np.ndarray
    worst: float
    window: tuple[float, float]
    deficit: float
    passed: float

    @property
    def share(self) -> float:
        """deficit over the most that was ever stored: not less for guiding that goes on for longer."""
        if self.deficit == 0.0:
            return 0.0
        most = float(self.stored.max())
        return self.deficit / most if most > 0 else float("inf")

    def __str__(self) -> str:
        return (
            f"{self.passed:.3g} J passed the handle; the least over any window is {self.worst:.3g} J, "
            f"{self.window[0]:.3g} to {self.window[1]:.3g} s; beyond what was stored {self.deficit:.3g} J"
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
    """Energy at the operator's port over all windows at once.

    Args:
        time: (n,) [s]. force: (n, 3) [N] of the hand on the tool. moved: (n, 3) [m] positions of the tool.
        stored: (n,) [J] at least 0, what the robot may give back.
        moment: (n, 3) [N m] of the hand about that point; turned: (n, 3) [rad] how far it turned up to then.

    Between two rows the work is that of the mean force. Raises ArgumentError for other shapes and what is not finite.

    >>> t = np.linspace(0.0, 1.0, 101)  # a mass of 2 kg is pushed and stopped
    >>> force = np.outer(4.0 * np.cos(np.pi * t), [1.0, 0.0, 0.0])
    >>> moved = np.outer(2.0 / np.pi**2 * (1.0 - np.cos(np.pi * t)), [1.0, 0.0, 0.0])
    >>> speed = 2.0 / np.pi * np.sin(np.pi * t)
    >>> book = gt.control.lead_through.passivity_book(t, force, moved, 0.5 * 2.0 * speed**2)
    >>> round(book.worst, 2), round(book.deficit, 3)  # what it got back was stored
    (-0.41, 0.0)
    """
    f, x = rows_of(force, "force"), rows_of(moved, "moved")
    t, s = (np.asarray(a, float).reshape(-1) for a in (time, stored))
    for name, a in (("time", t), ("moved", x), ("stored", s)):
        if len(a) != len(f) or not np.all(np.isfinite(a)):
            raise ArgumentError(f"expected {len(f)} finite rows, as in force; found {len(a)}", name)
    if np.any(s < 0):
        raise ArgumentError("is below 0; energy that is stored is not", "stored")
    if (moment is None) != (turned is None):
        raise ArgumentError("moment and turned are given together", "turned")
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


TOO_MUCH = 1e-2  # of the most that was stored, which is known to first order in the servo's times
STEP = 1e-6  # [m], [rad] of differences
ALIKE = 0.9  # of the force with which the hand releases contact: its sensor is noisy
Answers = tuple[dict[str, Any], list[str], dict[str, Check]]


def along_normal(run: ToolRun, surface: SyntheticSurface) -> np.ndarray:
    """(n,) [N], the force on the tool along the surface's true normal."""
    return np.array([surface.normal_at(x) @ f for x, f in zip(run.position, run.force, strict=True)])


def forces(
    run: ToolRun, surface: SyntheticSurface, law: LeadThroughLaw, gains: SurfaceGains, setup: GuideSetup,
    tool: SyntheticSensor,
) -> Answers:  # fmt: skip
    """The force along the normal once contact has settled, and contact that was lost."""
    pressed, contact = along_normal(run, surface), run.contact
    ended = np.flatnonzero(contact[:-1] & ~contact[1:]) + 1
    asked = run.hand_force[ended] @ np.array(law.translation.normal) >= ALIKE * gains.release_force
    losses = int(np.count_nonzero(~asked))
    checks = {"contact_losses": at_most(losses, 0, "press less on taking contact, or lower the gain")}
    answers: dict[str, Any] = {
        "contact_losses": losses, "peak_force": float(pressed.max()), "gain_share": float(run.share[-1])
    }  # fmt: skip
    began = np.flatnonzero(contact)
    late = contact & (run.time >= (run.time[began[0]] if len(began) else np.inf) + setup.settled)
    if np.count_nonzero(late) < 2:
        checks["settled_contact_s"] = Check(0.0, gains.cycle, "take contact, and stay longer", least=True)
        return answers, ["the tool was not in contact long enough for its force to be judged"], checks
    held = pressed[late]
    normals = np.array([surface.normal_at(x) for x in run.position[late]])
    off = np.arccos(np.clip(np.einsum("ni,ni->n", normals, run.normal[late]), -1.0, 1.0))
    spectrum = np.abs(np.fft.rfft(np.hanning(len(held)) * (held - held.mean())))
    frequency = np.fft.rfftfreq(len(held), gains.cycle)[int(np.argmax(spectrum))]
    error = float(held.mean()) - gains.force_reference
    checks["mean_force_error_N"] = at_most(
        abs(error), setup.tolerance, "go slower, filter the normal longer, or raise the gain within its limit"
    )
    answers |= {
        "mean_force": float(held.mean()), "least_force": float(held.min()),
        "force_deviation": float(np.sqrt(np.mean((held - gains.force_reference) ** 2))),
        "force_frequency": float(frequency), "normal_error": float(off.mean()),
    }  # fmt: skip
    notes = [f"{losses} losses of contact that the hand did not ask for"] if losses else []
    return answers, notes, checks


def at_the_handle(run: ToolRun, gains: SurfaceGains, turning: TurningGains, servo: ServoChain) -> PassivityBook:
    """The energy that the hand puts in; what the robot may give back is that of the felt masses and of the contact.

    A robot that follows its command late by T feels heavier by damping times T, to first order.
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
    """(n,) [rad], between the axes of peg and hole."""
    return np.arccos(np.clip(run.turn[:, :, 2] @ hole.axis, -1.0, 1.0))


def peg_stiffness(hole: SyntheticHole) -> np.ndarray:
    """(6, 6), wrench that pushes back for small motions of a peg that fits without play, aligned, at full depth."""
    tight = replace(hole, clearance=0.0, friction=0.0, tilt=0.0)
    at = np.array([0.0, 0.0, -hole.depth])
    columns = []
    for n in range(6):
        both = []
        for sign in (1.0, -1.0):
            x = sign * STEP * np.eye(6)[n]
            turn = rotation_by(x[3:])
            both.append(np.concatenate(tight.wrench(at + x[:3], turn, np.zeros(3), np.zeros(3), 0.0)))
        columns.append((both[1] - both[0]) / (2 * STEP))
    return np.column_stack(columns)


def aligned(
    run: ToolRun, hole: SyntheticHole, law: LeadThroughLaw, gains: SurfaceGains, setup: GuideSetup,
    tool: SyntheticSensor,
) -> Answers:  # fmt: skip
    """Whether a peg touched its hole and arrived: its depth, and a tilt within the play that it has there; how far the
    torque went down, and the turn about the axis that the contact does not determine."""
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
    unseen = max(np.sqrt(3.0) * each, 1e-6)  # of the noise about the tip, all three axes together
    touched = gains.cycle * int(np.count_nonzero(np.any(run.force != 0.0, axis=1)))
    depth, goal = float(-hole.axis @ run.position[-1]), setup.goal * hole.depth
    pressed = float(np.sqrt(np.mean(np.sum(run.force[-second:] ** 2, axis=1))))
    play = 2 * (hole.clearance + pressed / hole.stiffness) / goal  # at two points, where the contacts are compliant
    checks = {
        "contact_s": at_least(touched, gains.cycle, "the peg never touched: begin above the hole, or push longer"),
        "depth_mm": at_least(
            1e3 * depth, 1e3 * goal, "the peg did not arrive: it jams, misses the hole, or was pushed too short a time"
        ),
        "misalignment_deg": at_most(
            float(np.rad2deg(off[-1])), float(np.rad2deg(play)), "the peg is not turned into the hole: push longer, or "
            "raise the gain of the torque",
        ),
        "torque_left_Nm": at_most(last, unseen, "raise the gain of the torque, or push longer"),
    }  # fmt: skip
    answers = {
        "largest_torque": float(torque.max()), "last_torque": last, "misalignment": [float(off[0]), float(off[-1])],
        "depth": depth, "turned_about": float(run.about[-1]),
        "expected_about": float(expected), "peak_force": float(np.linalg.norm(run.force, axis=1).max()),
        "gain_share": float(run.share[-1]),
    }  # fmt: skip
    about = f"the peg turned by {np.rad2deg(run.about[-1]):.3g} deg about its axis"
    if free:
        about += f", a random walk by the sensor's noise ({np.rad2deg(expected):.2g} deg expected): lock or hold it"
    return answers, [about], checks
