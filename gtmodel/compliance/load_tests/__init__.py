"""Joint stiffness of a serial arm from static load tests.

stiffness_study, StiffnessStudy   both methods, what they are worth, and doubts about the tests
Setup, Noise, GravityCompensator  the arm's tool, method, noise and spring
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
