"""Dynamic stiffness: oscillators from frequency responses, and their field over the pose. Independent of any robot.

dynamic_stiffness_study      oscillators by experiment and over the pose: `DynamicStiffnessStudy`
ModalFitting, Process, FrequencyMap   options of the modal fit, the Gaussian processes and the frequency map
Experiment, read_experiments a frequency response at a pose; all experiments of an index file
SyntheticArm, synthetic_experiments   synthetic experiments, `SyntheticExperiments`

Frequency responses
    FrequencyResponse, frequency_response   receptance with its noise from records of an impact hammer
    command_force                           force that is equivalent to a commanded step
    fit_modes -> ModalFit                   mass, damping and stiffness of one or several modes, with intervals
    receptance, synthetic_hits, synthetic_receptance   the model, and synthetic data
Over the pose
    GaussianProcess, fit_gaussian_processes, held_out  exact regression, hyperparameters, cross-validation
    OscillatorField, fit_oscillator_field   m, c, k in x, y, z at any pose; as CasADi function and C
    oscillator_text, load_oscillator_field  its file
    SyntheticField, synthetic_field         a synthetic true field through prescribed poses
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .experiments import (
        Experiment as Experiment,
        FrequencyResponse as FrequencyResponse,
        command_force as command_force,
        frequency_response as frequency_response,
        read_experiments as read_experiments,
    )
    from .gaussian_process import (
        GaussianProcess as GaussianProcess,
        KernelInputs as KernelInputs,
        fit_gaussian_processes as fit_gaussian_processes,
        held_out as held_out,
    )
    from .modal_fit import ModalFit as ModalFit, fit_modes as fit_modes, receptance as receptance
    from .options import (
        DynamicStiffnessStudy as DynamicStiffnessStudy,
        FrequencyMap as FrequencyMap,
        ModalFitting as ModalFitting,
        Process as Process,
        SyntheticArm as SyntheticArm,
    )
    from .oscillator_field import (
        OscillatorField as OscillatorField,
        fit_oscillator_field as fit_oscillator_field,
        load_oscillator_field as load_oscillator_field,
        oscillator_text as oscillator_text,
    )
    from .stiffness_study import dynamic_stiffness_study as dynamic_stiffness_study
    from .synthetic import (
        SyntheticExperiments as SyntheticExperiments,
        SyntheticField as SyntheticField,
        synthetic_experiments as synthetic_experiments,
        synthetic_field as synthetic_field,
        synthetic_hits as synthetic_hits,
        synthetic_receptance as synthetic_receptance,
    )

public(__name__)
