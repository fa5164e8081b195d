"""Mechanical parts written in the language.

Connectors: PointFrame, Frame, Flange, Shaft. World holds gravity; Ground, Anchor, FixedFlange, FixedShaft stand still.
"""

from .anchors import Anchor, FixedFlange, FixedShaft, Ground
from .attitude import AnyQuaternion, Attitude, UnitQuaternion, ZYZAngles
from .ball_screw import BallScrew
from .bodies import FreeBody, PointMass, RigidBody
from .drive import Gear, Inertia, Mass, RackAndPinion
from .fixed import Fixed, FixedTranslation, PointOnFrame
from .frames import Flange, Frame, PointFrame, Shaft, World
from .friction import (
    DirectionalPiecewiseLinearFriction,
    DirectionalSignFriction,
    DirectionalTanhFriction,
    Friction,
    Frictionless,
    PiecewiseLinearFriction,
    SignFriction,
    StribeckFriction,
    TanhFriction,
)
from .friction_rotational import (
    RotationalDirectionalPiecewiseLinearFriction,
    RotationalDirectionalTanhFriction,
    RotationalFriction,
    RotationalPiecewiseLinearFriction,
    RotationalStribeckFriction,
    RotationalTanhFriction,
)
from .guideway import CompliantGuideway, Guideway
from .guideway_curves import CurvedGuideway, PiecewiseLinearCyclicGuideway, PiecewiseLinearGuideway, SplineGuideway
from .guideway_measured import MeasuredGuideway
from .guideway_saddle import SaddleGuideway
from .joints import Prismatic, Revolute, Spherical, Universal
from .load import FrameLoad, PointLoad
from .motor import ForceMotor, GearedMotor, TorqueMotor
from .plane import Plane
from .plate import RigidPlate
from .rod import ElasticRod, MidpointRod, Rod, UniformRod
from .spring_damper import FlangeSpringDamper, PointSpringDamper, ShaftSpringDamper, SpringDamper
from .strut import Strut
from .wrist import Wrist, WristAxis

__all__ = [
    "Anchor",
    "AnyQuaternion",
    "Attitude",
    "BallScrew",
    "CompliantGuideway",
    "CurvedGuideway",
    "DirectionalPiecewiseLinearFriction",
    "DirectionalSignFriction",
    "DirectionalTanhFriction",
    "ElasticRod",
    "Fixed",
    "FixedFlange",
    "FixedShaft",
    "FixedTranslation",
    "Flange",
    "FlangeSpringDamper",
    "ForceMotor",
    "Frame",
    "FrameLoad",
    "FreeBody",
    "Friction",
    "Frictionless",
    "Gear",
    "GearedMotor",
    "Ground",
    "Guideway",
    "Inertia",
    "Mass",
    "MeasuredGuideway",
    "MidpointRod",
    "PiecewiseLinearCyclicGuideway",
    "PiecewiseLinearFriction",
    "PiecewiseLinearGuideway",
    "Plane",
    "PointFrame",
    "PointLoad",
    "PointMass",
    "PointOnFrame",
    "PointSpringDamper",
    "Prismatic",
    "RackAndPinion",
    "Revolute",
    "RigidBody",
    "RigidPlate",
    "Rod",
    "RotationalDirectionalPiecewiseLinearFriction",
    "RotationalDirectionalTanhFriction",
    "RotationalFriction",
    "RotationalPiecewiseLinearFriction",
    "RotationalStribeckFriction",
    "RotationalTanhFriction",
    "SaddleGuideway",
    "Shaft",
    "ShaftSpringDamper",
    "SignFriction",
    "Spherical",
    "SplineGuideway",
    "SpringDamper",
    "StribeckFriction",
    "Strut",
    "TanhFriction",
    "TorqueMotor",
    "UniformRod",
    "UnitQuaternion",
    "Universal",
    "World",
    "Wrist",
    "WristAxis",
    "ZYZAngles",
]
