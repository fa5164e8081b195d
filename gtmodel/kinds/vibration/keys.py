"""The keys of kind "vibration"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from gtmodel.problem_files.base import Problem, Section
from gtmodel.problem_files.log_keys import LogFiles, MeasuredSignal
from gtmodel.vibration.impulse import LARGEST as MOST_MODES
from gtmodel.vibration.step_response import LONGEST
from gtmodel.vibration.subspace import BLOCK_ROWS, HELD_OUT, LARGEST

Square = Annotated[list[list[float]], Field(min_length=1)]


class Measurements(LogFiles):
    """A measured log. Step responses may be several recordings; the other models take one."""

    position_m: MeasuredSignal = Field(description="measured positions, one column or several")
    force_N: MeasuredSignal | None = Field(default=None, description="forces as inputs; or reference_m")
    reference_m: MeasuredSignal | None = Field(default=None, description="position references as inputs; or force_N")
    after_s: NonNegativeFloat = Field(
        default=0.0, description="what lies before, counted from the log's first row, is left out"
    )


class Structure(Section):
    """Masses, dampers and springs under a pseudo-random force."""

    M_kg: Square = Field(description="masses, row by row")
    D_kg_s: Square = Field(description="damping")
    K_N_m: Square = Field(description="stiffness")
    force_N: PositiveFloat = Field(description="amplitude of the pseudo-random binary force")
    coordinate: int = Field(default=1, ge=1, description="on which it acts, from 1")
    hold_samples: int = Field(default=1, ge=1, description="how long a value is held: longer moves its power down")


class Steps(Section):
    """Steps of the reference through b q^-delay / (1 - a q^-1), each a recording of its own."""

    a: float = Field(gt=-1, lt=1, description="pole")
    b: float = Field(description="numerator")
    delay_samples: int = Field(ge=0, description="delay")
    amplitudes_m: list[float] = Field(min_length=1, description="one step each")
    rest_samples: int = Field(default=25, ge=1, description="before the step")


class Hit(Section):
    """Free decay after the hit of a hammer."""

    frequency_Hz: list[PositiveFloat] = Field(min_length=1, description="undamped, by mode")
    damping: list[NonNegativeFloat] = Field(description="ratio, by mode")
    amplitude_m: list[list[float]] = Field(description="by mode and measured position")


class Synthetic(Section):
    """A made-up recording of a known system, to see what identification gives back."""

    seed: int = Field(ge=0, description="of the noise, and of the pseudo-random force")
    noise_m: NonNegativeFloat = Field(description="white noise on the positions, standard deviation")
    samples: int = Field(ge=2, description="of each recording")
    sample_time_s: PositiveFloat = Field(default=0.004, description="between samples")
    structure: Structure | None = Field(default=None, description='for model = "subspace"')
    steps: Steps | None = Field(default=None, description='for model = "step_response"')
    hit: Hit | None = Field(default=None, description='for model = "impulse"')


class Matrices(Section):
    """Printed matrices of M x'' + D x' + K x = f."""

    M_kg: Square = Field(description="masses, row by row")
    D_kg_s: Square = Field(description="damping")
    K_N_m: Square = Field(description="stiffness")
    published_Hz: list[PositiveFloat] = Field(default=[], description="modes printed beside them, to be reproduced")
    published_digits_Hz: PositiveFloat = Field(default=0.5, description="half a unit of their last digit")


class SubspaceKeys(Section):
    """How the state-space model is found."""

    method: Literal["moesp", "n4sid", "cva"] = Field(default="moesp", description="how past and future are weighted")
    order: int | None = Field(default=None, ge=1, description="number of states; by held-out error if left out")
    largest_order: int = Field(default=LARGEST, ge=1, description="tried at most")
    block_rows: int = Field(default=BLOCK_ROWS, ge=2, description="of past and future each")
    held_out: float = Field(default=HELD_OUT, gt=0, lt=1, description="share of the samples judged, not fitted")
    feedthrough: bool = Field(default=False, description="whether the input acts on the output at once")


class KnownMass(Section):
    """A mass that is known."""

    coordinate: int = Field(ge=1, description="from 1")
    mass_kg: PositiveFloat = Field(description="its mass")


class Physical(Section):
    """The physical form: what is known beside the recording."""

    force_coordinates: list[int] = Field(
        default=[], description="coordinate on which each input acts in newtons, from 1; with force_N only"
    )
    mass: list[KnownMass] = Field(default=[], description="one table for each known mass")
    form: Literal["symmetric", "free"] = Field(
        default="symmetric", description="symmetric: M, D, K positive definite by Cholesky factors; free: any D"
    )
    refine: bool = Field(
        default=True, description="fit M, D, K to the recording by output error, with intervals; needs a force"
    )


class StepKeys(Section):
    """How the step response is fitted."""

    delay_samples: int | None = Field(default=None, ge=0, description="by least residual if left out")
    longest_samples: int = Field(default=LONGEST, ge=0, description="delay tried at most")


class ImpulseKeys(Section):
    """How the decay is fitted."""

    modes: int | None = Field(
        default=None, ge=1, description="number of resonances; by information criterion if left out"
    )
    largest: int = Field(default=MOST_MODES, ge=1, description="number tried at most")


class Schema(Problem):
    """Vibration: one of [measurements], [synthetic] and [matrices] gives the data."""

    model: Literal["subspace", "step_response", "impulse", "matrices"] = Field(description="what is looked for")
    measurements: Measurements | None = Field(default=None, description="a measured log")
    synthetic: Synthetic | None = Field(default=None, description="a made-up recording")
    matrices: Matrices | None = Field(default=None, description='printed matrices, for model = "matrices"')
    subspace: SubspaceKeys = SubspaceKeys()
    physical: Physical | None = Field(default=None, description="M, D, K from the subspace model")
    step_response: StepKeys = StepKeys()
    impulse: ImpulseKeys = ImpulseKeys()
