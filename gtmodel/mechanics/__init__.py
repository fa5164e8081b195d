"""Mechanical parts written in the language.

Connectors: PointFrame, Frame, Flange, Shaft. World holds gravity; Ground, Anchor, FixedFlange, FixedShaft stand still.
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .anchors import Anchor as Anchor, FixedFlange as FixedFlange, FixedShaft as FixedShaft, Ground as Ground
    from .attitude import (
        AnyQuaternion as AnyQuaternion,
        Attitude as Attitude,
        UnitQuaternion as UnitQuaternion,
        ZYZAngles as ZYZAngles,
    )
    from .ball_screw import BallScrew as BallScrew
    from .bodies import FreeBody as FreeBody, LinkBody as LinkBody, PointMass as PointMass, RigidBody as RigidBody
    from .drive import Gear as Gear, Inertia as Inertia, Mass as Mass, RackAndPinion as RackAndPinion
    from .end_stop import EndStop as EndStop
    from .fixed import Fixed as Fixed, FixedTranslation as FixedTranslation, PointOnFrame as PointOnFrame
    from .frames import Flange as Flange, Frame as Frame, PointFrame as PointFrame, Shaft as Shaft, World as World
    from .friction import (
        DirectionalPiecewiseLinearFriction as DirectionalPiecewiseLinearFriction,
        DirectionalSignFriction as DirectionalSignFriction,
        DirectionalTanhFriction as DirectionalTanhFriction,
        Friction as Friction,
        Frictionless as Frictionless,
        PiecewiseLinearFriction as PiecewiseLinearFriction,
        SignFriction as SignFriction,
        StictionFriction as StictionFriction,
        StribeckFriction as StribeckFriction,
        TanhFriction as TanhFriction,
    )
    from .friction_rotational import (
        RotationalDirectionalPiecewiseLinearFriction as RotationalDirectionalPiecewiseLinearFriction,
        RotationalDirectionalTanhFriction as RotationalDirectionalTanhFriction,
        RotationalFriction as RotationalFriction,
        RotationalPiecewiseLinearFriction as RotationalPiecewiseLinearFriction,
        RotationalSignFriction as RotationalSignFriction,
        RotationalStictionFriction as RotationalStictionFriction,
        RotationalStribeckFriction as RotationalStribeckFriction,
        RotationalTanhFriction as RotationalTanhFriction,
    )
    from .guideway import CompliantGuideway as CompliantGuideway, Guideway as Guideway
    from .guideway_curves import (
        CurvedGuideway as CurvedGuideway,
        PiecewiseLinearCyclicGuideway as PiecewiseLinearCyclicGuideway,
        PiecewiseLinearGuideway as PiecewiseLinearGuideway,
        SplineGuideway as SplineGuideway,
    )
    from .guideway_measured import MeasuredGuideway as MeasuredGuideway
    from .guideway_saddle import SaddleGuideway as SaddleGuideway
    from .joints import Prismatic as Prismatic, Revolute as Revolute, Spherical as Spherical, Universal as Universal
    from .load import AppliedLoad as AppliedLoad, FrameLoad as FrameLoad, PointLoad as PointLoad
    from .loops import LoopClosure as LoopClosure, PlanarLoopClosure as PlanarLoopClosure
    from .motor import ForceMotor as ForceMotor, GearedMotor as GearedMotor, TorqueMotor as TorqueMotor
    from .placements import (
        FixedDH as FixedDH,
        FixedModifiedDH as FixedModifiedDH,
        FixedRpy as FixedRpy,
    )
    from .plane import Plane as Plane
    from .plate import RigidPlate as RigidPlate
    from .rod import ElasticRod as ElasticRod, MidpointRod as MidpointRod, Rod as Rod, UniformRod as UniformRod
    from .spring_damper import (
        FlangeSpringDamper as FlangeSpringDamper,
        PointSpringDamper as PointSpringDamper,
        ShaftSpringDamper as ShaftSpringDamper,
        SpringDamper as SpringDamper,
    )
    from .strut import Strut as Strut
    from .wrist import Wrist as Wrist, WristAxis as WristAxis

public(__name__)
