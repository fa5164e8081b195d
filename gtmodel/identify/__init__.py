"""Identification of dynamics from motion: regressors, simulated logs, weighted least squares with honest confidence."""

from .regressor import Regressor, RegressorRows

__all__ = ["Regressor", "RegressorRows"]
