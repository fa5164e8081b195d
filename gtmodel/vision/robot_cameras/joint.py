"""Robot and cameras in one bundle: pixels and closure equations with all poses eliminated, and the gauge motions that
pictures do not determine, with their remedies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..._pickling import Portable
from ...calibrate.measured.column_checks import NEARER, aligned, degrees_of_freedom, length
from ...calibrate.options import Choice
from ...geometry.quaternions import quaternion_matrix, quaternion_of, turn_matrix
from ...inference.bundle import BundleFit, GaugeMotion, ResidualBlock, UnknownGroup, bundle_fit
from ...inference.held_out import MATTERS
from ...lang.model import Model
from ...measurements.inspection.misread_columns import compared, mirrored
from ...results.estimate import Estimate
from ...results.refusal import ArgumentError
from ...robots.links import family_of
from .options import CameraStart, RobotCameras
from .pictures import RobotPictures, SecondDevice
from .projection import CAMERA, TARGET, TURN, RobotLinks, corner_function, device_function, links_function, robot_side
from .robust import RobustFit, robust_fit
from .starts import camera_starts, target_start

Values = Mapping[str, np.ndarray]
AXES = "xyz"


def redundancies(side: RobotLinks, q: np.ndarray, on_tool: bool) -> list[GaugeMotion]:
    """Return the gauge motions: base frame and cameras (6), tool centre point and target (3), and scale (1)."""

    def with_robot(values: Values, moved: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Add the change of the robot parameters that belongs to the motion of the poses."""
        _, by_x, by_z, _ = side.at(values["robot"][0], values["pose"], q)
        dz = moved["pose"]
        if side.turns:  # increments of a quaternion in its own frame
            e = values["pose"][:, 3:]
            dz = np.column_stack([dz[:, :3], np.einsum("nij,nj->ni", turn_matrix(e), dz[:, 3:])])
        rhs = np.einsum("nmz,nz->nm", by_z, dz).reshape(-1)
        moved["robot"] = -np.linalg.lstsq(by_x.reshape(len(rhs), -1), rhs, rcond=None)[0][None]
        return moved

    def still(values: Values) -> dict[str, np.ndarray]:
        return {"camera": np.zeros((len(values["camera"]), 15)), "target": np.zeros((1, 7)),
                "pose": np.zeros((len(values["pose"]), 6 if side.turns else 3))}  # fmt: skip

    def shifted(k: int) -> Callable[[Values], Values]:
        def direction(values: Values) -> Values:
            out = still(values)
            out["pose"][:, k] = 1.0
            if on_tool:
                out["camera"][:, 12 + k] = 1.0
            else:
                out["target"][:, 3 + k] = 1.0
            return _device(values, with_robot(values, out), shift=np.eye(3)[k])

        return direction

    def turned(k: int) -> Callable[[Values], Values]:
        def direction(values: Values) -> Values:
            w, out = np.eye(3)[k], still(values)
            out["pose"][:, :3] = np.cross(w, values["pose"][:, :3])
            if side.turns:
                out["pose"][:, 3:] = w @ quaternion_matrix(values["pose"][:, 3:])
            if on_tool or not side.turns:
                out["camera"][:, 9:12] = w @ quaternion_matrix(values["camera"][:, 9:13])
                out["camera"][:, 12:] = np.cross(w, values["camera"][:, 13:])
            if not (on_tool and side.turns):
                out["target"][0, :3] = w @ quaternion_matrix(values["target"][0, :4])
                out["target"][0, 3:6] = np.cross(w, values["target"][0, 4:7])
            return _device(values, with_robot(values, out), turn=w)

        return direction

    def centred(k: int) -> Callable[[Values], Values]:
        def direction(values: Values) -> Values:
            d, out = np.eye(3)[k], still(values)
            out["pose"][:, :3] = quaternion_matrix(values["pose"][:, 3:]) @ d if side.turns else d
            if on_tool:
                out["target"][0, 3:6] = -d
            else:
                out["camera"][:, 12:] = -d
            return with_robot(values, out)

        return direction

    def grown(values: Values) -> Values:
        out = still(values)
        out["pose"][:, :3] = values["pose"][:, :3]
        out["camera"][:, 12:] = values["camera"][:, 13:]
        out["target"][0, 3:7] = values["target"][0, 4:8]
        return with_robot(values, out)

    carrier = "the cameras" if on_tool else "the target"
    other = "the target on the tool" if on_tool else "the cameras on the plate"
    base = f"hold what defines the robot's base frame, or {carrier}"
    tool = f"hold the place of {other}"
    motions = [GaugeMotion(f"the robot's base and {carrier} move together along {a}", base, shifted(k))
               for k, a in enumerate(AXES)]  # fmt: skip
    motions += [GaugeMotion(f"the robot's base and {carrier} turn together about {a}", base, turned(k))
                for k, a in enumerate(AXES)]  # fmt: skip
    motions += [GaugeMotion(f"the tool centre point moves along {a} against {other}", tool, centred(k))
                for k, a in enumerate(AXES)]  # fmt: skip
    more = "give one known length: the target's dimensions, an actuator's displacement, or a second device"
    return [*motions, GaugeMotion("everything grows by one factor", more, grown)]


def _device(values: Values, out: dict[str, np.ndarray], shift: np.ndarray | None = None,
            turn: np.ndarray | None = None) -> dict[str, np.ndarray]:  # fmt: skip
    """Add the motion of the second device's frame with the base."""
    if "device" in values:
        step = np.zeros((1, 6))
        if shift is not None:
            step[0, 3:] = shift
        if turn is not None:
            step[0, :3] = turn @ quaternion_matrix(values["device"][0, :4])
            step[0, 3:] = np.cross(turn, values["device"][0, 4:])
        out["device"] = step
    return out


INTRINSICS = {"focal": ("fx", "fy"), "principal_point": ("cx", "cy"), "distortion": ("k1", "k2", "p1", "p2")}
HUBER = 2.0  # standard deviations
FAR = 0.2  # largest deviation of the second device's positions, relative to their spread
CAMERA_UNITS = ("pixel",) * 4 + ("1",) * 5 + ("rad",) * 3 + ("m",) * 3


@dataclass(frozen=True, eq=False)
class JointFit(Portable):
    """The calibrated robot and cameras.

    `pictures`: those used in the final fit. `wrong_pictures`, `wrong_corners`, `wrong_poses`: descriptions of what was
    removed; a pose is wrong if none of its pictures matches its actuator readings. `first`: number of corners before
    the removal. `fit`: result of the bundle.
    """

    fit: BundleFit
    side: RobotLinks
    setting: RobotCameras
    pictures: RobotPictures
    wrong_pictures: tuple[str, ...]
    wrong_corners: tuple[str, ...]
    wrong_poses: tuple[str, ...]
    first: int

    @property
    def estimate(self) -> Estimate:
        """Estimate of all shared unknowns. Raises ArgumentError if the fit failed."""
        if self.fit.estimate is None:
            raise ArgumentError(f"the fit failed and has no estimate: {self.fit.message}")
        return self.fit.estimate

    @property
    def parameters(self) -> dict[str, float]:
        """The robot's free parameters by name."""
        return self.side.unknowns.named(self.fit.values["robot"][0])

    @cached_property
    def residuals(self) -> np.ndarray:
        """Residuals (n, 2) [pixel] of the corners in `pictures`."""
        return self.fit.residuals["corners"]

    @property
    def delay(self) -> float:
        """Delay [s] of the pictures relative to the actuator readings; 0 if it was not estimated."""
        return float(self.fit.values["clock"][0, 0]) if "clock" in self.fit.values else 0.0

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Return tool centre points (n, 3) [m] of the calibrated robot at actuator readings q; NaN without solution."""
        near = self.side.start(q)
        return self.side.forward(self.fit.values["robot"][0], q, near)[:, :3]

    def camera_of(self, name: str) -> dict[str, float]:
        """Return the parameters of a camera by name."""
        return dict(
            zip(CAMERA, self.fit.values["camera"][list(self.pictures.cameras).index(name)].tolist(), strict=True)
        )


def held_by_default(robot: Model, setting: RobotCameras) -> tuple[list[str], bool]:
    """Return the parameters that define the base frame, and whether the pose of the first camera defines it instead.

    In the frame of Dressler 2012, Table 5.7, the last guideway is the x-axis, and the z-axis intersects the first
    guideway. If the actuators give the scale, the length of the last guideway's direction vector is held too.
    """
    if setting.hold is not None:
        return list(setting.hold), not setting.hold and setting.scale == "target"
    if family_of(robot) == "three_link":
        along = ["v[2]"] if setting.scale == "actuators" else ["v[2,1]", "v[2,2]"]
        return ["A[2]", *along, "A[0,1]"], False
    return [], True


def joint_fit(
    robot: Model,
    pictures: RobotPictures,
    cameras: list[CameraStart],
    setting: RobotCameras | None = None,
    *,
    stop: Callable[[], bool] | None = None,
) -> JointFit:
    """Fit robot parameters, cameras and the pose of the target to all corners together.

    The unknowns are the parameters that `setting` frees, the pose of the target on its carrier, and the pose at each
    row of the actuators, which is eliminated. Corners are weighted with their sigma, the closure equations with the
    noise of the actuators. Wrong pictures, single corners far off, and poses whose pictures all contradict the actuator
    readings are removed and named. Raises ArgumentError with a remedy if the pictures do not determine all unknowns,
    if no starting values fit, and if the positions of the second device do not match those of the robot.

    >>> V = gt.vision.robot_cameras
    >>> made = V.made_pictures(V.SyntheticRobotCameras(counts=[3, 3, 3], seed=1))
    >>> joint = V.joint_fit(made.robot, made.pictures, made.cameras)
    >>> low, high = joint.estimate.interval("left.fx", 0.999)  # pixel
    >>> low < 1400.0 < high, joint.camera_of("left")["fx"] == joint.estimate.value("left.fx")
    (True, True)
    """
    setting = setting or RobotCameras()
    ready = Prepared.of(robot, pictures, cameras, setting)
    if setting.removal == 0:
        return ready.joint(RobustFit(pictures, ready.fit(pictures, stop=stop)))
    robust = robust_fit(ready, pictures, stop)
    if not robust.fit.status.ok:
        message = f"{robust.fit.message}; residuals of most corners are {robust.noise:.2g} times their stated sigma"
        remedy = "correct sigma, or check that target, pictures and actuator readings belong together"
        fit = robust.fit if robust.noise < MATTERS else replace(robust.fit, message=f"{message}: {remedy}")
        return ready.joint(replace(robust, fit=fit))
    return ready.joint(replace(robust, fit=ready.fit(robust.pictures, values=robust.fit.values, stop=stop)))


@dataclass(frozen=True, eq=False)
class Prepared:
    """The prepared problem: starting values, and fixed unknowns."""

    side: RobotLinks
    setting: RobotCameras
    start: dict[str, np.ndarray]
    camera_fixed: np.ndarray
    target_fixed: np.ndarray
    names: tuple[str, ...]
    first: int

    @classmethod
    def of(cls, robot: Model, p: RobotPictures, cameras: list[CameraStart], setting: RobotCameras) -> Prepared:
        by_name = {c.name: c for c in cameras}
        twice = [c.name for k, c in enumerate(cameras) if c.name in [other.name for other in cameras[:k]]]
        if twice:
            raise ArgumentError(f"'{twice[0]}' has two entries; remove one", "cameras")
        missing = [n for n in p.cameras if n not in by_name]
        if missing:
            raise ArgumentError(f"'{missing[0]}' has corners but no entry; add one with width and height", "cameras")
        for name in p.cameras:
            values = {"focal": by_name[name].focal_pixel, "principal_point": by_name[name].principal_point_pixel}
            lacking = [key for key, value in values.items() if value is None and key not in setting.estimate]
            if lacking:
                words = lacking[0].replace("_", " ")
                raise ArgumentError(f"the {words} of {name} is held but has no value; set or estimate it", "cameras")
        if setting.scale == "second_device" and (p.device is None or len(p.device.pose) < 3):
            raise ArgumentError("the scale of a second device needs its positions at three or more poses", "device")
        if setting.late and (p.rates is None or not np.ptp(p.rates) > 0):
            raise ArgumentError(
                "the delay can only be estimated while the robot moves; provide actuator rates of several speeds",
                "rates",
            )
        hold, camera_held = held_by_default(robot, setting)
        side = robot_side(robot, Choice(fixed=[*hold, *setting.fixed]))
        on_tool = setting.mounted == "fixed"
        if side.turns and not on_tool:
            raise ArgumentError(
                "starting values for cameras on a plate that rotates are not implemented; use fixed cameras",
                "mounted",
            )
        poses = side.start(p.actuators)
        if p.device is not None and len(p.device.pose):
            _require_near(p.device, poses[p.device.pose, :3])
        lenses = np.array([by_name[n].start for n in p.cameras])
        known = np.array([by_name[n].focal_pixel is not None for n in p.cameras])
        start = camera_starts(p, poses[:, :3] if on_tool else -poses[:, :3], lenses, known)
        target = target_start(p, start, poses, on_tool, setting.scale == "target")
        if on_tool and not side.turns:  # the tool centre point is the target's origin
            start[:, 13:], target[4:7] = start[:, 13:] - target[4:7], 0.0
        values = {"camera": start, "target": target[None], "robot": side.unknowns.start[None], "pose": poses}
        held = {name for group, entries in INTRINSICS.items() if group not in setting.estimate for name in entries}
        fixed = np.array(
            [[n in held or n == "k3" for n in (*CAMERA[:TURN], *["turn"] * 3, *CAMERA[13:])]] * len(p.cameras)
        )
        tool_centre = on_tool and not side.turns
        if not on_tool and not side.turns:
            fixed[0, 12:] = True
        if camera_held:
            fixed[0, 9:] = True
        target_fixed = np.array([False] * 3 + [tool_centre] * 3 + [setting.scale == "target"])
        return cls(side, setting, values, fixed, target_fixed, tuple(p.cameras), len(p))

    def corner_residuals(self, p: RobotPictures) -> np.ndarray:
        """Return residuals (n, 2) [pixel] at the starting values, infinite for corners that cannot be projected."""
        e = corner_residuals(p, self.start, self.start["pose"], self.side, self.setting.mounted == "fixed")
        return np.where(np.isfinite(e), e, np.inf)

    def fit(
        self, p: RobotPictures, *, values: dict[str, np.ndarray] | None = None, noise: float | None = None,
        limit: int = 100, covariance: bool = True, stop: Callable[[], bool] | None = None,
    ) -> BundleFit:  # fmt: skip
        """Fit the bundle to these corners; with `noise`, in units of sigma, by Huber's loss for this noise."""
        v, side, on_tool = values or self.start, self.side, self.setting.mounted == "fixed"
        n, q = len(p.poses), p.actuators
        pose_labels = ["x", "y", "z", "qw", "qx", "qy", "qz"][: side.pose_size]
        groups = [
            UnknownGroup("camera", v["camera"], CAMERA, self.names, turn=TURN, fixed=self.camera_fixed,
                         units=CAMERA_UNITS),
            UnknownGroup("target", v["target"], TARGET, turn=0, fixed=self.target_fixed,
                         units=("rad",) * 3 + ("m",) * 3 + ("1",)),
            UnknownGroup("robot", v["robot"], side.unknowns.names, units=side.unknowns.units),
            UnknownGroup("pose", v["pose"], pose_labels, [f"pose {k}" for k in p.poses], local=True,
                         turn=3 if side.turns else None),
        ]  # fmt: skip
        side.require_all_links(v["robot"][0], v["pose"], q, self.setting.actuator_noise)
        sees: list[tuple[str, ArrayLike]] = [("robot", 0), ("pose", np.arange(n))]
        data = q
        if self.setting.late:
            assert p.rates is not None
            groups.append(UnknownGroup("clock", v.get("clock", np.zeros((1, 1))), ["delay"], units=("s",)))
            sees.insert(1, ("clock", 0))
            data = np.column_stack([q, p.rates])
        blocks = [
            ResidualBlock(
                "corners", corner_function(side.pose_size, on_tool),
                [("camera", p.camera), ("target", 0), ("pose", p.pose)], np.column_stack([p.target[p.mark], p.uv]),
                sigma=p.sigma, loss="linear" if noise is None else "huber", width=HUBER * (noise or 1.0),
            ),
            ResidualBlock("links", links_function(side.residual, self.setting.actuator_noise, self.setting.late),
                          sees, data, sigma=1.0),
        ]  # fmt: skip
        if p.device is not None and len(p.device.pose):
            frame = v.get("device")
            if frame is None:
                t, R, _ = aligned(p.device.T, v["pose"][p.device.pose, :3])
                frame = np.concatenate([quaternion_of(R), t])[None]
            groups.append(UnknownGroup("device", frame, TARGET[:7], turn=0, units=("rad",) * 3 + ("m",) * 3))
            f, seen_by = device_function(side.pose_size), [("device", 0), ("pose", p.device.pose)]
            blocks.append(ResidualBlock("device", f, seen_by, p.device.T, sigma=p.device.noise))
        return bundle_fit(groups, blocks, motions=redundancies(side, q, on_tool), limit=limit, covariance=covariance,
                          stop=stop)  # fmt: skip

    def joint(self, robust: RobustFit) -> JointFit:
        """Return the result."""
        return JointFit(
            robust.fit, self.side, self.setting, robust.pictures, robust.wrong_pictures, robust.wrong_corners,
            robust.wrong_poses, self.first,
        )  # fmt: skip


def _require_near(device: SecondDevice, here: np.ndarray) -> None:
    """Raise ArgumentError if no rotation and translation maps the second device's positions close to `here` (k, 3) [m],
    the positions of the uncalibrated robot."""
    off, spread = aligned(device.T, here)[2], float(np.sqrt(np.mean(np.sum((here - here.mean(axis=0)) ** 2, axis=1))))
    if off > FAR * spread:
        beyond = degrees_of_freedom(len(here), free_frame=True)
        best = compared(off, [mirrored("device", 3)], lambda r: aligned(r(device.T), here)[2], beyond, nearer=NEARER)
        turned = best.suspicion(
            f"no rotation brings it closer than {length(off)} rms, but it is within", length(best.left)
        )
        hint = "check their unit and the poses that they belong to" if best.passed else turned.evidence
        raise ArgumentError(
            f"positions of the second device deviate by {off:.3g} m from those of the robot in the best frame; their "
            f"spread is {spread:.3g} m; {hint}",
            "device",
        )


def held_out_pixels(joint: JointFit, pictures: RobotPictures) -> np.ndarray:
    """Return residuals (n, 2) [pixel] of held-out pictures, at the poses predicted by the calibrated robot."""
    values = joint.fit.values
    q = pictures.actuators if pictures.rates is None else pictures.actuators + joint.delay * pictures.rates
    poses = joint.side.forward(values["robot"][0], q, joint.side.start(q))
    return corner_residuals(pictures, values, poses, joint.side, joint.setting.mounted == "fixed")


def corner_residuals(
    p: RobotPictures, values: Mapping[str, np.ndarray], poses: np.ndarray, side: RobotLinks, on_tool: bool
) -> np.ndarray:
    """Return predicted minus measured corners (n, 2) [pixel] of a target at these poses."""
    f, n = corner_function(side.pose_size, on_tool), len(p)
    columns = [values["camera"][p.camera].T, np.repeat(values["target"].T, n, axis=1), poses[p.pose].T,
               np.column_stack([p.target[p.mark], p.uv]).T]  # fmt: skip
    return np.asarray(f.map(n)(*columns)[0]).T
