"""Joint stiffness of a serial arm from static load tests.

stiffness_study, StiffnessStudy   both methods, what they are worth, and doubts about the tests
Setup, Noise, GravityCompensator  the arm's tool, method, noise and spring
MeasuredTests, read_load_tests, LoadTests, Column   tests in memory, and from a CSV file
made_load_tests, SyntheticTests   made-up tests of an arm with known stiffness
"""

from .options import Column, GravityCompensator, LoadTests, Noise, Setup, SyntheticTests
from .reading import MeasuredTests, made_load_tests, read_load_tests
from .stiffness import StiffnessStudy, stiffness_study

__all__ = [
    "Column", "GravityCompensator", "LoadTests", "MeasuredTests", "Noise", "Setup", "StiffnessStudy", "SyntheticTests",
    "made_load_tests", "read_load_tests", "stiffness_study",
]  # fmt: skip
