"""Black-box and physical models of vibration (Dressler 2012, section 6.3). Numbers in; knows no robot.

Data
    Record, VibrationError              one evenly sampled recording; what does not fit, in a sentence
    structure_record, hammer_record, step_record   made-up recordings with seed and noise
Black box
    identify_step        delayed first-order model, eq. (6.11) -> control.TransferFunction
    identify_subspace    N4SID, MOESP, CVA with order and held-out prediction -> control.StateSpace
    identify_impulse     resonances and damping from what follows a hit
    bandwidth            of a first-order pole
Physical form
    physical_form        M^-1 K and M^-1 D of a model whose outputs are positions, eq. (6.14)
    from_known           M, D, K where a force or masses are known
    output_error         M, D, K nearest to the recording, symmetric positive definite or free, with covariance
    continuous           matrix logarithm with its branch checked
Modes
    modes, sign_question    frequencies, damping, shapes, definiteness in words, eq. (6.15)
    definite_form        the nearest passive structure to printed matrices
"""

from .continuous import Continuous, continuous
from .definite_form import DefiniteForm, definite_form
from .impulse import ImpulseModel, Resonance, identify_impulse
from .known_force import SecondOrder, from_known
from .modes import Modes, modes, sign_question
from .order import OrderTrial
from .output_error import OutputErrorFit, output_error
from .physical_form import PhysicalForm, physical_form
from .record import Record, VibrationError
from .step_response import StepModel, bandwidth, identify_step
from .subspace import SubspaceModel, identify_subspace
from .synthetic import hammer_record, step_record, structure_record

__all__ = [
    "Continuous", "DefiniteForm", "ImpulseModel", "Modes", "OrderTrial", "OutputErrorFit", "PhysicalForm", "Record",
    "Resonance", "SecondOrder", "StepModel", "SubspaceModel", "VibrationError", "bandwidth", "continuous",
    "definite_form", "from_known", "hammer_record", "identify_impulse", "identify_step", "identify_subspace", "modes",
    "output_error", "physical_form", "sign_question", "step_record", "structure_record",
]  # fmt: skip
