"""The 4 ms loop and its peers: EGM and RSI in Python, simulated controllers and plants, the loop's twin.

study: the loop of a generated folder against a simulated controller, its law off and on -> LoopStudy.

Build and run: build -> program, LoopProcess, lockstep, real_time. Peers: RobotSide with a DrivePlant or a
RigidBodyPlant, either in an ElasticPlant; Channel with Faults. The loop in Python: Twin with one of the laws. All of it
was tested against simulators only.
"""

from .build import build
from .exchange import Command, Exchange, Feedback
from .faults import Channel, Faults, expected_counters
from .laws import DynamicsLaw, PathLaw, ReplayLaw, TrajectoryLaw
from .loop_study import LoopStudy, study
from .plant import DrivePlant, ElasticPlant, RigidBodyPlant, Servo
from .process import LoopError, LoopProcess
from .robot_side import RobotSide
from .rsi_configuration import rsi_configuration
from .run import Run, lockstep, real_time
from .table import Table
from .twin import Limits, Settings, Twin

__all__ = [
    "Channel", "Command", "DrivePlant", "DynamicsLaw", "ElasticPlant", "Exchange", "Faults", "Feedback", "Limits",
    "LoopError", "LoopProcess", "LoopStudy", "PathLaw", "ReplayLaw", "RigidBodyPlant", "RobotSide", "Run", "Servo",
    "Settings", "Table", "TrajectoryLaw", "Twin", "build", "expected_counters", "lockstep", "real_time",
    "rsi_configuration", "study",
]  # fmt: skip
