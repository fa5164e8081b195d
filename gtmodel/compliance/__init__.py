"""How a robot gives way under load. Knows no robot.

study                stiffness, deflection and frequencies over a section: `ComplianceStudy`
Springs, Links, Carts, Frame, Arm, Load, Map   what it is asked for
stiffness_study      joint stiffness of an arm from static load tests: `StiffnessStudy`; see `load_tests`
Setup, Noise, GravityCompensator   what it is asked for
MeasuredTests, read_load_tests, LoadTests, Column, made_load_tests, SyntheticTests   its tests, read or made up

arm_poses            places and Jacobians of an arm, from its equations
StaticTests          poses, loads and what the tool moved by
complete_pose        joint compliances from all six rows of the pose
decoupled            arm from the wrist centre, then wrist from the tool centre point
cartesian_stiffness, softest_and_stiffest   what joint compliances mean at the tool
complementary_stiffness, Compensator        what a load and a spring on joint 2 add
with_compensator     joint compliances and the rate of that spring
select               tests that tell the compliances best
synthetic_tests      made-up tests, with or without bearings that tilt
LinkGeometry, LinkPoses      where a parallel robot's links stand, and what its axes move, from its equations
LinkSprings, tube    its springs in series: links, ball joints, drives, carts, frame
LinkStructure        compliance at the tool, link forces, deflection, and what takes the work
LinkMasses           weights and lowest natural frequencies on these springs
"""

from .arm_poses import ArmPoses, arm_poses
from .cartesian import cartesian_stiffness, softest_and_stiffest, translational_compliance
from .compensated import with_compensator
from .complementary import Compensator, complementary_stiffness
from .compliance_study import ComplianceStudy, study
from .joint_stiffness import StiffnessFit, complete_pose, decoupled
from .link_masses import LinkMasses
from .link_poses import LinkGeometry, LinkPoses
from .link_springs import GROUPS, LinkSprings, tube
from .link_structure import LinkStructure
from .load_tests import (
    Column,
    GravityCompensator,
    LoadTests,
    MeasuredTests,
    Noise,
    Setup,
    StiffnessStudy,
    SyntheticTests,
    made_load_tests,
    read_load_tests,
    stiffness_study,
)
from .options import Arm, Carts, Frame, Links, Load, Map, Springs
from .selection import Selection, select
from .static_tests import StaticTests, at_tool
from .synthetic import synthetic_tests

__all__ = [
    "GROUPS",
    "Arm",
    "ArmPoses",
    "Carts",
    "Column",
    "Compensator",
    "ComplianceStudy",
    "Frame",
    "GravityCompensator",
    "LinkGeometry",
    "LinkMasses",
    "LinkPoses",
    "LinkSprings",
    "LinkStructure",
    "Links",
    "Load",
    "LoadTests",
    "Map",
    "MeasuredTests",
    "Noise",
    "Selection",
    "Setup",
    "Springs",
    "StaticTests",
    "StiffnessFit",
    "StiffnessStudy",
    "SyntheticTests",
    "arm_poses",
    "at_tool",
    "cartesian_stiffness",
    "complementary_stiffness",
    "complete_pose",
    "decoupled",
    "made_load_tests",
    "read_load_tests",
    "select",
    "softest_and_stiffest",
    "stiffness_study",
    "study",
    "synthetic_tests",
    "translational_compliance",
    "tube",
    "with_compensator",
]  # fmt: skip
