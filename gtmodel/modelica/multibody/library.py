"""Built-in texts for Modelica.Mechanics; MultiBody is always the built-in one, even if a library contains it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from .. import reader
from ..syntax import ClassText

HERE = "Modelica.Mechanics"
NAME = f"{HERE}.MultiBody"
_FILES = {"MultiBody": "multibody.mo", "Rotational": "mechanics.mo", "Translational": "mechanics.mo"}
_OWN = str(Path(__file__).with_name("multibody.mo"))
NAMES = frozenset(_FILES)
_SHAPE = "shapeType r_shape lengthDirection widthDirection length width height extra color specularCoefficient"
_AXIS = "animation cylinderLength cylinderDiameter cylinderColor specularCoefficient"
_BODY = "animation sphereDiameter sphereColor cylinderDiameter cylinderColor specularCoefficient"
_STATES = "useQuaternions sequence_angleStates"
_LINE = (
    "animation showMass width coilWidth numberOfWindings color massDiameter massColor lengthDirection_a diameter_a "
    "length_a diameter_b length_b color_a color_b specularCoefficient lengthFraction fixedRotationAtFrame_a "
    "fixedRotationAtFrame_b s_small"
)
# parameters for animation, or for the selection of states
_PICTURES = {
    "World": "enableAnimation animateWorld animateGravity animateGround label1 label2 axisLength axisDiameter "
    "axisShowLabels axisColor_x axisColor_y axisColor_z gravityArrowTail gravityArrowLength gravityArrowDiameter "
    "gravityArrowColor gravitySphereDiameter gravitySphereColor groundAxis_u groundLength_u groundLength_v groundColor "
    "nominalLength defaultAxisLength defaultJointLength defaultJointWidth defaultForceLength defaultForceWidth "
    "defaultBodyDiameter defaultArrowDiameter defaultFrameDiameterFraction defaultSpecularCoefficient defaultN_to_m "
    "defaultNm_to_m driveTrainMechanics3D mu",
    "Joints.Revolute": _AXIS,
    "Joints.Universal": _AXIS,
    "Joints.RevolutePlanarLoopConstraint": _AXIS,
    "Joints.Prismatic": "animation boxWidthDirection boxWidth boxHeight boxColor specularCoefficient",
    "Joints.Spherical": f"animation sphereDiameter sphereColor specularCoefficient {_STATES}",
    "Parts.Fixed": f"animation {_SHAPE}",
    "Parts.FixedTranslation": f"animation {_SHAPE}",
    "Parts.FixedRotation": f"animation {_SHAPE}",
    "Parts.Body": f"{_BODY} {_STATES}",
    "Parts.BodyShape": f"animateSphere {_BODY} {_SHAPE} {_STATES}",
    "Parts.BodyBox": f"animation color specularCoefficient {_STATES}",
    "Parts.BodyCylinder": f"animation color specularCoefficient {_STATES}",
    "Forces.WorldForce": "animation color specularCoefficient diameter N_to_m",
    "Forces.WorldTorque": "animation color specularCoefficient diameter Nm_to_m",
    "Forces.WorldForceAndTorque": "animation forceColor torqueColor specularCoefficient N_to_m Nm_to_m forceDiameter "
    "torqueDiameter",
    "Forces.Spring": _LINE,
    "Forces.Damper": _LINE,
    "Forces.SpringDamperParallel": _LINE,
    "Sensors.AbsolutePosition": "animation",
    "Sensors.AbsoluteVelocity": "animation",
    "Sensors.AbsoluteAngularVelocity": "animation",
    "Visualizers.FixedShape": f"animation {_SHAPE}",
    "Visualizers.FixedFrame": "animation showLabels length diameter color_x color_y color_z specularCoefficient",
}  # fmt: skip


def own_text(package: str, name: str, there: bool) -> ClassText | None:
    """Return the built-in text of a class in Modelica.Mechanics; None for other names.

    there: whether a library contains the class; then only MultiBody is built in.
    """
    if package != HERE or name not in _FILES or (there and name != "MultiBody"):
        return None
    return next(text for text in _read(_FILES[name]) if text.name == name)


@cache
def _read(file: str) -> list[ClassText]:
    classes = reader.read(Path(__file__).with_name(file))
    package = ClassText(classes[0].at, HERE, "package")
    for text in classes:
        text.scope = package
    return classes


def is_own(path: str) -> bool:
    """True for the path of the built-in MultiBody file."""
    return path == _OWN


def part_name(text: ClassText) -> str:
    """Return the name of a built-in MultiBody class, such as "Joints.Revolute"; "" for other classes."""
    if not is_own(text.at.source.path) or not text.full_name.startswith(f"{NAME}."):
        return ""
    return text.full_name.removeprefix(f"{NAME}.")


def pictures(text: ClassText) -> set[str]:
    """Return the parameters of a built-in MultiBody class that are accepted and ignored."""
    return set(_PICTURES.get(part_name(text), "").split())


def refusal(space: str, name: str) -> str:
    """Return why MultiBody has no class of this name, with the available ones; "" outside of MultiBody."""
    if (space != NAME and not space.startswith(f"{NAME}.")) or space.startswith(f"{NAME}.Examples"):
        return ""
    return f"{space}.{name} is not supported; the supported MultiBody classes are {', '.join(_PICTURES)}"
