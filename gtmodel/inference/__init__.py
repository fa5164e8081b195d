"""Parameter estimation and statistics for all fits: arrays in, an Estimate with its uncertainty and tests out.

Nothing here depends on a model: functions take arrays, and names only for messages.

Fits
    linear_fit, nonlinear_fit   least squares with weights, bounds or losses, priors -> Estimate
    linear_fits                 many measurements with the same matrix, which is factored once
    random_walk_fit             readings whose bias performs a random walk of unknown size
    bundle                      nonlinear fits with many local unknowns, poses or points, which are eliminated
    Prior                       prior value of a parameter with its standard deviation
Quality
    identifiability             rank, null space in words, dependencies, standard deviations, O1 to O5
    dependencies, observability its parts
    newey_west, decimated, block_bootstrap   covariance under coloured residuals
    whiteness, normality, noise_size, cross_validation   tests of a model by its residuals
    held_out_ratio, freedom_of  test of held-out against fitted errors; FALSE_ALARM of verdicts
    over_noise, chi_squared_over_noise   test whether residuals exceed the stated noise, significantly and relevantly
    between_recordings          test whether recordings of the same machine have disjoint intervals
    chance_ratio                bound on the ratio of two rms errors of equal expected size
    nominal_sizes, negligible   sizes of parameters from nominal values; which of these are zero up to rounding
Monte Carlo
    monte_carlo                 runs by seed in parallel processes
    coverage, binomial_band     test whether intervals contain the truth as often as stated
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from . import bundle as bundle
    from .covariance import (
        automatic_lag as automatic_lag,
        block_bootstrap as block_bootstrap,
        correlation_time as correlation_time,
        decimated as decimated,
        fixed_b as fixed_b,
        negligible as negligible,
        newey_west as newey_west,
        nominal_sizes as nominal_sizes,
        white as white,
    )
    from .held_out import (
        FALSE_ALARM as FALSE_ALARM,
        BetweenRecordings as BetweenRecordings,
        HeldOut as HeldOut,
        OverNoise as OverNoise,
        between_recordings as between_recordings,
        chance_ratio as chance_ratio,
        chi_squared_over_noise as chi_squared_over_noise,
        freedom_of as freedom_of,
        held_out_ratio as held_out_ratio,
        over_noise as over_noise,
    )
    from .identifiability import (
        Dependencies as Dependencies,
        Direction as Direction,
        Identifiability as Identifiability,
        Observability as Observability,
        dependencies as dependencies,
        identifiability as identifiability,
        observability as observability,
    )
    from .least_squares import linear_fit as linear_fit, linear_fits as linear_fits
    from .monte_carlo import (
        Coverage as Coverage,
        MonteCarlo as MonteCarlo,
        binomial_band as binomial_band,
        coverage as coverage,
        monte_carlo as monte_carlo,
    )
    from .nonlinear import NonlinearFit as NonlinearFit, nonlinear_fit as nonlinear_fit
    from .random_walk import RandomWalkFit as RandomWalkFit, random_walk_fit as random_walk_fit
    from .residuals import (
        CrossValidation as CrossValidation,
        Verdict as Verdict,
        alternate as alternate,
        autocorrelation as autocorrelation,
        contiguous as contiguous,
        cross_validation as cross_validation,
        noise_size as noise_size,
        normality as normality,
        whiteness as whiteness,
    )
    from .weighting import Prior as Prior, Weighting as Weighting, weighting as weighting

public(__name__)
