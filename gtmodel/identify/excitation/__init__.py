"""Excitation: the most informative motion within all limits for identifying masses and friction of a robot."""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .basis import Basis as Basis, ClosedSpline as ClosedSpline, FourierSeries as FourierSeries
    from .information import (
        CRITERIA as CRITERIA,
        Criterion as Criterion,
        condition as condition,
        predicted_deviations as predicted_deviations,
        singular_values as singular_values,
    )
    from .options import (
        ExcitationSearch as ExcitationSearch,
        ExcitationStudy as ExcitationStudy,
        Family as Family,
        IdentificationExperiment as IdentificationExperiment,
        MonteCarloFits as MonteCarloFits,
        RandomMotions as RandomMotions,
    )
    from .search import (
        FINER as FINER,
        Excitation as Excitation,
        optimise_excitation as optimise_excitation,
        random_excitations as random_excitations,
    )
    from .study import excitation_study as excitation_study
    from .task import ExcitationTask as ExcitationTask

public(__name__)
