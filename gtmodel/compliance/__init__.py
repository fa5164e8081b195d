"""How a robot deflects under load. Knows no robot.

study                stiffness, deflection and frequencies over a section: `ComplianceStudy`
Springs, RodSprings, CartSprings, FrameSprings, ArmSprings, Load, ComplianceMap   what it is asked for
stiffness_study      joint stiffness of an arm from static load tests: `StiffnessStudy`; see `load_tests`
Setup, Noise, GravityCompensator   what it is asked for
MeasuredTests, read_load_tests, LoadTests, LoadTestColumn   its tests, measured
made_load_tests, SyntheticTests   its tests, synthetic

arm_poses            poses and Jacobians of an arm, from its equations
StaticTests          poses, loads and the displacement of the tool
complete_pose        joint compliances from all six rows of the pose
decoupled            arm from the wrist centre, then wrist from the tool centre point
cartesian_stiffness, translational_compliance, softest_and_stiffest   what joint compliances mean at the tool
complementary_stiffness, Compensator        what a load and a spring on joint 2 add
with_compensator     joint compliances and the rate of that spring
select               the tests that determine the compliances best
synthetic_tests      synthetic tests, with or without bearings that tilt
LinkGeometry, LinkPoses      where the links of a parallel robot are, and how its axes move them, from its equations
LinkSprings, tube    its springs in series: links, ball joints, drives, carts, frame
LinkStructure        compliance at the tool, link forces, deflection, and the share of the work of each group of springs
LinkMasses           weights and lowest natural frequencies on these springs
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .arm_poses import ArmPoses as ArmPoses, arm_poses as arm_poses
    from .cartesian import (
        cartesian_stiffness as cartesian_stiffness,
        softest_and_stiffest as softest_and_stiffest,
        translational_compliance as translational_compliance,
    )
    from .compensated import with_compensator as with_compensator
    from .complementary import Compensator as Compensator, complementary_stiffness as complementary_stiffness
    from .compliance_result import ComplianceStudy as ComplianceStudy
    from .compliance_study import study as study
    from .joint_stiffness import StiffnessFit as StiffnessFit, complete_pose as complete_pose, decoupled as decoupled
    from .link_masses import LinkMasses as LinkMasses
    from .link_poses import LinkGeometry as LinkGeometry, LinkPoses as LinkPoses
    from .link_springs import GROUPS as GROUPS, LinkSprings as LinkSprings, tube as tube
    from .link_structure import LinkStructure as LinkStructure
    from .load_tests import (
        GravityCompensator as GravityCompensator,
        LoadTestColumn as LoadTestColumn,
        LoadTests as LoadTests,
        MeasuredTests as MeasuredTests,
        Noise as Noise,
        Setup as Setup,
        StiffnessStudy as StiffnessStudy,
        SyntheticTests as SyntheticTests,
        made_load_tests as made_load_tests,
        read_load_tests as read_load_tests,
        stiffness_study as stiffness_study,
    )
    from .options import (
        ArmSprings as ArmSprings,
        CartSprings as CartSprings,
        ComplianceMap as ComplianceMap,
        FrameSprings as FrameSprings,
        Load as Load,
        RodSprings as RodSprings,
        Springs as Springs,
    )
    from .selection import LoadTestSelection as LoadTestSelection, select as select
    from .static_tests import StaticTests as StaticTests, at_tool as at_tool
    from .synthetic import synthetic_tests as synthetic_tests

public(__name__)
