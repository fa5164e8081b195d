"""Deflection of robots under load. Knows no robot.

study                stiffness, deflection and frequencies over a section: `ComplianceStudy`
Springs, RodSprings, CartSprings, FrameSprings, ArmSprings, Load, ComplianceMap   its options
stiffness_study      joint stiffness of an arm from static load tests: `StiffnessStudy`; see `load_tests`
Setup, Noise, GravityCompensator   its options
MeasuredTests, read_load_tests, LoadTests, LoadTestColumn   measured tests
made_load_tests, SyntheticTests   synthetic tests

arm_poses            poses and Jacobians of an arm, from its equations
StaticTests          poses, loads and the displacement of the tool
complete_pose        joint compliances from all six rows of the pose
decoupled            arm from the wrist centre, then wrist from the tool centre point
cartesian_stiffness, translational_compliance, softest_and_stiffest   stiffness at the tool from joint compliances
complementary_stiffness, Compensator        stiffness added by a load and by a spring on joint 2
with_compensator     joint compliances and the rate of that spring
select               the tests that determine the compliances best
synthetic_tests      synthetic tests, with or without bearings that tilt
LinkGeometry, LinkPoses      links of a parallel robot and their motion per axis, from its equations
LinkSprings, tube    its springs in series: links, ball joints, drives, carts, frame
LinkStructure        compliance at the tool, link forces, deflection, and each spring group's share of the work
LinkMasses           weights and lowest natural frequencies on these springs
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .cartesian import (
        ArmPoses as ArmPoses,
        arm_poses as arm_poses,
        cartesian_stiffness as cartesian_stiffness,
        softest_and_stiffest as softest_and_stiffest,
        translational_compliance as translational_compliance,
    )
    from .compliance_study import study as study
    from .joint_stiffness import (
        Compensator as Compensator,
        LoadTestSelection as LoadTestSelection,
        StiffnessFit as StiffnessFit,
        complementary_stiffness as complementary_stiffness,
        complete_pose as complete_pose,
        decoupled as decoupled,
        select as select,
        with_compensator as with_compensator,
    )
    from .link_structure import (
        GROUPS as GROUPS,
        LinkGeometry as LinkGeometry,
        LinkPoses as LinkPoses,
        LinkSprings as LinkSprings,
        LinkStructure as LinkStructure,
        tube as tube,
    )
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
    from .load_tests.reading import synthetic_tests as synthetic_tests
    from .options import (
        ArmSprings as ArmSprings,
        CartSprings as CartSprings,
        ComplianceMap as ComplianceMap,
        ComplianceStudy as ComplianceStudy,
        FrameSprings as FrameSprings,
        Load as Load,
        RodSprings as RodSprings,
        Springs as Springs,
    )
    from .sprung_links import LinkMasses as LinkMasses
    from .static_tests import StaticTests as StaticTests, at_tool as at_tool

public(__name__)
