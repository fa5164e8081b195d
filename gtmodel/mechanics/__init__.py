"""Library of mechanical components.

Connectors: PointFrame, Frame, Flange, Shaft. World defines gravity; Ground, Anchor, FixedFlange, FixedShaft are fixed.
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .bodies import (
        AnyQuaternion as AnyQuaternion,
        Attitude as Attitude,
        FreeBody as FreeBody,
        LinkBody as LinkBody,
        PointMass as PointMass,
        RigidBody as RigidBody,
        RigidPlate as RigidPlate,
        UnitQuaternion as UnitQuaternion,
        ZYZAngles as ZYZAngles,
    )
    from .closures import LoopClosure as LoopClosure, PlanarLoopClosure as PlanarLoopClosure
    from .drives import (
        BallScrew as BallScrew,
        ForceMotor as ForceMotor,
        Gear as Gear,
        GearedMotor as GearedMotor,
        Inertia as Inertia,
        Mass as Mass,
        RackAndPinion as RackAndPinion,
        Strut as Strut,
        TorqueMotor as TorqueMotor,
    )
    from .forces import (
        AppliedLoad as AppliedLoad,
        EndStop as EndStop,
        FlangeSpringDamper as FlangeSpringDamper,
        FrameLoad as FrameLoad,
        PointLoad as PointLoad,
        PointSpringDamper as PointSpringDamper,
        ShaftSpringDamper as ShaftSpringDamper,
        SpringDamper as SpringDamper,
    )
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
    from .guideway import (
        CompliantGuideway as CompliantGuideway,
        CurvedGuideway as CurvedGuideway,
        Guideway as Guideway,
        MeasuredGuideway as MeasuredGuideway,
        PiecewiseLinearCyclicGuideway as PiecewiseLinearCyclicGuideway,
        PiecewiseLinearGuideway as PiecewiseLinearGuideway,
        Plane as Plane,
        SaddleGuideway as SaddleGuideway,
        SplineGuideway as SplineGuideway,
    )
    from .joints import (
        Cylindrical as Cylindrical,
        Planar as Planar,
        Prismatic as Prismatic,
        Revolute as Revolute,
        Screw as Screw,
        Spherical as Spherical,
        Universal as Universal,
    )
    from .placements import (
        Anchor as Anchor,
        Fixed as Fixed,
        FixedDH as FixedDH,
        FixedFlange as FixedFlange,
        FixedModifiedDH as FixedModifiedDH,
        FixedRpy as FixedRpy,
        FixedShaft as FixedShaft,
        FixedTranslation as FixedTranslation,
        Ground as Ground,
        PointOnFrame as PointOnFrame,
    )
    from .rod import ElasticRod as ElasticRod, MidpointRod as MidpointRod, Rod as Rod, UniformRod as UniformRod
    from .transmissions import BeltDrive as BeltDrive, GearPair as GearPair, Rack as Rack
    from .wrist import Wrist as Wrist, WristAxis as WristAxis

public(__name__)
