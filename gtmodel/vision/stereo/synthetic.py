"""Synthetic corners of a board in front of two cameras."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...geometry.pinhole import project
from ...geometry.rotations import composed, matrices_of, poses_of, rotation_by
from ...results.options import Options, Within
from ..corner_table import Board, CornerTable
from .options import BoardPictures

LEFT = (540.0, 541.0, 325.0, 236.0, -0.28, 0.08, 1e-3, -5e-4, 0.0)
RIGHT = (536.0, 535.0, 318.0, 243.0, -0.29, 0.1, -5e-4, 2e-4, 0.0)


@dataclass(frozen=True)
class SyntheticBoards(Options):
    """Random board poses in front of two cameras like those of OpenCV's samples.

    >>> gt.vision.stereo.SyntheticBoards(pictures=20, seed=3).noise_pixel
    0.15
    """

    pictures: Annotated[int, Within(least=1), "of the board"] = 13
    noise_pixel: Annotated[float, Within(least=0.0), "standard deviation of a coordinate of a corner"] = 0.15
    tilt_deg: Annotated[float, Within(least=0.0), "largest rotation of the board about each axis"] = 35.0
    seed: Annotated[int, Within(least=0), "of poses and noise"] = 0


def made_corners(wanted: SyntheticBoards, board: BoardPictures) -> tuple[CornerTable, np.ndarray, np.ndarray]:
    """Make corners of synthetic pictures in which both cameras see the whole board.

    Also return the true lenses (2, 9) and camera poses (2, 7), in metres if `board.square` is set, else in squares.

    >>> board = gt.vision.BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6)
    >>> table, lenses, cameras = gt.vision.stereo.made_corners(gt.vision.stereo.SyntheticBoards(pictures=3), board)
    >>> table.n, table.source
    (324, 'synthetic, seed 0, noise 0.15 pixel')
    """
    rng = np.random.default_rng(wanted.seed)
    lenses = np.array([LEFT, RIGHT])
    size = board.square or 1.0
    cameras = np.vstack(
        [np.eye(1, 7), poses_of(rotation_by([[0.007, 0.004, -0.003]]), np.array([[-3.3, 0.04, 0.0]]) * size)]
    )
    X = Board(board.columns, board.rows, None, board.identified).points
    middle = X.mean(axis=0) * size
    uv: list[np.ndarray] = []
    while len(uv) < wanted.pictures:
        turn = np.deg2rad(wanted.tilt_deg) * rng.uniform(-1, 1, 3)
        place = size * np.array([rng.uniform(-3, 6), rng.uniform(-3, 3), rng.uniform(11, 18)])
        R = rotation_by([turn])
        pose = poses_of(R, (place - R[0] @ middle)[None])
        both = []
        for c in range(2):
            view = composed(cameras[c][None], pose)
            pixel, status = project(size * X @ matrices_of(view)[0].T + view[0, 4:], lenses[c])
            inside = np.all((pixel > 2) & (pixel < [board.width_pixel - 3, board.height_pixel - 3]))
            both.append(pixel if inside and not status.any() else None)
        if both[0] is not None and both[1] is not None:
            uv.append(np.stack([both[0], both[1]]))
    exact = np.stack(uv)  # (pictures, cameras, corners, 2)
    k, c, m = (a.reshape(-1) for a in np.meshgrid(*(np.arange(n) for n in exact.shape[:3]), indexing="ij"))
    uv_noisy = exact.reshape(-1, 2) + wanted.noise_pixel * rng.standard_normal((len(k), 2))
    table = CornerTable(
        ("left", "right"), tuple(f"{n + 1:02d}" for n in range(len(exact))), c, k, X[m], uv_noisy,
        tuple(str(x) for x in m), source=f"synthetic, seed {wanted.seed}, noise {wanted.noise_pixel:g} pixel",
    )  # fmt: skip
    return table, lenses, cameras
