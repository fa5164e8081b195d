"""Excitation: the motion from which a robot's masses and friction are identified best, within all limits."""

from .basis import Basis, ClosedSpline, FourierSeries
from .excited import ExcitationStudy
from .information import CRITERIA, Criterion, condition, cost, predicted_deviations, singular_values
from .optimise import FINER, Excitation, ExcitationTask, optimise_excitation
from .options import Experiment, Family, MonteCarloFits, RandomMotions, Search
from .random_motions import random_excitations
from .study import excitation_study

__all__ = [
    "CRITERIA", "FINER", "Basis", "ClosedSpline", "Criterion", "Excitation", "ExcitationStudy", "ExcitationTask",
    "Experiment", "Family", "FourierSeries", "MonteCarloFits", "RandomMotions", "Search", "condition", "cost",
    "excitation_study", "optimise_excitation", "predicted_deviations", "random_excitations", "singular_values",
]  # fmt: skip
