"""A simulated robot controller: it sends its state each cycle and follows the answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..results.refusal import ArgumentError
from . import egm, rsi
from .egm import WireError
from .exchange import AXES, DEGREES, MM, Protocol
from .plant import Plant
from .wrenches import Wrench, to_egm, to_rsi

UINT32 = (1 << 32) - 1
FIRST_IPOC = 4_208_000
# joints of an arm that stands still next to the carts; the loop sends them back unchanged
JOINTS_DEG = [0.0, 10.0, -20.0, 0.0, 30.0, 0.0]
Sensing = Callable[[], tuple[Wrench, Wrench] | None]
Programme = Callable[[int, Sequence[float]], Sequence[float]]


class RobotSide:
    """A controller that speaks EGM or RSI for a plant. It is the clock: each `step` takes `cycle_ms`.

    Args:
        programme: function of cycle and path correction [m] that returns the carts [m] of the robot's own motion;
            None: the robot has no programme.
        waits: cycles before the robot reports that it is running (EGM).
        ends: cycle from which on it reports that it is not running; None: never (EGM).
        first_number, first_ms: number and time of the first datagram (EGM); both wrap at 32 bits.
        joints: the plant's positions are joints of an arm [rad] instead of carts [m].
        wrenches: function that returns the wrenches of the sensors at handle and tool, called once per cycle. If it is
            None or returns None, no wrenches are sent.

    Raises ArgumentError if the plant has another cycle.
    """

    def __init__(
        self,
        protocol: Protocol,
        plant: Plant,
        *,
        cycle_ms: int = 4,
        programme: Programme | None = None,
        waits: int = 0,
        ends: int | None = None,
        first_number: int = 0,
        first_ms: int = 1000,
        wrenches: Sensing | None = None,
        joints: bool = False,
    ) -> None:
        plant_s = getattr(plant, "cycle_s", None)  # only of plants with a fixed cycle
        if plant_s is not None and abs(1000.0 * plant_s - cycle_ms) > 1e-9 * cycle_ms:
            raise ArgumentError(f"its cycle is {1000.0 * plant_s:g} ms, that of the controller {cycle_ms} ms", "plant")
        self.protocol, self.plant, self.cycle_ms = protocol, plant, cycle_ms
        self.programme, self.waits, self.ends = programme, waits, ends
        self.first_number, self.first_ms = first_number, first_ms
        self.wrenches, self.joints = wrenches, joints
        self.unit = DEGREES if joints else MM
        self.cycles = 0
        self.start_m = np.array(plant.position_m)
        self.planned_m = list(map(float, plant.position_m))
        # reference that the robot reports: its own programme without the correction
        self.reported_m = self.planned_m
        self.speed_m_s = [0.0] * len(self.planned_m)
        self.path_m = [0.0, 0.0, 0.0]
        self.late = 0  # cycles that ended without an answer to their own datagram

    @property
    def number(self) -> int:
        """Number of this cycle's datagram, as the loop counts it."""
        return self.first_number + self.cycles if self.protocol == "egm" else self._ipoc // self.cycle_ms

    @property
    def _ipoc(self) -> int:
        return FIRST_IPOC + self.cycle_ms * self.cycles

    def datagram(self) -> bytes:
        """Return the datagram that the robot sends in this cycle."""
        measured = [x * self.unit for x in self.plant.position_m.tolist()]
        planned = [x * self.unit for x in self.reported_m]
        if self.protocol == "rsi":
            rest = [0.0] * (AXES - len(planned))
            cartesian = [0.0] * 6
            values = {"RIst": cartesian, "RSol": cartesian}
            places = (("AIPos", "ASPos"), ("EIPos", "ESPos"))
            others = [0.0] * AXES if self.joints else JOINTS_DEG
            for (actual, target), here in zip(places, (self.joints, not self.joints), strict=True):
                values |= (
                    {actual: measured + rest, target: planned + rest} if here else {actual: others, target: others}
                )
            return self._with_wrenches(rsi.encode_robot(rsi.RsiRobot(self._ipoc, delay=self.late, values=values)))
        running = self.waits <= self.cycles and (self.ends is None or self.cycles < self.ends)
        robot = egm.EgmRobot(
            sequence=self.number & UINT32,
            time_ms=self.first_ms + self.cycle_ms * self.cycles & UINT32,
            type=egm.TYPE_DATA,
            feedback=self._pose(measured),
            planned=self._pose(planned),
            motor_state=1,
            mci_state=egm.MCI_RUNNING if running else 2,
            rapid_state=2,
        )
        return self._with_wrenches(egm.encode_robot(robot))

    def _pose(self, values: list[float]) -> egm.EgmPose:
        if self.joints:
            return egm.EgmPose(joints_deg=values)
        return egm.EgmPose(joints_deg=JOINTS_DEG, external_mm=values)

    def _with_wrenches(self, data: bytes) -> bytes:
        both = None if self.wrenches is None else self.wrenches()
        if both is None:
            return data
        return (to_rsi if self.protocol == "rsi" else to_egm)(data, *both)

    def step(self, answers: Sequence[bytes]) -> None:
        """Follow the last readable answer, or keep the previous one; then advance one cycle."""
        answered = [self._take(data) for data in answers]
        self.late += not any(answered)
        if self.programme is not None:
            before = self.planned_m
            self.planned_m = list(map(float, self.programme(self.cycles, self.path_m)))
            self.reported_m = list(map(float, self.programme(self.cycles, [0.0] * 3)))
            pairs = zip(self.planned_m, before, strict=True)
            self.speed_m_s = [(now - then) * 1000.0 / self.cycle_ms for now, then in pairs]
        else:
            self.reported_m = self.planned_m
        self.plant.step(self.planned_m, self.speed_m_s)
        self.cycles += 1

    def _take(self, data: bytes) -> bool:
        """Follow an answer; return whether it belongs to this cycle."""
        n = len(self.planned_m)
        try:
            if self.protocol == "rsi":
                correction = rsi.decode_sensor(data)
                if self.programme is None:
                    self.planned_m = [
                        s + x / self.unit
                        for s, x in zip(
                            self.start_m.tolist(), (correction.ak_deg if self.joints else correction.ek_mm)[:n],
                            strict=True,
                        )
                    ]  # fmt: skip
                self.path_m = [x / MM for x in correction.rkorr[:3]]
                return correction.stamp == b"%d" % self._ipoc
            sensor = egm.decode_sensor(data)
        except (WireError, rsi.TelegramError):
            return False
        if sensor.path_mm is not None:
            self.path_m = [x / MM for x in sensor.path_mm]
        elif len(sensor.joints_deg if self.joints else sensor.external_mm) >= n and self.programme is None:
            positions = sensor.joints_deg if self.joints else sensor.external_mm
            speeds = sensor.joint_speeds_deg_s if self.joints else sensor.external_speeds_mm_s
            self.planned_m = [x / self.unit for x in positions[:n]]
            self.speed_m_s = [x / self.unit for x in (speeds + [0.0] * n)[:n]]  # a missing speed is zero
        return sensor.sequence == self.number & UINT32
