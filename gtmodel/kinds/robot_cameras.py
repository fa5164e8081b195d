"""Kind "robot_cameras": joint calibration of a robot and its cameras, or placement of two cameras."""

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
    """Black squares on the tool; give their layout, or an example layout is used."""

    kind: Literal["five_squares"] = Field(description="kind of target")


@made_from(targets.Chessboard)
class ChessboardSection(Made):
    """A chessboard; its marks are the inner corners."""

    kind: Literal["chessboard"] = Field(description="kind of target")


@made_from(targets.Charuco)
class CharucoSection(Made):
    """A chessboard with coded marks."""

    kind: Literal["charuco"] = Field(description="kind of target")


class PicturesSection(FileSection):
    """Detected corners, and actuator readings in the same poses."""

    corners: str = Field(
        description="CSV: camera, pose, mark, u, v and, if known, sigma; path from the problem's folder"
    )
    actuators: str = Field(
        description="CSV: pose, each actuator and, for a moving robot, rate1 ...; path from the problem's folder"
    )
    unit: str = Field(default="mm", description="unit of the actuator columns")
    sigma_pixel: PositiveFloat = Field(default=0.1, description="standard deviation of a corner without a column sigma")
    second_device: str | None = Field(
        default=None,
        description="CSV: pose, x, y, z in `unit`, positions from a second device; path from the problem's folder",
    )
    second_device_noise_um: PositiveFloat = Field(
        default=10.0, description="standard deviation of each coordinate of the second device"
    )
    source: Source = ""


class Schema(RobotProblem):
    """Joint calibration of a robot and its cameras or, with [places], the best placement of two cameras. The images are
    in [pictures] or in [synthetic]."""

    pictures: PicturesSection | None = Field(default=None, description="measured images")
    target: Annotated[FiveSquaresSection | ChessboardSection | CharucoSection, Field(discriminator="kind")] | None = (
        Field(default=None, description="target in the images of [pictures]")
    )
    camera: list[Made[options.CameraStart]] = Field(
        default=[],
        description="start values, one table [[camera]] for each; if left out, only the synthetic image size is known",
    )
    synthetic: Made[options.SyntheticRobotCameras] | None = Field(default=None, description="synthetic images")
    calibration: Made[options.RobotCameras] = Made[options.RobotCameras].left_out()
    places: Made[options.CameraPlaces] | None = Field(
        default=None, description="placements of two cameras to compare, for [synthetic]"
    )
    held_out_every: int = Field(default=2, ge=2, description="hold out every n-th pose")
    two_steps: bool = Field(default=False, description="also fit in two steps, with triangulation first, to compare")
    accuracy_mm: PositiveFloat | None = Field(
        default=None, description="largest mean error of held-out synthetic positions, or rms of the best placement"
    )


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
    """Return the call of the study of the images or of the placements."""
    if context.start is not None:
        raise InputError("--start: the calibration starts from the images; leave it out")
    _one_source(problem)
    robot = problem.model(context)
    accuracy = None if problem.accuracy_mm is None else 1e-3 * problem.accuracy_mm
    setting = problem.calibration.options()
    if problem.places is not None:
        assert problem.synthetic is not None
        scene, places = options_of(problem, "synthetic", "places").values()
        return Call(robot_cameras.places_study, robot, scene, places, setting, accuracy=accuracy, title=problem.title)
    cameras = options_of(problem, "camera")["camera"]
    pictures = _pictures(problem, context) if problem.synthetic is None else problem.synthetic.options()
    return Call(
        robot_cameras.study, robot, pictures, cameras, setting, held_out=problem.held_out_every,
        two_steps=problem.two_steps, accuracy=accuracy, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the images, the unknowns and the source of the scale."""
    _one_source(problem)
    setting = problem.calibration.options()
    name = problem.heading
    if problem.places is not None:
        places = problem.places.options()
        number = len(places.baselines) * len(places.distances)
        return f"{name}: {number} placements of two cameras, compared by the errors after a calibration"
    if problem.synthetic is not None:
        lines = [f"{name}: {problem.synthetic.options().words}"]
    else:
        p = _pictures(problem, context)
        lines = [f"{name}: {len(p)} corners in {len(p.poses)} poses and the cameras {', '.join(p.cameras)}"]
    estimated = ", ".join(w.replace("_", " ") for w in setting.estimate) or "nothing"
    lines.append(f"  cameras: {estimated} estimated; {setting.mounted}")
    lines.append(f"  scale from: {setting.scale.replace('_', ' ')}")
    return "\n".join(lines)


def _one_source(problem: Schema) -> None:
    """Raises InputError if the tables contradict each other."""
    if (problem.pictures is None) == (problem.synthetic is None):
        present = "both" if problem.pictures is not None else "neither"
        raise InputError(f"expected one of [pictures] and [synthetic]; found {present}", "pictures")
    if problem.places is not None and problem.synthetic is None:
        raise InputError("needs [synthetic], with volume, target and noise", "places")
    if problem.pictures is not None and problem.target is None:
        raise InputError("is missing; describe the target in the images", "target")
    if problem.pictures is not None and not problem.camera:
        raise InputError("is missing; give [[camera]] with name and image size", "camera")
    if problem.synthetic is not None and problem.target is not None:
        raise InputError("belongs to [pictures]; synthetic images show five squares", "target")


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
