"""Least squares with local unknowns: poses, points or patterns that only some residuals see are eliminated.

Problem
    UnknownGroup    unknowns of one kind, one instance per row; unit quaternions move by rotation vectors
    ResidualBlock   residuals of one kind, as one CasADi function with the unknowns each of them sees
    GaugeMotion     a motion of everything that residuals may not notice, with its name and remedy
Fit
    bundle_fit      Gauss-Newton on the Schur complement -> BundleFit
    BundleFit       values, residuals, the Estimate of what is shared, covariances of what is local
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .fit import BundleFit as BundleFit, bundle_fit as bundle_fit
    from .residual_block import ResidualBlock as ResidualBlock, UnknownGroup as UnknownGroup
    from .undetermined import GaugeMotion as GaugeMotion

public(__name__)
