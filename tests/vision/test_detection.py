"""Detection on rendered pictures whose marks are known: accuracy, no wrong pattern, and what is a status."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.vision import detection, rendering
from gtmodel.vision.detection import DetectionStatus
from tests.vision.scenes import picture, scene

pytest.importorskip("cv2", reason="detection needs OpenCV, the extra `vision`")

ACCURATE = 0.05  # pixel rms, of the issue
WRONG = 1.0  # pixel: a mark so far off is another one
TARGETS = {
    "five squares": detection.FiveSquares(),
    "chessboard": detection.Chessboard(),
    "charuco": detection.Charuco(),
}
each_target = pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)


def errors(seen: detection.Detection, target, truth: np.ndarray) -> np.ndarray:
    return seen.corners - truth[[target.marks.index(m) for m in seen.marks]]


def judged(target, seeds) -> tuple[float, int, int, float]:
    """rms error [pixel], detected, wrong, and rms of errors over the stated sigma."""
    squares, over, detected, wrong = [], [], 0, 0
    for seed in seeds:
        project, truth = scene(target, seed)
        seen = detection.detect(picture(target, project, seed), target)
        if not seen.status.ok:
            continue
        detected += 1
        e = errors(seen, target, truth)
        wrong += bool(np.abs(e).max() > WRONG)
        squares.append((e**2).ravel())
        over.append(((e / seen.sigma[:, None]) ** 2).ravel())
    return np.sqrt(np.concatenate(squares).mean()), detected, wrong, np.sqrt(np.concatenate(over).mean())


@pytest.mark.parametrize("pictures", [3, pytest.param(6, marks=pytest.mark.proof)])
@each_target
def test_marks_are_where_they_were_rendered(target, pictures):
    rms, detected, wrong, over = judged(target, range(pictures))
    assert detected == pictures
    assert wrong == 0
    assert rms <= ACCURATE
    assert 0.2 < over < 1.5  # the stated sigma is no smaller than the errors by more than half


@pytest.mark.proof
@each_target
def test_no_pattern_of_a_thousand_is_wrong(target):
    rms, detected, wrong, _ = judged(target, range(1000))
    assert wrong == 0
    assert detected >= 990
    assert rms <= ACCURATE


@each_target
def test_light_is_a_status(target):
    project, _ = scene(target, 3)
    look = lambda **e: detection.detect(picture(target, project, 3, **e), target)  # noqa: E731
    dark, bright = look(gain=0.12), look(gain=9.0, background=220.0)
    assert dark.status is DetectionStatus.TOO_DARK
    assert bright.status is DetectionStatus.TOO_BRIGHT
    assert dark.marks == () and dark.corners.shape == (0, 2) and "dark" in dark.message
    assert look(gain=0.35).status.ok


@each_target
def test_an_empty_picture_and_a_covered_target_are_statuses(target):
    project, truth = scene(target, 5)
    empty = rendering.rendered([], project, (640, 480))
    assert detection.detect(empty, target).status is DetectionStatus.NOT_SEEN
    covered = picture(target, project, 5)
    covered[:, int(truth[:, 0].mean() + 0.3 * np.ptp(truth[:, 0])) :] = 120
    seen = detection.detect(covered, target)
    if isinstance(target, detection.Charuco):  # a part is enough, and says which part
        assert seen.status.ok and len(seen.marks) < len(target.marks)
        assert np.abs(errors(seen, target, truth)).max() < WRONG
    else:
        assert seen.status in (DetectionStatus.PARTLY_VISIBLE, DetectionStatus.NOT_SEEN)


def test_clutter_and_a_background_leave_the_five_squares():
    target = TARGETS["five squares"]
    rng = np.random.default_rng(2)
    boxes = []
    project, truth = scene(target, 11)
    low, high = truth.min(axis=0) - 50, truth.max(axis=0) + 50
    while len(boxes) < 60:
        c, a, w = rng.uniform([0, 0], [640, 480]), rng.uniform(8, 25), rng.uniform(0, 6.3)
        turn = np.array([[np.cos(w), -np.sin(w)], [np.sin(w), np.cos(w)]])
        box = c + a * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ turn.T
        if np.all(np.any((box < low) | (box > high), axis=1)):
            boxes.append(box)

    def cluttered(seed: int, tool: bool) -> np.ndarray:
        image = picture(target, project, seed).astype(float) if tool else np.full((480, 640), 120.0)
        for box in boxes:
            image += rendering.coverage([box], (640, 480)) * (35 - image)
        noise = np.random.default_rng(seed).standard_normal(image.shape)
        return np.clip(np.rint(image + 2 * noise), 0, 255).astype(np.uint8)

    behind = detection.background([cluttered(s, tool=False) for s in range(3)])
    for background in (None, behind):
        seen = detection.detect(cluttered(9, tool=True), target, background)
        assert seen.status.ok
        assert np.abs(errors(seen, target, truth)).max() < WRONG


def test_the_chessboard_is_counted_from_its_painted_corner():
    """Turned by 180 degrees in the picture, mark 0 turns with the board."""
    target = TARGETS["chessboard"]
    project, truth = scene(target, 8)
    upside = np.ascontiguousarray(picture(target, project, 8)[::-1, ::-1])
    seen = detection.detect(upside, target)
    assert seen.status.ok
    np.testing.assert_allclose(seen.corners, np.array([639.0, 479.0]) - truth, atol=0.5)


@pytest.mark.parametrize(("columns", "rows"), [(7, 7), (8, 6), (9, 5)])
def test_a_board_that_looks_alike_after_half_a_turn_is_refused(columns, rows):
    with pytest.raises(gt.results.ArgumentError) as refused:
        detection.Chessboard(columns=columns, rows=rows)
    assert refused.value.argument == "columns"


@pytest.mark.parametrize("centres", [
    [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0], [1.0, 1.0]],
    [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [6.0, 0.0], [8.0, 0.0]],
])  # fmt: skip
def test_squares_that_look_alike_after_a_turn_are_refused(centres):
    with pytest.raises(gt.results.ArgumentError) as refused:
        detection.FiveSquares(centres=centres)
    assert refused.value.argument == "centres"


def test_what_is_no_grey_picture_is_refused():
    target = TARGETS["five squares"]
    for wrong in (np.zeros((4, 4)), np.zeros((4, 4, 3), np.uint8)):
        with pytest.raises(gt.results.ArgumentError) as refused:
            detection.detect(wrong, target)
        assert refused.value.argument == "picture"
    with pytest.raises(gt.results.ArgumentError) as refused:
        detection.detect(np.zeros((40, 40), np.uint8), target, np.zeros((3, 3)))
    assert refused.value.argument == "background"


def test_without_opencv_it_is_said_what_to_install(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "cv2", None)
    target = TARGETS["five squares"]
    project, _ = scene(target, 1)
    with pytest.raises(gt.results.ArgumentError, match="vision"):
        detection.detect(picture(target, project, 1), target)


def test_corners_of_pictures_are_one_table():
    target = TARGETS["five squares"]
    project, truth = scene(target, 4)
    light = picture(target, project, 4)
    rows, seen = detection.detected_corners({("left", "1"): light, ("left", "2"): light // 8}, target)
    assert [r.mark for r in rows] == list(target.marks)
    assert seen["left", "2"].status is DetectionStatus.TOO_DARK
    lines = detection.corners_csv(rows, synthetic="seed 4, noise 2 of 255").splitlines()
    assert lines[0].startswith("# synthetic") and lines[1] == "camera,pose,mark,u,v,sigma"
    read = np.array([[float(x) for x in line.split(",")[3:5]] for line in lines[2:]])
    np.testing.assert_allclose(read, truth, atol=WRONG)
    with pytest.raises(gt.results.ArgumentError):
        detection.corners_csv([])
