"""Bundle adjustment: least squares with local unknowns (poses, points, patterns), which are eliminated.

Problem
    UnknownGroup    unknowns of one kind, one instance per row; unit quaternions change by rotation vectors
    ResidualBlock   residuals of one kind: a CasADi function, and the unknowns on which each observation depends
    GaugeMotion     a common motion that may leave all residuals unchanged, with its name and remedy
Fit
    bundle_fit      Gauss-Newton on the Schur complement -> BundleFit
    BundleFit       values, residuals, Estimate of the shared unknowns, covariances of the local ones
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .fit import BundleFit as BundleFit, bundle_fit as bundle_fit
    from .residual_block import ResidualBlock as ResidualBlock, UnknownGroup as UnknownGroup
    from .undetermined import GaugeMotion as GaugeMotion

public(__name__)
