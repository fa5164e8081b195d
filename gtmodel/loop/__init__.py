"""The 4 ms control loop and its peers: EGM and RSI in Python, simulated controllers and plants, and the loop itself.

study: run the loop of a generated folder against a simulated controller, without and with its law -> LoopStudy; with
the law predictive beside computed torque -> PredictiveLoop; with the law lead_through a hand leads the tool over a
synthetic plate -> GuidedLoop.

Build and run: build -> program, LoopProcess, lockstep, real_time. Peers: RobotSide with a DrivePlant or a
RigidBodyPlant, optionally inside an ElasticPlant or a DisturbedPlant; Channel with Faults. The loop in Python:
PythonLoop with one of the laws. Everything was tested against simulators only.

Lead-through: GuidingLaw uses the Wrenches of two sensors; Guiding declares the law, its SensorNumbers and a
SyntheticScene, in which a SyntheticHand leads a ServoPlant over a plate (PlateScene).
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .build import build as build
    from .disturbed import Disturbances as Disturbances, DisturbedPlant as DisturbedPlant
    from .exchange import Command as Command, Exchange as Exchange, RobotFeedback as RobotFeedback
    from .laws import (
        DynamicsLaw as DynamicsLaw,
        PathLaw as PathLaw,
        ReferenceTable as ReferenceTable,
        ReplayLaw as ReplayLaw,
        TrajectoryLaw as TrajectoryLaw,
    )
    from .lead_through.law import GuidingLaw as GuidingLaw
    from .lead_through.options import (
        Guiding as Guiding,
        SensorNumbers as SensorNumbers,
        SyntheticHand as SyntheticHand,
        SyntheticScene as SyntheticScene,
    )
    from .lead_through.study import GuidedLoop as GuidedLoop, PlateScene as PlateScene, ServoPlant as ServoPlant
    from .loop_result import LoopStudy as LoopStudy
    from .loop_study import rsi_configuration as rsi_configuration, study as study
    from .plant import (
        DrivePlant as DrivePlant,
        ElasticPlant as ElasticPlant,
        RigidBodyPlant as RigidBodyPlant,
        Servo as Servo,
    )
    from .predictive_law import PredictiveLaw as PredictiveLaw
    from .predictive_result import PredictiveLoop as PredictiveLoop
    from .process import LoopError as LoopError, LoopProcess as LoopProcess
    from .python_loop import LoopLimits as LoopLimits, PythonLoop as PythonLoop, Settings as Settings
    from .robot_side import RobotSide as RobotSide
    from .run import (
        Channel as Channel,
        Faults as Faults,
        LoopRun as LoopRun,
        expected_counters as expected_counters,
        lockstep as lockstep,
        real_time as real_time,
    )
    from .wrenches import Wrench as Wrench

public(__name__)
