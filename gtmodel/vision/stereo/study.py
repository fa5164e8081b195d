"""The study of a camera calibration: from corners to lenses, camera poses, their accuracy, and checks."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, Unpack

import numpy as np

from ... import view
from ...geometry.pinhole import LENS
from ...geometry.rotations import composed, matrices_of
from ...inference.bundle import BundleFit
from ...measurements.inspection.data_tests import Data, tested
from ...results import ArgumentError, Check, SolveStatus, Work, at_least, at_most
from ...results.refusal import naming
from ...results.suspicion import FIRST, suspicion_checks
from ...results.table import csv_text
from ...results.work import WorkOptions, study_function
from ...view.bodies import COLOURS
from ..corner_table import Board, CornerTable
from ..residuals import LEAST, GrossErrors, PictureTest, gross_errors, picture_test
from ..views import MOVES, intersect
from .calibration import calibrated, camera_starts, suspects, uneven, without_gross_errors
from .options import BoardPictures, CameraFit, StereoStart, StereoStudy

FEW = 3  # pictures
FOCAL = 0.05  # largest relative standard deviation of a focal length
REMOVED = 0.2  # largest share of corners that may count as outliers
NAMED = 10  # corners that a note lists
OFF = 0.2  # largest distance of the principal point from the middle, in sides of an uncropped picture

TILTED = 10.0  # degrees: with less tilt, focal length and distance can hardly be separated
TILT = (
    "tilt the board by 20 degrees or more in some pictures; if it always faces the camera, focal length and distance "
    "cannot be separated"
)


@study_function
def stereo_study(
    corners: CornerTable,
    board: BoardPictures,
    fit: CameraFit | None = None,
    start: StereoStart | None = None,
    **work_options: Unpack[WorkOptions],
) -> StereoStudy:
    """Calibrate one or more cameras from pictures of a board: lenses, and poses relative to the first camera.

    All corners are fitted together. The result has standard deviations, names gross errors, and tests whether the
    residuals depend on the place in the picture.

    Args:
        corners: of the board in all pictures, X and Y counted in squares from its first corner.
        board: size of the board and of the pictures.
        fit: fitted parameters, and treatment of gross errors; start: starting values.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError if the board looks the same when turned, if two cameras count its corners from opposite ends,
    if corners are outside the board or repeated, if no picture shows the last column or row of the board, if metres are
    requested without a known length, and if the pictures do not determine the fitted parameters.

    >>> from gtmodel.vision.stereo.synthetic import SyntheticBoards, made_corners
    >>> board = gt.vision.BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6, square=0.03)
    >>> s = gt.vision.stereo_study(made_corners(SyntheticBoards(pictures=8), board)[0], board)
    >>> low, high = s.interval("left.fx")
    >>> s.status.ok, low < 540.0 < high
    (True, True)
    """
    work = Work(**work_options)
    fit, start = fit or CameraFit(), start or StereoStart()
    metres = _metres(board)
    _on_the_board(corners, board)
    table = replace(corners, X=corners.X * (board.square or 1.0))
    work.step("starting values", 0.1)
    begin = camera_starts(table, board, start)
    removed: GrossErrors | None = None
    rows = np.arange(table.n)
    tilt = np.degrees(_tilt(begin.cameras, begin.boards))
    if fit.gross_errors == "removed" or (tilt >= TILTED and suspects(table, begin)):
        work.step("gross errors", 0.3)
        again, removed = without_gross_errors(table, begin, fit, work.interrupted)
        if fit.gross_errors == "named":
            if removed.pictures and not work.interrupted():
                return _wrong(corners, removed, work.title)
            removed = None
        else:
            begin = again
    if removed is not None:
        rows = np.flatnonzero(~removed.corners)
        table, begin = _remaining(table, rows, begin)
    work.step("fit", 0.6)
    with naming("corners", after=f"; {TILT}"):
        end = calibrated(table, begin, fit, stop=work.interrupted)
    if not end.status.ok or end.estimate is None:
        if removed is None and end.status is not SolveStatus.INTERRUPTED:
            work.step("gross errors", 0.8)
            removed = without_gross_errors(table, begin, fit, work.interrupted)[1]
        return _failed(end, corners, tilt, removed, work.title)
    named = removed or gross_errors(table, end.residuals["corners"], fit.gross)
    if removed is None and uneven(table, end.residuals["corners"]):  # a wrong picture distorts the fit
        named = without_gross_errors(table, begin, fit, work.interrupted)[1]
    tests = _tests(table, end, board)
    checks, notes = _judged(corners, table, end, named, removed is not None, tests)
    notes += _doubts(table, end, board)
    values = _values(table, end, metres)
    drawn = [(name, table.uv[table.camera == c], end.residuals["corners"][table.camera == c], tests.get(name))
             for c, name in enumerate(table.cameras)]  # fmt: skip
    return StereoStudy(
        status=end.status, message=end.message, title=work.title, iterations=end.iterations, objective=end.cost,
        estimate=end.estimate, checks=checks, notes=notes, **values,
        removed=removed is not None, **_named(corners, named),
        quadratic_p={n: t.quadratic for n, t in tests.items()}, radius_p={n: t.radius for n, t in tests.items()},
        map_rms={n: t.size for n, t in tests.items()},
        figures={"residuals": partial(_figure, drawn, (board.width_pixel, board.height_pixel), work.title)},
        scenes={"cameras": partial(_in_space, table, end, board, work.title)} if metres else {},
        files={"cameras.csv": _cameras_file(values, metres), "residuals.csv": _residuals_file(corners, rows, end)},
        machine_files=("cameras.csv",),
    )  # fmt: skip


def _in_space(table: CornerTable, end: BundleFit, board: BoardPictures, title: str) -> view.RobotScene:
    """Cameras with their whole pictures, and the boards by the cameras that see them; upwards is upwards in the
    pictures of the first camera."""
    w, h = board.width_pixel - 1.0, board.height_pixel - 1.0
    low, high = table.X.min(axis=0), table.X.max(axis=0)
    flat = np.array([[low[0], low[1], 0.0], [high[0], low[1], 0.0], [high[0], high[1], 0.0], [low[0], high[1], 0.0]])
    boards = end.values["board"]
    rectangles = [flat @ R.T + t for R, t in zip(matrices_of(boards), boards[:, 4:], strict=True)]
    middles = np.array([r.mean(axis=0) for r in rectangles])
    sees = [set(table.picture[table.camera == c].tolist()) for c in range(len(table.cameras))]
    labels = [
        " and ".join(n for n, own in zip(table.cameras, sees, strict=True) if p in own) for p in range(len(middles))
    ]
    bodies = view.groups(middles, [f"board seen by {label}" for label in labels])
    bodies += [view.VisibleBody(r, [[0, 1, 2], [0, 2, 3]], (), "", f"picture {name}", opacity=0.25)
               for r, name in zip(rectangles, table.pictures, strict=True)]  # fmt: skip
    for c, name in enumerate(table.cameras):
        fx, fy, cx, cy = end.values["lens"][c, :4]
        rays = [((u - cx) / fx, (v - cy) / fy, 1.0) for u, v in ((0, 0), (w, 0), (w, h), (0, h))]
        R, t = matrices_of(end.values["camera"])[c], end.values["camera"][c, 4:]
        centre = -R.T @ t  # the pose maps the frame of the first camera to this one's
        depth = float(np.median((middles - centre) @ R[2]))
        colour = COLOURS[c % len(COLOURS)]
        bodies += [view.frustum(rays, R.T, centre, depth, name=f"camera {name}", colour=colour),
                   view.dots(centre[None], marker="square", name=f"camera {name}", colour=colour)]  # fmt: skip
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    note = "Pyramids: the pictures of the cameras, without distortion."
    return view.around(None, [body.moved(upright, np.zeros(3)) for body in bodies], title=title or "cameras", note=note)


def explained_pictures(corners: CornerTable, board: BoardPictures) -> list[str]:
    """Return lines with the number of corners of each camera and the unit of lengths of the result.

    Raises ArgumentError like the study.

    >>> board = gt.vision.BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6)
    >>> table, lenses, cameras = gt.vision.stereo.made_corners(gt.vision.stereo.SyntheticBoards(), board)
    >>> print(*gt.vision.stereo.explained_pictures(table, board)[:2], sep="; ")
    13 pictures of a board of 9 x 6 corners;   left: 702 corners in 13 pictures
    """
    metres = _metres(board)
    _on_the_board(corners, board)
    lines = [f"{len(corners.pictures)} pictures of a board of {board.columns} x {board.rows} corners"]
    for c, name in enumerate(corners.cameras):
        rows = corners.camera == c
        lines.append(f"  {name}: {rows.sum()} corners in {len(np.unique(corners.picture[rows]))} pictures")
    lines.append("lengths in metres" if metres else "lengths in squares of the board; for metres set board.square_mm")
    return lines


def _metres(board: BoardPictures) -> bool:
    Board(board.columns, board.rows, board.square, board.identified)
    if board.lengths == "metres" and board.square is None:
        raise ArgumentError(
            "pixels do not determine the scale of lengths, and a wrong scale would not show in the residuals; set the "
            "side of a square, or use lengths in squares",
            "board.square",
        )
    return board.square is not None and board.lengths != "squares"


def _on_the_board(corners: CornerTable, board: BoardPictures) -> None:
    X = corners.X
    off_board = np.any((X != np.round(X)) | (X < 0) | (X > [board.columns - 1, board.rows - 1, 0]), axis=1)
    if off_board.any():
        k = int(np.argmax(off_board))
        raise ArgumentError(
            f"{corners.label(k)} is at X, Y, Z = {X[k, 0]:g}, {X[k, 1]:g}, {X[k, 2]:g}; expected whole squares "
            f"within {board.columns} x {board.rows} corners",
            "corners",
        )
    wide = np.array([board.width_pixel, board.height_pixel])
    outside = np.any((corners.uv < -0.5) | (corners.uv > wide - 0.5), axis=1)
    if outside.any():
        k = int(np.argmax(outside))
        u, v = corners.uv[k]
        raise ArgumentError(
            f"{corners.label(k)} is at {u:g}, {v:g}, outside a picture of {wide[0]} x {wide[1]}", "corners"
        )
    key = np.column_stack([corners.camera, corners.picture, X])
    _, first, back = np.unique(key, axis=0, return_index=True, return_inverse=True)
    again = np.flatnonzero(first[back.reshape(-1)] != np.arange(corners.n))
    if len(again):
        raise ArgumentError(
            f"{corners.label(int(again[0]))} occurs more than once and would count as several measurements; remove the "
            "other rows",
            "corners",
        )
    if corners.n and not board.identified:
        for axis, (name, many) in enumerate((("columns", board.columns), ("rows", board.rows))):
            if X[:, axis].max() < many - 1:
                raise ArgumentError(
                    f"no picture shows more than {int(X[:, axis].max()) + 1} {name} of corners, but board.{name} is "
                    f"{many}; correct board.{name}, or set board.identified if the corners carry codes",
                    "board",
                )
    if len(corners.pictures) < FEW:
        raise ArgumentError(
            f"found {len(corners.pictures)} pictures of the board; a calibration needs at least {FEW}", "corners"
        )


def _remaining(table: CornerTable, rows: np.ndarray, begin: Any) -> tuple[CornerTable, Any]:
    """Return the corners of these rows, and starting values without wrong pictures."""
    good = [p for p in range(len(table.pictures)) if np.any(table.picture[rows] == p)]
    if len(good) < FEW:
        raise ArgumentError(
            f"only {len(good)} of {len(table.pictures)} pictures are without gross errors; expected at least {FEW}",
            "corners",
        )
    wrong = [name for p, name in enumerate(table.pictures) if p not in good]
    return table.rows(rows).without(wrong), replace(begin, boards=begin.boards[good])


def _failed(end: BundleFit, corners: CornerTable, tilt: float, bad: GrossErrors | None, title: str) -> StereoStudy:
    """Return the study of a failed fit, with the wrong pictures and corners of a robust fit. They are not named if the
    board never tilts: the fit is then undetermined, and they would be arbitrary."""
    if tilt < TILTED:
        message = f"{end.message}; the board is never tilted by more than {tilt:.2g} degrees: {TILT}"
        return StereoStudy(status=end.status, message=message, title=title, iterations=end.iterations)
    if bad is not None and bad.pictures:
        return replace(_wrong(corners, bad, title), iterations=end.iterations)
    named = {} if bad is None else _named(corners, bad)
    message = f"{end.message}; set start.focal_pixel, look for wrong pictures, or {TILT}"
    return StereoStudy(status=end.status, message=message, title=title, iterations=end.iterations, **named)


def _wrong(corners: CornerTable, bad: GrossErrors, title: str) -> StereoStudy:
    """Return the study of a fit that fails because of wrong pictures."""
    named = _named(corners, bad)
    message = (
        f"wrong as a whole: picture {', '.join(named['wrong_pictures'])} (exchanged, mirrored, shifted, or counted in "
        'another order); inspect it, remove it, or set gross_errors = "removed"'
    )
    return StereoStudy(status=SolveStatus.FAILED, message=message, title=title, **named)


def _named(corners: CornerTable, bad: GrossErrors) -> dict[str, Any]:
    return {
        "gross_corners": [corners.label(int(k)) for k in np.flatnonzero(bad.corners)],
        "wrong_pictures": [corners.pictures[p] for p in bad.pictures],
    }


def _tests(table: CornerTable, end: BundleFit, board: BoardPictures) -> dict[str, PictureTest]:
    tests = {}
    for c, name in enumerate(table.cameras):
        rows = table.camera == c
        if rows.sum() >= LEAST:
            size = (board.width_pixel, board.height_pixel)
            tests[name] = picture_test(table.uv[rows], end.residuals["corners"][rows], size)
    return tests


def _judged(corners: CornerTable, table: CornerTable, end: BundleFit, bad: GrossErrors, removed: bool,
            tests: dict[str, PictureTest]) -> tuple[dict[str, Check], list[str]]:  # fmt: skip
    assert end.estimate is not None
    names = end.estimate.names
    worst = max(
        end.estimate.std[names.index(f"{c}.fx")] / end.values["lens"][k, 0] for k, c in enumerate(table.cameras)
    )
    checks = {"focal_length_relative_std": at_most(float(worst), FOCAL, TILT)}
    wrong = ", ".join(corners.pictures[p] for p in bad.pictures)
    single = [corners.label(int(k)) for k in np.flatnonzero(bad.corners) if corners.picture[k] not in bad.pictures]
    more = f" and {len(single) - NAMED} more" if len(single) > NAMED else ""
    notes = ["poses and their standard deviations are relative to the first camera, which is held fixed"]
    if len(table.cameras) == 1:
        notes = []
    treatment = "left out" if removed else "in the fit"
    if wrong:
        notes.append(f"wrong as a whole, {treatment}: picture {wrong}")
    if single:
        notes.append(f"gross errors, {treatment}: {', '.join(single[:NAMED])}{more}")
    if removed:
        checks["corners_left_share"] = at_least(float(1 - bad.corners.mean()), 1 - REMOVED, "check the corner detector")
    else:
        advice = 'inspect them, remove them, or set gross_errors = "removed"'
        checks["wrong_pictures"] = at_most(len(bad.pictures), 0, advice)
        checks["gross_errors"] = at_most(len(single), 0, advice)
    data = Data({"uv": table.uv}, row="corner", residuals=end.residuals["corners"])
    more_checks, doubts = suspicion_checks(tested(data))
    checks, notes = checks | more_checks, [*notes, *doubts]
    for name, test in tests.items():
        if test.fires(FIRST / len(tests)):
            notes.append(
                f"residuals of {name} depend on the place in the picture: quadratic map of {test.size:.2g} pixel rms "
                f"(p = {test.quadratic:.1g}; along the radius p = {test.radius:.1g}). The lens model is too simple, "
                "the board is not flat, or errors within a picture are correlated; standard deviations do not include "
                "this"
            )
    return checks, notes


def _doubts(table: CornerTable, end: BundleFit, board: BoardPictures) -> list[str]:
    """Return notes on possible mistakes in the input that do not show in the residuals."""
    notes = []
    size = np.array([board.width_pixel, board.height_pixel])
    for name, lens in zip(table.cameras, end.values["lens"], strict=True):
        if np.any(np.abs(lens[2:4] - (size - 1) / 2) > OFF * size):
            notes.append(
                f"the principal point of {name}, {lens[2]:.0f}, {lens[3]:.0f}, is far from the middle of a picture of "
                f"{size[0]} x {size[1]}; check width_pixel and height_pixel, and whether the picture is cropped"
            )
    poses = end.values["board"]  # in the frame of the first camera
    behind = np.einsum("ni,ni->n", matrices_of(poses)[:, :, 2], poses[:, 4:]) < 0
    if behind.any():
        which = "all pictures" if behind.all() else f"picture {', '.join(np.array(table.pictures)[behind][:NAMED])}"
        notes.append(
            f"the board appears from behind in {which}. A reversed order of corners is harmless, but mirrored pictures "
            "(u and v exchanged, or v upwards) give mirrored lenses and poses"
        )
    return notes


def _values(table: CornerTable, end: BundleFit, metres: bool) -> dict[str, Any]:
    assert end.estimate is not None
    e, std = end.estimate, end.estimate.std
    place = {n: k for k, n in enumerate(e.names)}
    r = end.residuals["corners"]
    square = np.sum(r**2, axis=1)

    def rms(rows: np.ndarray) -> float:
        return float(np.sqrt(np.mean(square[rows])))

    def spread(name: str) -> float:
        return float(std[place[name]]) if name in place else 0.0

    lens = {n: dict(zip(LENS, end.values["lens"][c].tolist(), strict=True)) for c, n in enumerate(table.cameras)}
    values: dict[str, Any] = {
        "cameras": table.cameras, "pictures": len(table.pictures), "corners": table.n,
        "rms": rms(np.ones(table.n, bool)),
        "rms_by_camera": {n: rms(table.camera == c) for c, n in enumerate(table.cameras)},
        "rms_by_picture": {n: rms(table.picture == p) for p, n in enumerate(table.pictures)},
        "noise": float(np.sqrt(np.sum(square) / max(e.degrees_of_freedom, 1.0))),
        "lens": lens, "lens_std": {n: {k: spread(f"{n}.{k}") for k in LENS} for n in table.cameras},
        "tilt": _tilt(end.values["camera"], end.values["board"]),
    }  # fmt: skip
    rotation, translation, interval = dict[str, list[float]](), dict[str, list[float]](), dict[str, list[float]]()
    baseline = dict[str, float]()
    for n in table.cameras[1:]:
        rotation[n] = [e.value(f"{n}, place.turn_{a}") for a in "xyz"]
        t = np.array([e.value(f"{n}, place.{a}") for a in "xyz"])
        translation[n], baseline[n] = t.tolist(), float(np.linalg.norm(t))
        low, high = e.combination({f"{n}, place.{a}": x / baseline[n] for a, x in zip("xyz", t, strict=True)})[1:]
        interval[n] = [low, high]
    lengths: dict[str, Any] = {"translation": translation, "baseline": baseline, "baseline_interval": interval}
    if len(table.cameras) > 1:
        lengths["point_std"] = _point_std(table, end)
    return values | {"rotation": rotation} | {k if metres else f"{k}_squares": v for k, v in lengths.items()}


def _tilt(cameras: np.ndarray, boards: np.ndarray) -> float:
    """Return the largest angle between a board and a picture plane [rad]."""
    cosines = [np.abs(matrices_of(composed(np.tile(c, (len(boards), 1)), boards))[:, 2, 2]) for c in cameras]
    return float(np.arccos(np.clip(np.min(cosines), 0.0, 1.0)))


def _point_std(table: CornerTable, end: BundleFit) -> list[float]:
    """Return the median standard deviations of intersected corners, along the axes of the first camera."""
    many = len(table.cameras)
    key = [(int(p), *x) for p, x in zip(table.picture, table.X.tolist(), strict=True)]
    place = {k: n for n, k in enumerate(dict.fromkeys(key))}
    uv = np.full((len(place), many, 2), np.nan)
    for k, c, pixel in zip(key, table.camera, table.uv, strict=True):
        uv[place[k], c] = pixel
    lenses, n = end.values["lens"], len(LENS)
    order = np.concatenate(
        [[*range(n * c, n * c + n), *range(n * many + 6 * c, n * many + 6 * c + 6)] for c in range(many)]
    )
    C = end.shared_covariance[np.ix_(order, order)]
    assert C.shape == (MOVES * many, MOVES * many)
    sigma = float(np.sqrt(np.mean(end.residuals["corners"] ** 2)))
    points = intersect(uv, lenses, end.values["camera"], sigma, C)
    return np.sqrt(np.nanmedian(np.einsum("nii->ni", points.covariance), axis=0)).tolist()


def _cameras_file(values: dict[str, Any], metres: bool) -> str:
    names, numbers, spreads, units = [], [], [], []
    for camera, lens in values["lens"].items():
        for k, (label, value) in enumerate(lens.items()):
            names.append(f"{camera}.{label}")
            numbers.append(value)
            spreads.append(values["lens_std"][camera][label])
            units.append("pixel" if k < 4 else "1")
    for camera, vector in values["rotation"].items():
        t = values["translation" if metres else "translation_squares"][camera]
        names += [f"{camera}.{part}_{a}" for part in ("rotation", "translation") for a in "xyz"]
        numbers += [*vector, *t]
        spreads += [float("nan")] * 6
        units += ["rad"] * 3 + ["m" if metres else "square"] * 3
    columns = {"name": names, "value": numbers, "std": spreads, "unit": units}
    note = (
        "p_camera = R p_first + t, R from the rotation vector; lens in OpenCV's order; centre of the first pixel (0, 0)"
    )
    return csv_text(columns, {"value": 15, "std": 4}, [note])


def _residuals_file(corners: CornerTable, rows: np.ndarray, end: BundleFit) -> str:
    error = np.full((corners.n, 2), np.nan)
    error[rows] = end.residuals["corners"]
    columns = {
        "camera": [corners.cameras[c] for c in corners.camera],
        "picture": [corners.pictures[p] for p in corners.picture],
        "corner": list(corners.marks), "u_pixel": corners.uv[:, 0], "v_pixel": corners.uv[:, 1],
        "error_u_pixel": error[:, 0], "error_v_pixel": error[:, 1],
    }  # fmt: skip
    return csv_text(columns, 7, ["error: predicted minus measured; empty for corners left out of the fit"])


def _figure(drawn: list[Any], size: tuple[int, int], title: str) -> Any:
    from ...plot.cameras import residual_figure

    return residual_figure(drawn, size, title=title)


__all__ = ["SolveStatus", "StereoStudy", "explained_pictures", "stereo_study"]
