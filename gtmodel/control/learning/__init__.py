"""Iterative learning control: what a robot repeats it learns, how fast and how far is known before (Dressler 2012, 7).

Lifted           a linear map of whole signals with its adjoint; lifted, toeplitz, shifted, filtered, zero_phase,
                 symmetric, weighted, identity: such maps
LearningLaw      u(k+1) = Q (u(k) + L e(k)); simple_law: that of case 1; ramp_weights, input_window: of (7.12), (7.14)
largest_gain, spectral_radius, frequency_bound    how fast it converges: (7.16), (7.15), and in the frequency domain
delayed_lag, ACTUATORS, pulse_response, frequency_response    plants, (6.11) among them
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .contraction import (
        Peak as Peak,
        frequencies as frequencies,
        frequency_bound as frequency_bound,
        largest_gain as largest_gain,
        spectral_radius as spectral_radius,
    )
    from .law import (
        LearningLaw as LearningLaw,
        input_window as input_window,
        ramp_weights as ramp_weights,
        simple_law as simple_law,
    )
    from .lifted import (
        Lifted as Lifted,
        filtered as filtered,
        identity as identity,
        lifted as lifted,
        shifted as shifted,
        symmetric as symmetric,
        toeplitz as toeplitz,
        weighted as weighted,
        zero_phase as zero_phase,
    )
    from .plants import (
        ACTUATOR_DELAY as ACTUATOR_DELAY,
        ACTUATORS as ACTUATORS,
        delayed_lag as delayed_lag,
        frequency_response as frequency_response,
        pulse_response as pulse_response,
        stable as stable,
    )

public(__name__)
