"""Joint stiffness of a serial arm from static load tests.

stiffness_study, StiffnessStudy   both methods, intervals, and doubts about the tests
Setup, Noise, GravityCompensator  tool, method, noise and spring of the arm
MeasuredTests, read_load_tests, LoadTests, LoadTestColumn   tests in memory, and from a CSV file
made_load_tests, SyntheticTests   synthetic tests of an arm with known stiffness
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .options import (
        GravityCompensator as GravityCompensator,
        LoadTestColumn as LoadTestColumn,
        LoadTests as LoadTests,
        Noise as Noise,
        Setup as Setup,
        SyntheticTests as SyntheticTests,
    )
    from .reading import (
        MeasuredTests as MeasuredTests,
        made_load_tests as made_load_tests,
        read_load_tests as read_load_tests,
    )
    from .stiffness import StiffnessStudy as StiffnessStudy, stiffness_study as stiffness_study

public(__name__)
