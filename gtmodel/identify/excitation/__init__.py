"""Excitation: the motion from which a robot's masses and friction are identified best, within all limits."""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .basis import Basis as Basis, ClosedSpline as ClosedSpline, FourierSeries as FourierSeries
    from .excited import ExcitationStudy as ExcitationStudy
    from .information import (
        CRITERIA as CRITERIA,
        Criterion as Criterion,
        condition as condition,
        predicted_deviations as predicted_deviations,
        singular_values as singular_values,
    )
    from .optimise import (
        FINER as FINER,
        Excitation as Excitation,
        optimise_excitation as optimise_excitation,
    )
    from .options import (
        ExcitationSearch as ExcitationSearch,
        Family as Family,
        IdentificationExperiment as IdentificationExperiment,
        MonteCarloFits as MonteCarloFits,
        RandomMotions as RandomMotions,
    )
    from .random_motions import random_excitations as random_excitations
    from .sampled import ExcitationTask as ExcitationTask
    from .study import excitation_study as excitation_study

public(__name__)
