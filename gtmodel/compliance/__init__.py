"""How a robot gives way under load. Knows no robot.

study                stiffness, deflection and frequencies over a section: `ComplianceStudy`
Springs, Links, Carts, Frame, Arm, Load, Map   what it is asked for

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
from .options import Arm, Carts, Frame, Links, Load, Map, Springs
from .selection import Selection, select
from .static_tests import StaticTests, at_tool
from .synthetic import synthetic_tests

__all__ = [
    "GROUPS",
    "Arm",
    "ArmPoses",
    "Carts",
    "Compensator",
    "ComplianceStudy",
    "Frame",
    "LinkGeometry",
    "LinkMasses",
    "LinkPoses",
    "LinkSprings",
    "LinkStructure",
    "Links",
    "Load",
    "Map",
    "Selection",
    "Springs",
    "StaticTests",
    "StiffnessFit",
    "arm_poses",
    "at_tool",
    "cartesian_stiffness",
    "complementary_stiffness",
    "complete_pose",
    "decoupled",
    "select",
    "softest_and_stiffest",
    "study",
    "synthetic_tests",
    "translational_compliance",
    "tube",
    "with_compensator",
]  # fmt: skip
