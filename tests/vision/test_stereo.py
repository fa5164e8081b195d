"""Calibration of cameras: recovery, gross errors, what is refused. Data are synthetic but for OpenCV's corners."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.results import ArgumentError, SolveStatus
from gtmodel.vision import BoardPictures, CameraFit, CornerTable, StereoStart, read_corners, stereo_study
from gtmodel.vision.stereo import SyntheticBoards, camera_starts, made_corners

BOARD = BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6, square=0.03)
SQUARES = replace(BOARD, square=None)
MEASURED = Path(__file__).parents[2] / "problems/data/opencv_stereo/corners.csv"
OPENCV = 0.2150  # pixel rms, reference.txt beside the corners
STARTS = {
    "wide": StereoStart(focal_pixel=640.0),
    "wrong sign": StereoStart(focal_pixel=640.0, translation=(3.3, 0.0, 0.0)),
    "Zhang": StereoStart(),
}


@pytest.fixture(scope="module")
def corners() -> CornerTable:
    return read_corners(MEASURED)


@pytest.mark.parametrize("start", STARTS)
def test_measured_corners_are_fitted_as_well_as_opencv_does_from_far_off(corners, start) -> None:
    s = stereo_study(corners, SQUARES, start=STARTS[start])
    assert s.status.ok and s.rms is not None and s.rms <= OPENCV + 1e-4  # printed to four digits
    assert abs(s.lens["left"]["fx"] - 533.417) < 2e-3 and abs(s.lens["right"]["cy"] - 249.889) < 2e-3
    assert np.allclose(s.translation_squares["right"], [-3.32705, 0.03679, -0.00472], atol=2e-5)
    assert s.baseline == {} and s.translation == {}


def test_opencv_s_own_fit_of_the_same_numbers(corners) -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'gtmodel[vision]'")
    # OpenCV takes corners in single precision; so does the study here
    single = replace(corners, uv=corners.uv.astype(np.float32).astype(float))
    s = stereo_study(single, SQUARES, start=STARTS["wide"])
    picture = [[single.uv[(single.camera == c) & (single.picture == p)].astype(np.float32)[:, None] for p in range(13)]
               for c in range(2)]  # fmt: skip
    X = [single.X[(single.camera == 0) & (single.picture == p)].astype(np.float32) for p in range(13)]
    K = np.array([[640.0, 0, 319.5], [0, 640, 239.5], [0, 0, 1]])
    ends = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 300, 1e-12)
    guess = cv2.CALIB_USE_INTRINSIC_GUESS
    alone = [
        cv2.calibrateCamera(X, uv, (640, 480), K.copy(), np.zeros(5), flags=guess, criteria=ends)[1:3] for uv in picture
    ]
    rms, K1, d1, K2, d2, R, T, *_ = cv2.stereoCalibrate(
        X, *picture, *alone[0], *alone[1], (640, 480), flags=guess, criteria=ends
    )
    assert s.rms is not None and s.rms <= rms * (1 + 1e-6)
    theirs = {}
    for name, M, d in (("left", K1, d1), ("right", K2, d2)):
        values = [M[0, 0], M[1, 1], M[0, 2], M[1, 2], *np.ravel(d)[:5]]
        theirs |= {f"{name}.{label}": v for label, v in zip(gt.vision.LENS, values, strict=True)}
    theirs |= {f"right, place.turn_{a}": v for a, v in zip("xyz", cv2.Rodrigues(R)[0].ravel(), strict=True)}
    theirs |= {f"right, place.{a}": v for a, v in zip("xyz", np.ravel(T), strict=True)}
    assert s.estimate is not None and set(theirs) == set(s.estimate.names)
    for name, std in zip(s.estimate.names, s.estimate.std, strict=True):
        assert abs(s.estimate.value(name) - theirs[name]) <= 0.05 * std, name


def test_synthetic_truth_lies_within_its_deviations() -> None:
    table, lenses, cameras = made_corners(SyntheticBoards(pictures=13), BOARD)
    s = stereo_study(table, BOARD)
    assert s.status.ok and s.estimate is not None
    truth = {
        f"{c}.{n}": v
        for c, lens in zip(s.cameras, lenses, strict=True)
        for n, v in zip(gt.vision.LENS, lens, strict=True)
    }
    truth |= {f"right, place.{a}": v for a, v in zip("xyz", cameras[1, 4:], strict=True)}
    z = [(s.estimate.value(n) - v) / s.estimate.std[s.estimate.names.index(n)] for n, v in truth.items()]
    assert np.max(np.abs(z)) < 4 and 0.3 < np.std(z) < 2
    assert s.noise is not None and abs(s.noise / 0.15 - 1) < 4 / np.sqrt(2 * 2 * table.n)
    assert np.linalg.norm(cameras[1, 4:]) == pytest.approx(s.baseline["right"], abs=0.001)
    assert not any("depend on the place" in n for n in s.notes)
    assert len(s.point_std) == 3 and s.point_std[2] == max(s.point_std)  # depth is the worst


def test_metres_and_squares_are_one_fit() -> None:
    metres = stereo_study(made_corners(SyntheticBoards(pictures=6), BOARD)[0], BOARD)
    squares = stereo_study(made_corners(SyntheticBoards(pictures=6), BOARD)[0], replace(BOARD, lengths="squares"))
    assert squares.baseline == {} and metres.baseline_squares == {}
    assert squares.baseline_squares["right"] == pytest.approx(metres.baseline["right"], rel=1e-12)


def test_metres_without_a_length_are_refused(corners) -> None:
    with pytest.raises(ArgumentError) as error:
        stereo_study(corners, replace(SQUARES, lengths="metres"))
    assert error.value.argument == "board.square"


def test_the_order_of_corners_pictures_and_cameras_changes_nothing() -> None:
    table, _, _ = made_corners(SyntheticBoards(pictures=6), BOARD)
    rng = np.random.default_rng(3)
    k, p = rng.permutation(table.n), rng.permutation(6)
    other = table.rows(k)
    other = replace(other, pictures=tuple(table.pictures[n] for n in p), picture=np.argsort(p)[other.picture])
    a, b = stereo_study(table, BOARD), stereo_study(other, BOARD)
    swapped = stereo_study(replace(table, cameras=("right", "left"), camera=1 - table.camera), BOARD)
    for name in ("left", "right"):
        for label in gt.vision.LENS:
            assert b.lens[name][label] == pytest.approx(a.lens[name][label], rel=1e-10, abs=1e-10)
            assert swapped.lens[name][label] == pytest.approx(a.lens[name][label], rel=1e-10, abs=1e-10)
    assert swapped.baseline["left"] == pytest.approx(a.baseline["right"], rel=1e-10)
    assert b.translation["right"] == pytest.approx(a.translation["right"], rel=1e-10, abs=1e-10)


def spoilt(pictures: int, share: float) -> tuple[CornerTable, np.ndarray, set[str], set[str], CornerTable]:
    """One picture in which the board was moved between the cameras, and a share of corners off by 3 to 30 pixels."""
    table, lenses, _ = made_corners(SyntheticBoards(pictures=pictures, seed=5), BOARD)
    rng = np.random.default_rng(11)
    uv = table.uv.copy()
    wrong = (table.picture == 4) & (table.camera == 1)
    uv[wrong] = np.clip(uv[wrong] + [9.0, 6.0], 0, [639, 479])
    single = rng.choice(np.flatnonzero(table.picture != 4), int(share * table.n), replace=False)
    angle, far = rng.uniform(0, 2 * np.pi, len(single)), rng.uniform(3, 30, len(single))
    uv[single] = np.clip(uv[single] + np.column_stack([np.cos(angle), np.sin(angle)]) * far[:, None], 0, [639, 479])
    bad = replace(table, uv=uv)
    return bad, lenses, {"05"}, {bad.label(int(k)) for k in single}, table


@pytest.mark.parametrize("count", [20, pytest.param(125, marks=pytest.mark.proof)])
def test_a_wrong_picture_and_wrong_corners_are_named_and_do_no_harm(count: int) -> None:
    bad, lenses, pictures, single, _ = spoilt(count, 0.05)
    s = stereo_study(bad, BOARD, CameraFit(gross_errors="removed"))
    assert s.status.ok and set(s.wrong_pictures) == pictures
    missed = single - set(s.gross_corners)
    assert not missed
    others = {n for n in s.gross_corners if n not in single and "picture 05" not in n}
    assert len(others) <= 1  # by chance beyond five deviations: 13,500 corners, 4e-6 each
    assert s.estimate is not None
    for c, lens in zip(s.cameras, lenses, strict=True):
        for label, v in zip(gt.vision.LENS, lens, strict=True):
            name = f"{c}.{label}"
            assert abs(s.estimate.value(name) - v) <= 3 * s.estimate.std[s.estimate.names.index(name)], name
    assert any("wrong as a whole, left out: picture 05" in n for n in s.notes)


def test_what_is_only_named_fails_a_check() -> None:
    bad, *_ = spoilt(13, 0.02)
    s = stereo_study(bad, BOARD)
    assert s.status is SolveStatus.CHECK_FAILED and not s.checks["gross_errors"].passed
    assert s.removed is False


def test_a_board_counted_from_the_other_end_is_refused() -> None:
    table, _, _ = made_corners(SyntheticBoards(pictures=8), BOARD)
    own = np.flatnonzero((table.picture == 2) & (table.camera == 1))
    uv = table.uv.copy()
    uv[own] = uv[own[::-1]]
    with pytest.raises(ArgumentError, match=r"picture 03: right counts .* 180 degrees") as error:
        stereo_study(replace(table, uv=uv), BOARD)
    assert error.value.argument == "corners"


@pytest.mark.parametrize("size", [(8, 6), (9, 7), (7, 7)])
def test_boards_with_two_readings_are_refused(corners, size) -> None:
    with pytest.raises(ArgumentError) as error:
        stereo_study(corners, replace(SQUARES, columns=size[0], rows=size[1]))
    assert error.value.argument == "board"


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("start", [StereoStart(), StereoStart(focal_pixel=600.0)])
def test_a_board_that_is_never_tilted_determines_no_focal_length_and_that_is_said(
    noise: float, start: StereoStart
) -> None:
    table, _, _ = made_corners(SyntheticBoards(pictures=10, noise_pixel=0.0), BOARD)
    left = table.rows(table.camera == 0)
    rng = np.random.default_rng(2)
    z, place = rng.uniform(0.35, 0.6, 10), rng.uniform(-0.05, 0.05, (10, 2))
    p = (left.X[:, :2] - [4, 2.5]) * 0.03 + place[left.picture]
    uv = 540 * p / z[left.picture][:, None] + [325, 236] + noise * rng.standard_normal(p.shape)
    flat = replace(left, cameras=("left",), uv=uv)
    fit = CameraFit(distortion=())
    try:
        s = stereo_study(flat, BOARD, fit, start)
    except ArgumentError as error:
        assert "tilt" in error.message
    else:
        assert not s.status.ok and "tilt the board" in s.message


def test_one_camera_alone() -> None:
    table, lenses, _ = made_corners(SyntheticBoards(pictures=10), BOARD)
    s = stereo_study(replace(table.rows(table.camera == 0), cameras=("left",)), BOARD)
    assert s.status.ok and s.baseline == {} and abs(s.lens["left"]["fx"] - lenses[0, 0]) < 5
    with pytest.raises(ArgumentError) as error:
        stereo_study(
            replace(table.rows(table.camera == 0), cameras=("left",)), BOARD, start=StereoStart(translation=(1, 0, 0))
        )
    assert error.value.argument == "start.translation"


@pytest.mark.parametrize("wrong", ["beside", "outside", "few", "apart"])
def test_refusals(wrong: str) -> None:
    table, _, _ = made_corners(SyntheticBoards(pictures=4), BOARD)
    if wrong == "beside":
        table = replace(table, X=table.X + 0.5)
    elif wrong == "outside":
        table = replace(table, uv=table.uv + 600)
    elif wrong == "few":
        table = table.without(["01", "02"])
    else:
        table = table.rows((table.camera == 0) == (table.picture < 2))
    with pytest.raises(ArgumentError) as error:
        stereo_study(table, BOARD)
    assert error.value.argument == "corners"


@pytest.mark.parametrize("wrong", ["sigma", "twice", "column"])
def test_corners_that_cannot_be_measurements_are_refused(wrong: str) -> None:
    table, _, _ = made_corners(SyntheticBoards(pictures=4), BOARD)
    board, argument = BOARD, "corners"
    with pytest.raises(ArgumentError) as error:
        if wrong == "sigma":
            table = replace(table, sigma=np.where(np.arange(table.n) == 60, 0.0, 0.1))
        elif wrong == "twice":
            table = table.rows(np.append(np.arange(table.n), 60))
        else:  # a board of 9 x 6 said to have 11: how it looks when turned would be judged by the wrong numbers
            board, argument = replace(BOARD, columns=11), "board"
        stereo_study(table, board)
    assert error.value.argument == argument
    if wrong != "column":
        assert table.label(60) in error.value.message
    else:
        stereo_study(table, replace(board, identified=True))


def test_what_fits_without_a_residual_and_may_be_a_mistake_is_said(corners) -> None:
    """Mirrored pictures, the board counted the other way round in one, and a picture said to be twice as large."""
    good = stereo_study(corners, SQUARES)
    assert not any("from behind" in n or "far from the middle" in n for n in good.notes)
    square = replace(SQUARES, height_pixel=640)
    exchanged = stereo_study(replace(corners, uv=corners.uv[:, ::-1].copy()), square)
    assert any("from behind in all pictures" in n for n in exchanged.notes)
    X = corners.X.copy()
    own = corners.picture == 2
    X[own, 0] = 8 - X[own, 0]
    one = stereo_study(replace(corners, X=X), SQUARES)
    assert any("from behind in picture 03" in n for n in one.notes)
    assert one.lens["left"]["fx"] == pytest.approx(good.lens["left"]["fx"], rel=1e-8)  # it does no harm
    large = stereo_study(corners, replace(SQUARES, width_pixel=1280, height_pixel=960), start=STARTS["wide"])
    assert sum("far from the middle of a picture of 1280 x 960" in n for n in large.notes) == 2


def test_a_wrong_principal_point_shows_in_the_quadratic_map() -> None:
    """Held in the middle of the picture, some pixels from where it is; with few, wide pictures it cannot hide."""
    table, _, _ = made_corners(SyntheticBoards(pictures=40, noise_pixel=0.05), BOARD)
    s = stereo_study(table, BOARD, CameraFit(principal_point=False, distortion=("k1", "k2")))
    assert max(s.quadratic_p.values()) < 1e-6
    assert any("depend on the place in the picture" in n for n in s.notes)
    good = stereo_study(table, BOARD)
    assert min(good.quadratic_p.values()) > 1e-3


def test_starts_have_all_corners_in_front(corners) -> None:
    begin = camera_starts(corners, SQUARES, StereoStart(focal_pixel=640.0))
    assert np.all(begin.boards[:, 6] > 0) and begin.lenses.shape == (2, 9)


def test_a_stop_ends_the_study(corners) -> None:
    s = stereo_study(corners, SQUARES, stop=lambda: True)
    assert s.status is SolveStatus.INTERRUPTED


@pytest.mark.proof
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """400 synthetic calibrations of one scene: 95 % intervals of all lens parameters and of the baseline."""
    table, lenses, cameras = made_corners(SyntheticBoards(pictures=8, noise_pixel=0.0), BOARD)
    names = [f"{c}.{n}" for c in ("left", "right") for n in gt.vision.LENS] + ["baseline"]
    truth = np.append(lenses.reshape(-1), np.linalg.norm(cameras[1, 4:]))
    hits = np.zeros(len(names))
    for seed in range(400):
        noise = 0.15 * np.random.default_rng([26, seed]).standard_normal(table.uv.shape)
        s = stereo_study(replace(table, uv=table.uv + noise), BOARD)
        assert s.estimate is not None
        intervals = [s.interval(n) for n in names[:-1]] + [tuple(s.baseline_interval["right"])]
        hits += [low < t < high for (low, high), t in zip(intervals, truth, strict=True)]
    low, high = gt.inference.binomial_band(400)
    assert np.all((hits >= low) & (hits <= high)), dict(zip(names, hits, strict=True))
    assert 0.94 <= hits.mean() / 400 <= 0.96
