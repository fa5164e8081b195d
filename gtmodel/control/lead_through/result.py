"""What a study of lead-through answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from ..._lazy import hint
from ...results import Quantity, Study

if TYPE_CHECKING:
    from .passivity import PassivityBook
    from .tool_run import ToolRun
else:
    PassivityBook = hint("gtmodel.control.lead_through", "PassivityBook")
    ToolRun = hint("gtmodel.control.lead_through", "ToolRun")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LeadThroughStudy(Study):
    """Guiding a tool by hand against a synthetic contact: forces, limits, energy, and hands that it is stable in.

    run: the whole run, synthetic; book: its energy at the handle. Both None where the sensors did not let it move, or
    stopped it on the way: a note says when.
    """

    run: ToolRun | None = None
    book: PassivityBook | None = None
    force_gain: Annotated[float, Quantity("m/s/N", "of the force control, (8.4)", "gain of the force control")] = 0.0
    loop_gain: Annotated[
        float, Quantity("1/s", "gain times stiffness of the contact; of a peg, of its worst direction", "loop gain")
    ] = 0.0
    limit: Annotated[float, Quantity("1/s", "loop gain at which it oscillates, by eigenvalues", "limit")] = 0.0
    frequency: Annotated[float, Quantity("Hz", "at which it then oscillates", "frequency at the limit")] = 0.0
    simulated_limit: Annotated[
        float | None, Quantity("1/s", "loop gain at which runs in time begin to grow", "limit of runs in time")
    ] = None
    simulated_frequency: Annotated[float | None, Quantity("Hz", "of what grows there", "frequency of runs in time")] = (
        None
    )
    stiffnesses: Annotated[Sequence[float], Quantity("N/m", "contacts that were asked about")] = ()
    gain_limits: Annotated[Sequence[float], Quantity("m/s/N", "greatest gain at each of them")] = ()
    mean_force: Annotated[float | None, Quantity("N", "along the true normal, in contact", "mean force")] = None
    force_deviation: Annotated[
        float | None, Quantity("N", "root mean square from the reference", "deviation of the force")
    ] = None
    least_force: Annotated[float | None, Quantity("N", "once contact settled", "least force")] = None
    peak_force: Annotated[float | None, Quantity("N", "on taking contact or after", "peak force")] = None
    force_frequency: Annotated[
        float | None, Quantity("Hz", "at which the force's spectrum is largest", "frequency of the force")
    ] = None
    contact_losses: Annotated[int | None, Quantity("", "that the hand did not ask for", "losses of contact")] = None
    normal_error: Annotated[
        float | None, Quantity("rad", "mean angle from the true normal", "error of the normal", "deg", "", "deg")
    ] = None
    gain_share: Annotated[
        float | None, Quantity("", "of the gain, left when oscillation was seen", "share of the gain left")
    ] = None
    energy_passed: Annotated[float | None, Quantity("J", "through the handle, both ways", "energy at the handle")] = (
        None
    )
    least_window: Annotated[
        float | None, Quantity("J", "least energy that went in over any window", "least over any window")
    ] = None
    energy_deficit: Annotated[
        float | None, Quantity("J", "that the hand got beyond what was stored", "energy not stored before")
    ] = None
    hand_damping: Annotated[
        float | None, Quantity("", "damping ratio of the least damped pole over all hands", "least damping, any hand")
    ] = None
    hand_mode: Annotated[float | None, Quantity("Hz", "frequency of that pole, undamped", "mode of least damping")] = (
        None
    )
    worst_hand: Annotated[Mapping[str, float], "mass [kg], damping [N s/m] and stiffness [N/m] there"] = field(
        default_factory=dict
    )
    stiffest_hand: Annotated[float | None, Quantity("N/m", "up to it all hands are stable", "stiffest stable hand")] = (
        None
    )
    cone_deviations: Annotated[
        Mapping[str, Sequence[float]] | None, Quantity("N", "of the force, for each cone", "deviation by cone")
    ] = None
    largest_torque: Annotated[float | None, Quantity("N.m", "on the peg, about its tip", "largest torque")] = None
    last_torque: Annotated[float | None, Quantity("N.m", "root mean square of the last second", "torque left")] = None
    misalignment: Annotated[
        Sequence[float] | None,
        Quantity("rad", "of peg and hole, at the beginning and the end", "misalignment", "deg", "", "deg"),
    ] = None
    depth: Annotated[float | None, Quantity("m", "of the tip in the hole", "depth", "mm", "", "mm")] = None
    undetermined: Annotated[
        Sequence[float] | None, "axis in the tool's frame about which the contact determines no rotation"
    ] = None
    turned_about: Annotated[
        float | None,
        Quantity("rad", "commanded about the peg's axis, in contact", "turn about the peg", "deg", "", "deg"),
    ] = None
    expected_about: Annotated[
        float | None,
        Quantity("rad", "that the noise of the torque makes, standard deviation", "its random walk", "deg", "", "deg"),
    ] = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WrenchStudy(Study):
    """Bias, mass and centre of what a force sensor carries, and where forces act on it."""

    poses: Annotated[int, Quantity("", "at rest", "poses")] = 0
    mass: Annotated[float | None, Quantity("kg", "that the sensor carries", "mass")] = None
    centre: Annotated[
        Sequence[float] | None, Quantity("m", "of the mass, in the sensor's frame", "centre", "mm", "", "mm")
    ] = None
    force_bias: Annotated[Sequence[float], Quantity("N", "reading without force", "bias of the force")] = ()
    moment_bias: Annotated[Sequence[float], Quantity("N.m", "reading without moment", "bias of the moment")] = ()
    force_drift: Annotated[
        Sequence[float] | None, Quantity("N/s", "of the bias, where it was asked for", "drift of the force")
    ] = None
    moment_drift: Annotated[
        Sequence[float] | None, Quantity("N.m/s", "of the bias, where it was asked for", "drift of the moment")
    ] = None
    arm: Annotated[Sequence[float] | None, Quantity("m", "to where the pushes act", "lever arm", "mm", "", "mm")] = None
    half_widths: Annotated[Mapping[str, float], "of 95 % intervals, by parameter, in N, kg, N m, kg m and m"] = field(
        default_factory=dict
    )
    usable: Annotated[str, "whether the wrench can be used: a `WrenchStatus`"] = ""
    coverage: Annotated[
        Mapping[str, float] | None, "share of synthetic repetitions whose 95 % interval holds the truth, by parameter"
    ] = None
