"""How a robot vibrates: black boxes and M, D, K of recordings, oscillators of frequency responses. Knows no robot.

Studies
    study                the model of a recording that is asked for: `VibrationStudy`
    Subspace, StepResponse, Impulse, Physical     which model, and what is known beside the recording
    matrices_study, Matrices    modes and signs of printed matrices
    synthetic_records    made-up recordings of a Structure, Steps or a Hit, with their Sampling
Recordings
    Record, Stopped      one evenly sampled recording; a fit that was stopped
    structure_record, hammer_record, step_record   made-up recordings with seed and noise
Black boxes (Dressler 2012, section 6.3)
    identify_step        delayed first-order model, eq. (6.11) -> control.TransferFunction
    identify_subspace    N4SID, MOESP, CVA with order and held-out prediction -> control.StateSpace
    identify_impulse     resonances and damping from what follows a hit
    bandwidth            of a first-order pole
Physical form
    physical_form        M^-1 K and M^-1 D of a model whose outputs are positions, eq. (6.14)
    from_known           M, D, K where a force or masses are known
    output_error         M, D, K nearest to the recording, symmetric positive definite or free, with covariance
    continuous           matrix logarithm with its branch checked
    modes, sign_question    frequencies, damping, shapes, definiteness in words, eq. (6.15)
    definite_form        the nearest passive structure to printed matrices
Oscillators of frequency responses, and their field over the pose
    dynamic_stiffness_study, and all of `gtmodel.vibration.dynamic_stiffness` but its options
"""

from .continuous import Continuous, continuous
from .definite_form import DefiniteForm, definite_form
from .dynamic_stiffness import (
    DynamicStiffnessStudy,
    FrequencyResponse,
    GaussianProcess,
    Inputs,
    ModalFit,
    OscillatorField,
    SyntheticField,
    command_force,
    dynamic_stiffness_study,
    fit_gaussian_processes,
    fit_modes,
    fit_oscillator_field,
    frequency_response,
    held_out,
    load_oscillator_field,
    oscillator_text,
    receptance,
    synthetic_field,
    synthetic_hits,
    synthetic_receptance,
)  # fmt: skip
from .impulse import ImpulseModel, Resonance, identify_impulse
from .impulse_study import ImpulseStudy
from .known_force import SecondOrder, from_known
from .matrices_study import MatricesStudy, matrices_study
from .modes import Modes, modes, sign_question
from .options import (
    Hit,
    Impulse,
    KnownMass,
    Matrices,
    Physical,
    Sampling,
    StepResponse,
    Steps,
    Structure,
    Subspace,
)  # fmt: skip
from .order import OrderTrial
from .output_error import OutputErrorFit, output_error
from .physical_form import PhysicalForm, physical_form
from .record import Record, Stopped
from .step_response import StepModel, bandwidth, identify_step
from .step_study import StepStudy
from .subspace import SubspaceModel, identify_subspace
from .subspace_study import SubspaceStudy
from .synthetic import hammer_record, step_record, structure_record, synthetic_records
from .vibration_result import VibrationStudy
from .vibration_study import study

__all__ = [
    "Continuous", "DefiniteForm", "DynamicStiffnessStudy", "FrequencyResponse", "GaussianProcess", "Hit", "Impulse",
    "ImpulseModel", "ImpulseStudy", "Inputs", "KnownMass", "Matrices", "MatricesStudy", "ModalFit", "Modes",
    "OrderTrial", "OscillatorField", "OutputErrorFit", "Physical", "PhysicalForm", "Record", "Resonance", "Sampling",
    "SecondOrder", "StepModel", "StepResponse", "StepStudy", "Steps", "Stopped", "Structure", "Subspace",
    "SubspaceModel", "SubspaceStudy", "SyntheticField", "VibrationStudy", "bandwidth", "command_force", "continuous",
    "definite_form", "dynamic_stiffness_study", "fit_gaussian_processes", "fit_modes", "fit_oscillator_field",
    "frequency_response", "from_known", "hammer_record", "held_out", "identify_impulse", "identify_step",
    "identify_subspace", "load_oscillator_field", "matrices_study", "modes", "oscillator_text", "output_error",
    "physical_form", "receptance", "sign_question", "step_record", "structure_record", "study", "synthetic_field",
    "synthetic_hits", "synthetic_receptance", "synthetic_records",
]  # fmt: skip
