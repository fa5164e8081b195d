"""Kind "robot_cameras": a robot and its cameras calibrated together, or where two cameras are to stand."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat

from gtmodel.problem_files.base import Call, Context, FileSection, InputError, Source
from gtmodel.problem_files.from_options import Made, made_from, options_of
from gtmodel.problem_files.keys import RobotProblem
from gtmodel.vision import robot_cameras
from gtmodel.vision.detection import targets
from gtmodel.vision.robot_cameras import RobotPictures, options

RESULT = "gtmodel.vision.robot_cameras.RobotCamerasStudy"


@made_from(targets.FiveSquares)
class FiveSquaresSection(Made):
    """Black squares on the tool; their layout is an example unless given."""

    kind: Literal["five_squares"] = Field(description="which target")


@made_from(targets.Chessboard)
class ChessboardSection(Made):
    """A chessboard; its marks are the inner corners."""

    kind: Literal["chessboard"] = Field(description="which target")


@made_from(targets.Charuco)
class CharucoSection(Made):
    """A chessboard with coded marks."""

    kind: Literal["charuco"] = Field(description="which target")


class PicturesSection(FileSection):
    """Corners that were detected, and what the actuators read at the same poses."""

    corners: str = Field(
        description="CSV: camera, pose, mark, u, v and, where known, sigma; path from this file's folder"
    )
    actuators: str = Field(
        description="CSV: pose, each actuator, and rate1 ... of a moving robot; path from this file's folder"
    )
    unit: str = Field(default="mm", description="of the actuators' columns")
    sigma_pixel: PositiveFloat = Field(
        default=0.1, description="standard deviation of a corner where no column says it"
    )
    second_device: str | None = Field(
        default=None,
        description="CSV: pose, x, y, z in `unit`, positions by a second device; path from this file's folder",
    )
    second_device_noise_um: PositiveFloat = Field(default=10.0, description="of each of its coordinates")
    source: Source = ""


class Schema(RobotProblem):
    """A robot and its cameras calibrated together, or with [places] where two cameras will be worth most. One of
    [pictures] and [synthetic] says what is seen."""

    pictures: PicturesSection | None = Field(default=None, description="measured pictures")
    target: Annotated[FiveSquaresSection | ChessboardSection | CharucoSection, Field(discriminator="kind")] | None = (
        Field(default=None, description="whose marks the corners are; with [pictures]")
    )
    camera: list[Made[options.CameraStart]] = Field(
        default=[],
        description="one table [[camera]] for each, as known before; of synthetic ones the size alone if left out",
    )
    synthetic: Made[options.SyntheticRobotCameras] | None = Field(default=None, description="synthetic instead")
    calibration: Made[options.RobotCameras] = Made[options.RobotCameras].left_out()
    places: Made[options.CameraPlaces] | None = Field(
        default=None, description="a plan: places of two cameras to compare, with [synthetic]"
    )
    held_out_every: int = Field(default=2, ge=2, description="every how many-th pose no fit sees")
    two_steps: bool = Field(default=False, description="whether positions are intersected first too, for comparison")
    accuracy_mm: PositiveFloat | None = Field(
        default=None, description="greatest mean error of held-out synthetic positions, or rms of the best place"
    )


NAME = "robot_cameras"
ARGUMENTS = {
    "pictures": "synthetic", "corners": "pictures.corners", "actuators": "pictures.actuators", "unit": "pictures.unit",
    "cameras": "camera", "setting": "calibration", "scene": "synthetic", "held_out": "held_out_every",
    "accuracy": "accuracy_mm", "robot": "robot", "mounted": "calibration.mounted", "scale": "calibration.scale",
    "device": "pictures.second_device",
    "rates": "calibration.late", "late": "calibration.late",
    "size": "synthetic.size_m", "distance": "synthetic.distance_m",
    "poses": "synthetic.poses", "distances": "places.distances_m", "q": "robot",
    "actuator_noise": "calibration.actuator_noise_um",
}  # fmt: skip


def call(problem: Schema, context: Context) -> Call:
    """The study of the pictures, or of the places."""
    if context.start is not None:
        raise InputError("--start: cameras and robot start from what the pictures say; leave it out")
    _one_source(problem)
    robot = problem.model(context)
    accuracy = None if problem.accuracy_mm is None else 1e-3 * problem.accuracy_mm
    setting = problem.calibration.options()
    if problem.places is not None:
        assert problem.synthetic is not None
        scene, places = options_of(problem, "synthetic", "places").values()
        return Call(robot_cameras.places_study, robot, scene, places, setting, accuracy=accuracy, title=problem.title)
    cameras = options_of(problem, "camera")["camera"]
    seen = _pictures(problem, context) if problem.synthetic is None else problem.synthetic.options()
    return Call(
        robot_cameras.study, robot, seen, cameras, setting, held_out=problem.held_out_every,
        two_steps=problem.two_steps, accuracy=accuracy, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """What is seen, what is estimated, and what gives metres."""
    _one_source(problem)
    setting = problem.calibration.options()
    name = problem.title or NAME
    if problem.places is not None:
        places = problem.places.options()
        many = len(places.baselines) * len(places.distances)
        return f"{name}: {many} places of two cameras, by the errors that a calibration there will leave"
    if problem.synthetic is not None:
        lines = [f"{name}: {problem.synthetic.options().words}"]
    else:
        p = _pictures(problem, context)
        lines = [f"{name}: {len(p)} corners of {len(p.poses)} poses in {', '.join(p.cameras)}"]
    estimated = ", ".join(w.replace("_", " ") for w in setting.estimate) or "nothing"
    lines.append(f"  cameras: {estimated} estimated; {setting.mounted}")
    lines.append(f"  metres from: {setting.scale.replace('_', ' ')}")
    return "\n".join(lines)


def _one_source(problem: Schema) -> None:
    """Raises InputError where the tables contradict each other."""
    if (problem.pictures is None) == (problem.synthetic is None):
        given = "both" if problem.pictures is not None else "none of them"
        raise InputError(f"expected one of [pictures] and [synthetic]; found {given}", "pictures")
    if problem.places is not None and problem.synthetic is None:
        raise InputError("a plan needs [synthetic], which says volume, target and noise", "places")
    if problem.pictures is not None and problem.target is None:
        raise InputError("is missing; it says where the marks of the pictures are", "target")
    if problem.pictures is not None and not problem.camera:
        raise InputError("is missing; give [[camera]] with name and size of the picture", "camera")
    if problem.synthetic is not None and problem.target is not None:
        raise InputError("belongs to [pictures]; synthetic ones show five squares", "target")


def _pictures(problem: Schema, context: Context) -> RobotPictures:
    p = problem.pictures
    assert p is not None and problem.target is not None
    corners = context.file(p.corners, "pictures.corners", source=p.source)
    actuators = context.file(p.actuators, "pictures.actuators", source=p.source)
    device = None
    if p.second_device is not None:
        device = context.file(p.second_device, "pictures.second_device", source=p.source)
    return robot_cameras.read_pictures(
        corners, actuators, problem.target.options(), p.unit, p.sigma_pixel, device, 1e-6 * p.second_device_noise_um
    )
