"""Robust fits of the board's pictures, until it is settled which corners and pictures are wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...geometry.pinhole import project
from ...geometry.rotations import composed, inverse_poses, matrices_of
from ..corner_table import CornerTable
from ..gross_errors import SETTLED, SPREAD, GrossErrors, gross_errors
from ..starts import board_pose
from .calibrated import LEAST, CameraStarts, calibrated, started_at
from .options import CameraFit

ROUNDS = 8
# iterations of a first fit of all corners alike, by a noise [pixel] that no error reaches
ROUGH, PLAIN = 6, 1e3
AWAY = 5.0  # times what starting values leave of most pictures, which is the distortion of the lens
LEFT = 3  # pictures; fewer determine no lens


def uneven(table: CornerTable, residuals: np.ndarray) -> bool:
    """Whether a picture has so much larger residuals than most that a robust fit must say which are wrong."""
    length = np.linalg.norm(residuals, axis=1)
    size = [float(np.median(length[table.picture == p])) for p in np.unique(table.picture)]
    return max(size) > SPREAD * float(np.median(size))


def suspects(table: CornerTable, start: CameraStarts) -> list[int]:
    """Pictures that the starting values predict so much worse than most that no fit may begin with them: those of two
    cameras that were exchanged, mirrored, or of another moment."""
    worst = np.array([_off(table, p, start, start.boards[p]) for p in range(len(table.pictures))])
    return np.flatnonzero(worst > AWAY * np.median(worst)).tolist()


def _off(table: CornerTable, picture: int, start: CameraStarts, board: np.ndarray) -> float:
    """Median distance [pixel] of corners from where a board's pose (7,) puts them, of the worst camera."""
    worst = 0.0
    for c in np.unique(table.camera[table.picture == picture]):
        own = (table.camera == c) & (table.picture == picture)
        seen = composed(start.cameras[c][None], board[None])
        uv, status = project(table.X[own] @ matrices_of(seen)[0].T + seen[0, 4:], start.lenses[c])
        off = np.linalg.norm(uv - table.uv[own], axis=1)
        worst = max(worst, float(np.median(np.where((status == 0) & np.isfinite(off), off, np.inf))))
    return worst


def without_gross_errors(
    table: CornerTable, start: CameraStarts, fit: CameraFit, stop: Callable[[], bool] | None
) -> tuple[CameraStarts, GrossErrors]:
    """Robust fits until the noise settles: where they end, and what is left out after them. Pictures that starting
    values speak against are judged when the others have placed the cameras."""
    away = suspects(table, start)
    rest = [p for p in range(len(table.pictures)) if p not in away]
    if not away or len(rest) < LEFT:
        return _settled(table, start, fit, stop)
    known, bad = _settled(_pictures(table, rest), replace(start, boards=start.boards[rest]), fit, stop)
    boards = start.boards.copy()
    boards[rest] = known.boards
    sigma = 1.0 if table.sigma is None else float(np.median(table.sigma))
    wrong = []
    for p in away:
        placed = []
        for c in np.unique(table.camera[table.picture == p]):
            own = (table.camera == c) & (table.picture == p)
            if own.sum() >= LEAST:
                seen = board_pose(table.X[own], table.uv[own], known.lenses[c])
                placed.append(composed(inverse_poses(known.cameras[c][None]), seen[None])[0])
        boards[p] = min(placed, key=lambda board: _off(table, p, known, board), default=boards[p])
        if _off(table, p, known, boards[p]) > SPREAD * fit.gross * bad.noise * sigma:
            wrong.append(p)
    right = [p for p in range(len(table.pictures)) if p not in wrong]
    if right != rest:
        known, bad = _settled(_pictures(table, right), replace(known, boards=boards[right]), fit, stop)
    boards[right] = known.boards
    corners = np.isin(table.picture, wrong)
    corners[~corners] = bad.corners
    pictures = sorted([*wrong, *(right[p] for p in bad.pictures)])
    return replace(known, boards=boards), replace(bad, corners=corners, pictures=tuple(pictures))


def _pictures(table: CornerTable, which: list[int]) -> CornerTable:
    gone = [name for p, name in enumerate(table.pictures) if p not in which]
    return table.rows(np.flatnonzero(np.isin(table.picture, which))).without(gone)


def _settled(
    table: CornerTable, start: CameraStarts, fit: CameraFit, stop: Callable[[], bool] | None
) -> tuple[CameraStarts, GrossErrors]:
    plain = calibrated(table, start, replace(fit, limit=ROUGH), loss_sigma=PLAIN, stop=stop)
    noise = 0.0
    for _ in range(ROUNDS):
        start = started_at(plain)
        bad = gross_errors(table, plain.residuals["corners"], fit.gross)
        if abs(bad.noise - noise) <= SETTLED * bad.noise:
            break
        noise = max(bad.noise, 1e-9)
        plain = calibrated(table, start, fit, loss_sigma=noise, stop=stop)
    return started_at(plain), gross_errors(table, plain.residuals["corners"], fit.gross)
