"""Synthetic pictures of a robot with known errors, as in Dressler 2012, section 5.5."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ...calibrate.options import Choice
from ...geometry.quaternions import exponential, product, quaternion_matrix, quaternion_of
from ...lang.model import Model
from ...results.refusal import ArgumentError
from ..detection.targets import FiveSquares
from .options import CameraStart, SyntheticRobotCameras
from .pictures import RobotPictures, SecondDevice
from .projection import TARGET, mark, robot_side, seen

NAMES = ("left", "right")
BASE_FRAME = ("A[2]", "v[2]", "A[0,1]")  # the same in the true and in the uncalibrated robot


@dataclass(frozen=True, eq=False)
class MadePictures:
    """Pictures, the uncalibrated robot, its true parameters by name, and the true cameras (K, 16)."""

    robot: Model
    pictures: RobotPictures
    cameras: list[CameraStart]
    true_parameters: dict[str, float]
    true_cameras: np.ndarray


def made_pictures(asked: SyntheticRobotCameras, robot: Model | None = None) -> MadePictures:
    """Make synthetic pictures of a robot (l1_tape if left out) whose true parameters differ from the known ones.

    Raises ArgumentError for a grid that the robot does not reach or a camera does not see.

    >>> V = gt.vision.robot_cameras
    >>> made = V.made_pictures(V.SyntheticRobotCameras(counts=[3, 3, 3], seed=1))
    >>> len(made.pictures), made.pictures.actuators.shape, made.pictures.synthetic[:9]
    (1080, (27, 3), 'synthetic')
    """
    from ...robots.catalogue import gantry_tau

    robot = gantry_tau("l1_tape") if robot is None else robot
    rng = np.random.default_rng(asked.seed)
    side = robot_side(robot, Choice())
    names = side.unknowns.names
    truth = side.unknowns.start + asked.robot_error * rng.standard_normal(len(names))
    for k, name in enumerate(names):
        if name.startswith(("A[2", "v[2")) or name == "A[0,1]":
            truth[k] = side.unknowns.start[k]
    grid = _grid(asked, rng)
    q, status = robot.causal(known="T", targets="q")(grid)
    if np.any(np.asarray(status) != 0):
        raise ArgumentError(
            f"the robot does not reach {int(np.sum(np.asarray(status) != 0))} points of the grid", "size"
        )
    T = side.forward(truth, q, grid)
    if not np.all(np.isfinite(T)):
        raise ArgumentError("the robot with its true parameters does not reach the whole grid", "size")
    cameras, target = _cameras(asked), _target(asked)
    marks = FiveSquares(side=asked.side)
    uv = _seen(cameras, target, T, marks.points, asked.mounted == "fixed")
    size = np.array([asked.width_pixel, asked.height_pixel])
    if not np.all((uv > 0) & (uv < size - 1)):
        raise ArgumentError("a camera does not see the target at every pose; increase the distance", "distance")
    noise = rng if asked.noise_seed is None else np.random.default_rng([asked.seed, asked.noise_seed])
    rates = asked.speed * noise.standard_normal(q.shape) if asked.speed else None
    read = q if rates is None else q - asked.delay * rates
    pictures = replace(_pictures(asked, noise, uv, read, T, marks), rates=rates)
    starts = [CameraStart(n, asked.width_pixel, asked.height_pixel) for n in pictures.cameras]
    return MadePictures(robot, pictures, starts, dict(zip(names, truth.tolist(), strict=True)), cameras)


def _grid(asked: SyntheticRobotCameras, rng: np.random.Generator) -> np.ndarray:
    lines = [np.linspace(-0.5, 0.5, n) * s for n, s in zip(asked.counts, asked.size, strict=True)]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3) + asked.centre
    if asked.poses is None:
        return grid
    if asked.poses > len(grid):
        raise ArgumentError(f"found {asked.poses}; expected at most the {len(grid)} points of the grid", "poses")
    return grid[np.sort(rng.permutation(len(grid))[: asked.poses])]


def _cameras(asked: SyntheticRobotCameras) -> np.ndarray:
    """Return the cameras (K, 16); those on a plate look along x at a fixed target behind the volume."""
    middle = np.asarray(asked.centre, float)
    lens = [asked.focal_pixel, asked.focal_pixel, asked.width_pixel / 2, asked.height_pixel / 2, *asked.distortion]
    rows = []
    for k in range(asked.cameras):
        across = 0.0 if asked.cameras == 1 else (k - 0.5) * asked.baseline
        if asked.mounted == "fixed":
            position, to = middle + np.array([asked.distance, across, 0.0]), middle
        else:
            position, to = np.array([0.0, across, 0.0]), np.array([asked.distance, 0.0, 0.0])
        rows.append([*lens, *_looking(position, to), *position])
    return np.array(rows)


def _looking(position: np.ndarray, to: np.ndarray) -> np.ndarray:
    forward = (to - position) / np.linalg.norm(to - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return quaternion_of(np.column_stack([right, np.cross(forward, right), forward]))


def _target(asked: SyntheticRobotCameras) -> np.ndarray:
    """Return the target (8,), facing the cameras with a small tilt."""
    facing = -1.0 if asked.mounted == "fixed" else 1.0
    R = np.column_stack([[0.0, -facing, 0.0], [0.0, 0.0, -1.0], [facing, 0.0, 0.0]])
    small = np.array([1.0, 0.01, -0.015, 0.005])
    R = R @ quaternion_matrix(small / np.linalg.norm(small))
    position = np.array(asked.centre) + np.array([asked.distance, 0.0, 0.0])
    return np.array([*quaternion_of(R), *(np.zeros(3) if asked.mounted == "fixed" else position), 1.0])


def _seen(cameras: np.ndarray, target: np.ndarray, T: np.ndarray, marks: np.ndarray, on_tool: bool) -> np.ndarray:
    """Return the projected marks (K, N, M, 2) [pixel]."""
    c, t, z, p = (ca.SX.sym(n, k) for n, k in (("c", 16), ("t", 8), ("z", T.shape[1]), ("p", 3)))
    f = ca.Function("seen", [c, t, z, p], [seen(c, mark(t, z, p, on_tool))[0]])
    N, M = len(T), len(marks)
    poses, points = np.repeat(T, M, axis=0).T, np.tile(marks, (N, 1)).T
    uv = [np.asarray(f.map(N * M)(np.tile(c[:, None], N * M), np.tile(target[:, None], N * M), poses, points)).T
          for c in cameras]  # fmt: skip
    return np.array(uv).reshape(len(cameras), N, M, 2)


def _pictures(asked: SyntheticRobotCameras, rng: np.random.Generator, uv: np.ndarray, q: np.ndarray, T: np.ndarray,
              marks: FiveSquares) -> RobotPictures:  # fmt: skip
    K, N, M = uv.shape[:3]
    measured = uv + asked.pixel_noise * rng.standard_normal(uv.shape)
    read = q + asked.actuator_noise * rng.standard_normal(q.shape)
    for pose in asked.turned_pictures:
        measured[0, pose] = np.roll(measured[0, pose], M // 2, axis=0)
    if asked.wrong_corners:
        off = rng.uniform(size=(K, N, M)) < asked.wrong_corners
        angle, length = rng.uniform(0, 2 * np.pi, off.sum()), rng.uniform(2, 20, off.sum())
        measured[off] += length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    device = None
    if asked.second_device:
        rows = np.sort(rng.permutation(N)[: asked.second_device])
        turn, shift = quaternion_matrix(_unit(rng.standard_normal(4))), rng.standard_normal(3)
        device = SecondDevice(rows, (T[rows] - shift) @ turn + 10e-6 * rng.standard_normal((len(rows), 3)), 10e-6)
    camera, pose, number = (a.ravel() for a in np.meshgrid(np.arange(K), np.arange(N), np.arange(M), indexing="ij"))
    sigma = np.full(len(camera), max(asked.pixel_noise, 1e-6))
    return RobotPictures(
        _names(K), [str(k + 1) for k in range(N)], marks.marks, camera, pose, number, measured.reshape(-1, 2), sigma,
        read, marks.points, device, T, synthetic=asked.words,
    )  # fmt: skip


def _names(K: int) -> Sequence[str]:
    return NAMES if K == 2 else ("camera",)


def _unit(q: np.ndarray) -> np.ndarray:
    return q / np.linalg.norm(q)


def made_hand_eye(
    seed: int = 1, poses: int = 12, mounted: str = "plate", pixel_noise: float = 0.1, pose_noise: float = 1e-4
) -> MadePictures:
    """Make synthetic pictures by a camera on an arm of a fixed target, or by a fixed camera of a target on the arm.

    `pose_noise` [m] and [rad]: of the poses reported by the controller. The pictures have poses (N, 7) instead of
    actuators, and `true_parameters` is the pose of the target. The robot of the result is a placeholder.

    >>> gt.vision.robot_cameras.made_hand_eye(seed=2).pictures.actuators.shape
    (12, 7)
    """
    from ...geometry.rotations import composed, inverse_poses
    from ...robots.catalogue import gantry_tau

    rng = np.random.default_rng(seed)
    tool, on_tool = FiveSquares(side=0.04), mounted == "fixed"
    lens = [1400.0, 1400.0, 799.5, 599.5, -0.1, 0.05, 2e-4, -3e-4, 0.0]
    carried = np.array([*_unit(np.array([1.0, 0.05, -0.1, 0.4])), 0.03, -0.05, 0.08])
    standing = np.array([*_unit(np.array([0.3, 0.9, 0.1, -0.2])), 0.8, -0.3, 0.2])
    rows = list[np.ndarray]()
    while len(rows) < poses:  # the target in front of the camera, tilted
        tilt = exponential(rng.uniform(-0.5, 0.5, 3))
        view = np.array([*tilt, *rng.uniform([-0.15, -0.1, 0.7], [0.15, 0.1, 1.1])])
        # A carried = standing B, with B the target in the camera frame or the camera in the target frame
        B = view[None] if on_tool else inverse_poses(view[None])
        rows.append(composed(composed(standing[None], B), inverse_poses(carried[None]))[0])
    A = np.array(rows)
    camera = np.array([[*lens, *(standing if on_tool else carried)]])
    target = np.concatenate([carried if on_tool else standing, [1.0]])
    exact = np.column_stack([A[:, 4:], A[:, :4]])
    uv = _seen(camera, target, exact, tool.points, on_tool)
    reported = exact.copy()
    reported[:, :3] += pose_noise * rng.standard_normal((poses, 3))
    reported[:, 3:] = product(exact[:, 3:], exponential(pose_noise * rng.standard_normal((poses, 3))))
    pose, number = (a.ravel() for a in np.meshgrid(np.arange(poses), np.arange(20), indexing="ij"))
    measured = uv.reshape(-1, 2) + pixel_noise * rng.standard_normal((20 * poses, 2))
    words = f"synthetic, seed {seed}, noise {pixel_noise:g} pixel, {1e3 * pose_noise:g} mm and mrad of the arm"
    pictures = RobotPictures(
        ("camera",), [str(k + 1) for k in range(poses)], tool.marks, 0 * pose, pose, number, measured,
        np.full(len(pose), max(pixel_noise, 1e-6)), reported, tool.points, synthetic=words,
    )  # fmt: skip
    start = CameraStart("camera", 1600.0, 1200.0, 1400.0, [799.5, 599.5], lens[4:])
    place = {name: float(x) for name, x in zip(TARGET, target[:7], strict=False)}
    return MadePictures(gantry_tau("l1_tape"), pictures, [start], place, camera)
