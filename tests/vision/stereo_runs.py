"""Drawn calibrations of two cameras, clean and with one fault each: synthetic, 12 pictures, 0.15 pixel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import gtmodel as gt
from gtmodel.vision import BoardPictures, CameraFit, StereoStudy
from gtmodel.vision.corner_table import CornerTable
from gtmodel.vision.stereo import SyntheticBoards, made_corners

BOARD = BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6)
PICTURES, NOISE = 12, 0.15
SEED = 41_000  # set k of a kind of run is drawn from seed SEED + k
DEVIATIONS = 6.0  # of the outlier
SHIFT = 20.0  # pixel
FAULTS = ("outlier", "exchanged", "shifted", "mirrored", "reversed")


def corners(k: int, noise: float = NOISE) -> CornerTable:
    return made_corners(SyntheticBoards(pictures=PICTURES, noise_pixel=noise, seed=SEED + k), BOARD)[0]


def blurred(k: int) -> CornerTable:
    """Clean, but pictures have noise of their own: from a half to twice the usual one, as tilt and distance make it."""
    exact, rng = corners(k, 0.0), np.random.default_rng([SEED + k, 1])
    own = NOISE * 2.0 ** rng.uniform(-1, 1, (2, PICTURES))
    return replace(exact, uv=exact.uv + own[exact.camera, exact.picture, None] * rng.standard_normal(exact.uv.shape))


def spoilt(k: int, fault: str) -> tuple[CornerTable, str]:
    """A set with one fault, and the corner or picture that is wrong."""
    table, rng = corners(k), np.random.default_rng([SEED + k, 2])
    uv, p, c = table.uv.copy(), int(rng.integers(PICTURES)), int(rng.integers(2))
    own = (table.camera == c) & (table.picture == p)
    if fault == "outlier":  # so many deviations from the truth, in any direction
        exact, at, turn = corners(k, 0.0).uv, int(rng.integers(table.n)), rng.uniform(0, 2 * np.pi)
        uv[at] = exact[at] + DEVIATIONS * NOISE * np.array([np.cos(turn), np.sin(turn)])
        return replace(table, uv=uv), table.label(at)
    if fault == "exchanged":  # left and right
        other = (table.camera == 1 - c) & (table.picture == p)
        uv[own], uv[other] = table.uv[other], table.uv[own]
    if fault == "shifted":
        uv[own] += SHIFT * rng.choice([-1.0, 1.0], 2)
    if fault == "mirrored":
        uv[own, 0] = BOARD.width_pixel - 1 - uv[own, 0]
    if fault == "reversed":
        uv[own] = uv[own][::-1]
    inside = np.clip(uv, -0.5, [BOARD.width_pixel - 0.5, BOARD.height_pixel - 0.5])
    return replace(table, uv=inside), table.pictures[p]


def study(table: CornerTable, gross_errors: str = "named") -> StereoStudy:
    return gt.vision.stereo_study(table, BOARD, CameraFit(gross_errors=gross_errors))


def alarmed(s: StereoStudy) -> bool:
    """Whether a run says anything of its data: a status, a failed check, a picture, a corner or a map."""
    said = any("depend on the place in the picture" in n for n in s.notes)
    return not s.status.ok or said or bool(s.gross_corners or s.wrong_pictures)


def found(k: int, fault: str) -> bool:
    """Whether the wrong corner or picture is named, and no other corner or picture."""
    table, wrong = spoilt(k, fault)
    try:
        s = study(table)
    except gt.results.ArgumentError as error:  # before the fit
        return f"picture {wrong}:" in error.message
    if fault == "outlier":
        return list(s.gross_corners) == [wrong]
    return not s.status.ok and list(s.wrong_pictures) == [wrong]
