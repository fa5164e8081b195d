"""How a robot gives way under load. Numbers in, an Estimate out; knows no robot.

arm_poses            places and Jacobians of an arm, from its equations
StaticTests          poses, loads and what the tool moved by
complete_pose        joint compliances from all six rows of the pose
decoupled            arm from the wrist centre, then wrist from the tool centre point
cartesian_stiffness, softest_and_stiffest   what joint compliances mean at the tool
complementary_stiffness, Compensator        what a load and a spring on joint 2 add
select               tests that tell the compliances best
synthetic_tests      made-up tests, with or without bearings that tilt
"""

from .arm_poses import ArmPoses, arm_poses
from .cartesian import cartesian_stiffness, softest_and_stiffest, translational_compliance
from .complementary import Compensator, complementary_stiffness
from .joint_stiffness import StiffnessFit, complete_pose, decoupled
from .selection import Selection, select
from .static_tests import StaticTests, at_tool
from .synthetic import synthetic_tests

__all__ = [
    "ArmPoses", "Compensator", "Selection", "StaticTests", "StiffnessFit", "arm_poses", "at_tool",
    "cartesian_stiffness", "complementary_stiffness", "complete_pose", "decoupled", "select", "softest_and_stiffest",
    "synthetic_tests", "translational_compliance",
]  # fmt: skip
