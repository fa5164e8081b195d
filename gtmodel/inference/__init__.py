"""What data say of parameters, for every engine that fits: numbers in, an Estimate and its worth out. Knows no model.

Fits
    linear_fit, nonlinear_fit   least squares with weights, bounds or losses, priors -> Estimate
    Prior                       knowledge of a parameter before the data
Worth
    identifiability             rank, null space in words, dependencies, standard deviations, O1 to O5
    dependencies, observability its parts
    newey_west, decimated, block_bootstrap   covariance under coloured residuals
    whiteness, normality, noise_size, cross_validation   what residuals say
    held_out_ratio, freedom_of  what a sound model has of held-out over fitted errors; FALSE_ALARM of verdicts
Proof
    monte_carlo                 runs by seed in parallel processes
    coverage, binomial_band     do intervals hold the truth as often as they say
"""

from .covariance import automatic_lag, block_bootstrap, correlation_time, decimated, fixed_b, newey_west, white
from .coverage import Coverage, binomial_band, coverage
from .dependencies import Dependencies, dependencies
from .held_out import FALSE_ALARM, HeldOut, freedom_of, held_out_ratio
from .identifiability import Direction, Identifiability, identifiability
from .least_squares import linear_fit
from .monte_carlo import MonteCarlo, monte_carlo
from .nonlinear import NonlinearFit, nonlinear_fit
from .observability import Observability, observability
from .residuals import (
    CrossValidation,
    Verdict,
    alternate,
    autocorrelation,
    contiguous,
    cross_validation,
    noise_size,
    normality,
    whiteness,
)
from .weighting import Prior, Weighting, weighting

__all__ = [
    "FALSE_ALARM", "Coverage", "CrossValidation", "Dependencies", "Direction", "HeldOut", "Identifiability",
    "MonteCarlo", "NonlinearFit", "Observability", "Prior", "Verdict", "Weighting", "alternate", "autocorrelation",
    "automatic_lag", "binomial_band", "block_bootstrap", "contiguous", "correlation_time", "coverage",
    "cross_validation", "decimated", "dependencies", "fixed_b", "freedom_of", "held_out_ratio", "identifiability",
    "linear_fit", "monte_carlo", "newey_west", "noise_size", "nonlinear_fit", "normality", "observability",
    "weighting", "white", "whiteness",
]  # fmt: skip
