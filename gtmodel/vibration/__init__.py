"""Vibration of structures: black-box models and M, D, K from recordings, oscillators from frequency responses.

Studies
    study                the model of a recording: `VibrationStudy`
    Subspace, StepResponse, Impulse, Physical     which model, and prior knowledge
    matrices_study, Matrices    modes and signs of printed matrices
    synthetic_records    synthetic recordings of a SyntheticStructure, Steps or a Hit, with their Sampling
Recordings
    Record, FitStopped   one evenly sampled recording; an interrupted fit
    structure_record, hammer_record, step_record   synthetic recordings with seed and noise
Black boxes (Dressler 2012, section 6.3)
    identify_step        delayed first-order model, eq. (6.11) -> control.TransferFunction
    identify_subspace    N4SID, MOESP, CVA with order selection and held-out prediction -> control.StateSpace
    identify_impulse     resonances and damping from the decay after a hit
    bandwidth            of a first-order pole
Physical form
    physical_form        M^-1 K and M^-1 D of a model whose outputs are positions, eq. (6.14)
    from_known           M, D, K from a known force or known masses
    output_error         M, D, K that fit the recording best, symmetric positive definite or free, with covariance
    continuous           matrix logarithm with a check of its branch
    modes, sign_question    frequencies, damping, shapes, definiteness in words, eq. (6.15)
    definite_form        the nearest passive structure to printed matrices
Oscillators from frequency responses, and their field over the pose
    dynamic_stiffness_study, and all of `gtmodel.vibration.dynamic_stiffness` but its options
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .dynamic_stiffness import (
        DynamicStiffnessStudy as DynamicStiffnessStudy,
        FrequencyResponse as FrequencyResponse,
        GaussianProcess as GaussianProcess,
        KernelInputs as KernelInputs,
        ModalFit as ModalFit,
        OscillatorField as OscillatorField,
        SyntheticField as SyntheticField,
        command_force as command_force,
        dynamic_stiffness_study as dynamic_stiffness_study,
        fit_gaussian_processes as fit_gaussian_processes,
        fit_modes as fit_modes,
        fit_oscillator_field as fit_oscillator_field,
        frequency_response as frequency_response,
        held_out as held_out,
        load_oscillator_field as load_oscillator_field,
        oscillator_text as oscillator_text,
        receptance as receptance,
        synthetic_field as synthetic_field,
        synthetic_hits as synthetic_hits,
        synthetic_receptance as synthetic_receptance,
    )
    from .impulse import (
        ImpulseModel as ImpulseModel,
        ImpulseStudy as ImpulseStudy,
        Resonance as Resonance,
        identify_impulse as identify_impulse,
    )
    from .modes import (
        DefiniteForm as DefiniteForm,
        MatricesStudy as MatricesStudy,
        Modes as Modes,
        definite_form as definite_form,
        matrices_study as matrices_study,
        modes as modes,
        sign_question as sign_question,
    )
    from .options import (
        Hit as Hit,
        Impulse as Impulse,
        KnownMass as KnownMass,
        Matrices as Matrices,
        Physical as Physical,
        Sampling as Sampling,
        StepResponse as StepResponse,
        Steps as Steps,
        Subspace as Subspace,
        SyntheticStructure as SyntheticStructure,
    )
    from .output_error import OutputErrorFit as OutputErrorFit, output_error as output_error
    from .physical_form import (
        Continuous as Continuous,
        PhysicalForm as PhysicalForm,
        SecondOrder as SecondOrder,
        continuous as continuous,
        from_known as from_known,
        physical_form as physical_form,
    )
    from .record import FitStopped as FitStopped, Record as Record
    from .step_response import (
        StepModel as StepModel,
        StepStudy as StepStudy,
        bandwidth as bandwidth,
        identify_step as identify_step,
    )
    from .subspace import (
        OrderTrial as OrderTrial,
        SubspaceModel as SubspaceModel,
        identify_subspace as identify_subspace,
    )
    from .synthetic import (
        hammer_record as hammer_record,
        step_record as step_record,
        structure_record as structure_record,
        synthetic_records as synthetic_records,
    )
    from .vibration_result import VibrationStudy as VibrationStudy
    from .vibration_study import SubspaceStudy as SubspaceStudy, study as study

public(__name__)
