"""Synthetic logs of a three-axis machine as the controllers of five vendors write them, with what the data sheets say.

`clean` writes files that the data sheet describes rightly; `slipped` writes the same run with one slip that the data
sheet does not know. NumPy alone simulates the machine, from `EQUATIONS`. No code of gtmodel takes part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

EQUATIONS = """tau_1 = J_1 qdd_1 + v_1 qd_1 + c_1 sign(qd_1)
tau_2 = J_2 qdd_2 + v_2 qd_2 + c_2 sign(qd_2) + mgl cos(q_2)
tau_3 = J_3 qdd_3 + v_3 qd_3 + c_3 sign(qd_3)
motor angles: theta_i = n_i q_i, but theta_3 = n_3 q_3 + n_32 q_2
motor torques: tau_1 = n_1 T_1, tau_2 = n_2 T_2 + n_32 T_3, tau_3 = n_3 T_3
q_1: about the vertical, seen from above anticlockwise; q_2: elevation above the horizontal; q_3: outward, or clockwise
seen along the arm
J_i holds the rotor too; the axes have no inertial coupling, and gears lose only what v and c say."""
SLIPS = ("sign", "unit", "order", "frame", "clock")
LATE, DURATION, COUNTS = 0.012, 24.0, 2**20  # delay of the slip "clock", s; length, s; Beckhoff's counts per turn
TURN, DEG, MM, REV = 2 * np.pi, 180 / np.pi, 1e3, 0.5 / np.pi  # rad in a turn; written per rad, m, rad
HARMONICS = np.array([1, 2, 3, 5, 7, 9, 12, 15])
NOISE, OFFSET, DRIFT = 0.01, 0.012, 0.025  # of an effort's rms: standard deviation, largest offset, largest drift


@dataclass(frozen=True)
class Vendor:
    """How a controller sees the machine. Written position = sign * factor * SI + zero; efforts likewise, no zero."""

    linear: bool  # axis 3 slides
    coupled: bool  # motor 3 turns with joint 2
    motor_side: tuple[bool, ...]  # the position is the motor's, not the joint's
    units: tuple[str, ...]
    per_SI: tuple[float, ...]
    signs: tuple[int, ...]
    zero: tuple[float, ...]
    effort_unit: str
    effort_signs: tuple[int, ...]
    steps: int  # of the encoder in one motor turn
    slip_unit: tuple[str, float, float]  # of the slip "unit": in words, factor on positions, factor on efforts


_NO, _DEGREES = (False,) * 3, ("deg",) * 3
_AS_RAD, _AS_MA = ("all positions are in rad", 1 / DEG, 1.0), ("all currents are in mA", 1.0, 1e3)
VENDORS: dict[str, Vendor] = {
    "kuka": Vendor(False, True, _NO, _DEGREES, (DEG,) * 3, (-1, -1, 1), (0, 0, 0), "% of maximal current", (-1, -1, 1),
                   2**14, _AS_RAD),
    "abb": Vendor(False, True, _NO, _DEGREES, (DEG,) * 3, (1, -1, 1), (0, 90, 0), "N m of the motor", (1, -1, -1),
                  2**15, _AS_RAD),
    "ur": Vendor(False, False, _NO, ("rad",) * 3, (1, 1, 1), (1, -1, -1), (0, 0, 0), "A", (1, -1, -1), 2**14, _AS_MA),
    "beckhoff": Vendor(True, True, (True,) * 3, ("counts",) * 3, (COUNTS * REV,) * 3, (1, 1, -1), (0, 0, 0),
                       "0.1 % of rated torque", (-1, 1, -1), COUNTS, ("all torques are in %", 1.0, 0.1)),
    "siemens": Vendor(True, False, (True, False, False), ("rev", "deg", "mm"), (REV, DEG, MM), (-1, 1, 1), (0, 0, 0),
                      "A rms", (-1, 1, -1), 2**16, _AS_MA),
}  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """What was written. A reader under test may see `files`, `sheet` and `numbers`, and nothing else."""

    vendor: str
    seed: int
    files: tuple[Path, ...]
    sheet: str  # the data sheets in words
    numbers: dict[str, list[float] | float]  # the same figures: gears, coupling, constants, signs, zero, sampling
    parameters: dict[str, float]  # of EQUATIONS, SI, of the joint; mgl is negative for the slip "frame"
    faults: str  # what is wrong in the files, in every log of this vendor
    slip: str | None  # one of SLIPS
    slip_in_words: str
    signals: dict[str, np.ndarray]  # t, q, qd, qdd, tau of the joints, without noise


class Run:
    """One run of the machine: parameters and motion are drawn from the seed, a slip changes only what is written."""

    def __init__(self, vendor: str, seed: int, slip: str | None):
        self.kind, self.seed, self.slip = VENDORS[vendor], seed, slip
        rng = self.rng = np.random.default_rng([seed, list(VENDORS).index(vendor)])
        own = np.random.default_rng([seed, list(VENDORS).index(vendor), 99])  # of the slip alone: the runs stay equal
        self.axis, self.pair = int(own.integers(3)), own.permutation(3)[:2]
        linear, u = self.kind.linear, rng.uniform
        low, high = ((8, 40, 10), (25, 120, 40)) if linear else ((0.3, 0.5, 0.5), (1.0, 2.0, 2.0))
        rows = np.array([u((4, 4, 5), (12, 15, 15)), u((3, 3, 4), (8, 12, 12)), u(low, high)])
        self.J, self.v, self.c = (np.array([float(f"{x:.4g}") for x in column]) for column in rows.T)
        self.mgl = round(u(40, 110), 2)
        last = TURN / rng.choice([0.01, 0.016, 0.02]) if linear else round(u(50, 90), 2)  # of a spindle: rad per m
        gears = np.array([*np.round(u(80, 160, 2), 2), last])
        self.gears = np.full(3, 101.0) if vendor == "ur" else gears
        self.n_32 = float(np.round(u(8, 20) if linear else u(0.05, 0.15) * self.gears[2], 3)) * self.kind.coupled
        self.N = np.diag(self.gears) + self.n_32 * np.outer([0, 0, 1], [0, 1, 0])  # theta = N q, tau = N^T T
        self.constant = np.round(u(0.08, 0.6, 3), 4)  # N m/A (rms where the vendor writes rms)
        amplitude = (0.9, 0.75, 0.15 if linear else 0.8) * u(0.85, 1.1, 3)
        self.centre = np.array([0.2, 0.45, 0.2]) + u(-0.05, 0.05, 3)
        self.w = TURN * 0.1 * u(0.9, 1.15, 3)[:, None] * HARMONICS
        self.a = amplitude[:, None] / HARMONICS / np.sum(1 / HARMONICS)
        self.phase = u(0, TURN, (3, len(HARMONICS)))
        self.gravity = -self.mgl if slip == "frame" else self.mgl
        self.rms = np.sqrt(np.mean(self.motor_torques(np.linspace(0, DURATION, 4000), self.mgl) ** 2, axis=0))
        self.rated = np.array([float(f"{x:.2g}") for x in 2.5 * self.rms])  # N m
        self.largest = np.array([float(f"{x:.2g}") for x in 6 * self.rms / self.constant])  # A
        factors = {"kuka": 100 / (self.constant * self.largest), "abb": np.ones(3), "beckhoff": 1000 / self.rated}
        self.per_Nm = factors.get(vendor, 1 / self.constant)  # written per N m of the motor
        self.bias = u(-OFFSET, OFFSET, 3) * self.rms
        self.drift = u(0.4 * DRIFT, DRIFT, 3) * rng.choice([-1, 1], 3) * self.rms
        self.begin = datetime(2024, 3, 12, 9, tzinfo=UTC) + timedelta(milliseconds=int(rng.integers(1, 20_000_000)))

    def motion(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, qd and qdd of the three joints at the instants t, each of shape (len(t), 3)."""
        angle = t[:, None, None] * self.w + self.phase
        q = self.centre + np.sum(self.a * np.sin(angle), axis=2)
        qd, qdd = self.a * self.w * np.cos(angle), -self.a * self.w**2 * np.sin(angle)
        return q, np.sum(qd, axis=2), np.sum(qdd, axis=2)

    def torques(self, t: np.ndarray, mgl: float) -> np.ndarray:
        """tau of EQUATIONS, N m or N."""
        q, qd, qdd = self.motion(t)
        tau = self.J * qdd + self.v * qd + self.c * np.sign(qd)
        tau[:, 1] += mgl * np.cos(q[:, 1])
        return tau

    def motor_torques(self, t: np.ndarray, mgl: float) -> np.ndarray:
        """T of EQUATIONS, N m."""
        return self.torques(t, mgl) @ np.linalg.inv(self.N)

    def positions(self, t: np.ndarray) -> np.ndarray:
        """Positions as written, quantised by the encoders on the motors."""
        kind = self.kind
        theta = np.round(self.motion(t)[0] @ self.N.T * kind.steps / TURN) * TURN / kind.steps
        q = theta @ np.linalg.inv(self.N).T
        written = np.where(kind.motor_side, theta, q) * kind.per_SI * kind.signs + kind.zero
        return written * kind.slip_unit[1] if self.slip == "unit" else written

    def efforts(self, t: np.ndarray) -> np.ndarray:
        """Efforts as written: noise, offset and drift of the sensors, then the slip."""
        T = self.motor_torques(t - LATE if self.slip == "clock" else t, self.gravity)
        T += self.bias + self.drift * (t / DURATION)[:, None] + NOISE * self.rms * self.rng.standard_normal(T.shape)
        written = T * self.per_Nm * self.kind.effort_signs
        if self.slip == "sign":
            written[:, self.axis] *= -1
        if self.slip == "order":
            written[:, self.pair] = written[:, self.pair[::-1]]
        return written * self.kind.slip_unit[2] if self.slip == "unit" else written

    def faulty(self, n: int) -> np.ndarray:
        """Row numbers as written: some lost, one gap of 15 rows, some written twice."""
        keep = self.rng.random(n) > 0.003
        keep[self.rng.integers(n // 4, n // 2) + np.arange(15)] = False
        rows = np.flatnonzero(keep)
        return np.repeat(rows, 1 + (self.rng.random(len(rows)) < 0.004))


def _table(numbers: np.ndarray, formats: list[str], separator: str) -> list[str]:
    return [separator.join(f.format(x) for f, x in zip(formats, row, strict=True)) for row in numbers]


def _save(path: Path, lines: list[str], encoding: str, end: str = "\r\n") -> Path:
    path.write_bytes(end.join(lines).encode(encoding))
    return path


def _kuka(run: Run, folder: Path) -> tuple[Path, ...]:
    t = np.arange(0, DURATION, 0.004)
    ipoc = int(run.rng.integers(4_000_000, 900_000_000)) + 4 * np.arange(len(t))
    data = np.column_stack([ipoc, run.positions(t), run.efforts(t), np.zeros((len(t), 2))])[run.faulty(len(t))]
    names = "      IPOC    AIPos_A1    AIPos_A2    AIPos_A3  MACur_A1  MACur_A2  MACur_A3  Delay  E1"
    head = [f"% SYNTHETIC DATA, seed {run.seed}: simulated, no machine was measured", "% RSI monitor 4.1, KR C4",
            "% IPOC [ms]  AIPos [deg]  MACur [%]", names]  # fmt: skip
    body = _table(data, ["{:>10.0f}", *["{:>11.6f}"] * 3, *["{:>9.3f}"] * 3, "{:>6.0f}", "{:>3.0f}"], " ")
    text = [*head, *body[:3000], "% RSI monitor: file reopened", names, *body[3000:], ""]
    return (_save(folder / f"RSI_{run.seed}.txt", text, "ascii"),)


def _abb(run: Run, folder: Path) -> tuple[Path, ...]:
    t = np.arange(0, DURATION, 0.004032)
    t += np.abs(run.rng.normal(0, 2e-4, len(t)))
    micro = np.round((run.begin.timestamp() + t) * 1e6).astype(np.int64)
    data = np.column_stack([micro // 10**6, micro % 10**6, np.arange(len(t)), run.positions(t)])[run.faulty(len(t))]
    body = _table(data, ["{:.0f}", "{:.0f}", "{:.0f}", *["{:.6f}"] * 3], ",")
    text = ["sec,usec,seqno,joint_1,joint_2,joint_3", *body, ""]  # no place for comments: the file's name says it
    egm = _save(folder / f"egm_feedback_synthetic_{run.seed}.csv", text, "utf-8", "\n")
    ahead = 0.001 * int(run.rng.integers(150, 900))
    own, local = np.arange(0, DURATION - 1, 0.002016), run.begin + timedelta(seconds=ahead, hours=1)
    head = [f"TuneMaster signal log - SYNTHETIC DATA, seed {run.seed}", "System:\tIRC5_3AX", "Signals:\t3",
            f"Log started:\t{local:%Y-%m-%d %H:%M:%S}.{local.microsecond // 1000:03d}", "Sample time (s):\t0.002016",
            "", "Time\tAxis 1 Torque\tAxis 2 Torque\tAxis 3 Torque", "s\tNm\tNm\tNm"]  # fmt: skip
    rows = _table(np.column_stack([own, run.efforts(own + ahead)]), ["{:.6f}", *["{:.5e}"] * 3], "\t")
    return egm, _save(folder / f"tunemaster_{run.seed}.log", [*head, *rows, ""], "utf-16")


def _ur(run: Run, folder: Path) -> tuple[Path, ...]:
    t = np.arange(0, DURATION, 0.008)
    qd = run.motion(t)[1] * run.kind.signs + run.rng.normal(0, 0.004, (len(t), 3))
    data = np.column_stack([t + 0.008 * int(run.rng.integers(20_000, 900_000)), run.positions(t), qd, run.efforts(t),
                            np.full(len(t), 2)])[run.faulty(len(t))]  # fmt: skip
    names = [f"{name}_{i}" for name in ("actual_q", "actual_qd", "actual_current") for i in range(3)]
    body = _table(data, ["{:.3f}", *["{:.6f}"] * 9, "{:.0f}"], ",")
    text = [",".join(["timestamp", *names, "runtime_state"]), *body, body[-1][:31]]
    return (_save(folder / f"rtde_synthetic_{run.seed}.csv", text, "utf-8", "\n"),)


def _beckhoff(run: Run, folder: Path) -> tuple[Path, ...]:
    channels, start = [], round(run.begin.timestamp() * 1000 + 11_644_473_600_000) * 10_000  # 100 ns since 1601
    for i in range(6):
        period = 0.002 if i < 3 else 0.004
        t = np.arange(0, DURATION, period) + 1e-7 * int(run.rng.integers(0, 20_000))
        written = (run.positions if i < 3 else run.efforts)(t)[:, i % 3]
        rows, ticks = run.faulty(len(t)), start + np.round(t * 1e7).astype(np.int64)
        name = f"{'ActPosRaw' if i < 3 else 'ActTorque'}_{i % 3 + 1}"
        info = {"Name": name, "SymbolComment": "synthetic", "Data-Type": "INT32" if i < 3 else "INT16",
                "SampleTime[ms]": f"{1e3 * period:.0f}", "SymbolName": f"GVL.Axis[{i % 3 + 1}].{name[:-2]}",
                "Offset": "0", "ScaleFactor": "1"}  # fmt: skip
        channels.append((info, [f"{k}\t{x:.0f}" for k, x in zip(ticks[rows], written[rows], strict=True)]))
    text = [f"Name\tSYNTHETIC DATA, seed {run.seed}: simulated, not measured", "File\tC:\\Scope\\axes.tcscopex",
            f"Starttime of export\t{start}", f"Endtime of export\t{start + int(DURATION * 1e7)}", ""]  # fmt: skip
    text += ["\t".join(f"{key}\t{info[key]}" for info, _ in channels) for key in channels[0][0]] + [""]
    for k in range(max(len(rows) for _, rows in channels)):
        text.append("\t".join(rows[k] if k < len(rows) else "\t" for _, rows in channels))
    return (_save(folder / f"scope_{run.seed}.csv", [*text, "EOF", ""], "utf-8-sig"),)


def _siemens(run: Run, folder: Path) -> tuple[Path, ...]:
    t = np.arange(0, DURATION, 0.004) + np.abs(run.rng.normal(0, 3e-4, round(DURATION / 0.004)))
    rows = run.faulty(len(t))
    body = _table(np.column_stack([run.positions(t), run.efforts(t)])[rows], ["{:.5f}"] * 6, ";")
    stamps = [run.begin + timedelta(milliseconds=round(1e3 * s)) for s in t[rows]]
    body = [f"{s:%d.%m.%Y %H:%M:%S},{s.microsecond // 1000:03d};{b.replace('.', ',')}"
            for s, b in zip(stamps, body, strict=True)]  # fmt: skip
    head = [f'"SINUMERIK Trace";"SYNTHETISCHE DATEN, Startwert {run.seed}: simuliert, nicht gemessen"',
            '"Maschine";"Prüfstand 3 Achsen"', '"Abtastzeit [ms]";"4"', "",
            "Zeitstempel;C1 Motorlage;B2 Istposition;Z3 Istposition;C1 Strom Iq;B2 Strom Iq;Z3 Strom Iq",
            ";[Umdr];[°];[mm];[A];[A];[A]"]  # fmt: skip
    return (_save(folder / f"trace_{run.seed}.csv", [*head, *body, ""], "cp1252"),)


_TWICE = "some rows lost, one gap of 15 rows, some rows written twice; efforts with noise, offset and slow drift"
_SHEETS: dict[str, tuple[Callable[[Run, Path], tuple[Path, ...]], str, str]] = {
    "kuka": (_kuka, "One row each 4 ms; IPOC counts ms. AIPos_A1..A3: joint positions; MACur_A1..A3: motor currents.",
             f"{_TWICE}; the line of names stands again in the middle"),
    "abb": (_abb, "Positions: EGM file, each 4.032 ms, joint_1..3; sec and usec since 1970 (UTC). Motor torques: "
            "TuneMaster file, each 2.016 ms, Axis 1..3 Torque; seconds since 'Log started', which is the local time "
            "(UTC+1) of the same controller.", f"positions: jitter, {_TWICE}; the torque file is UTF-16"),
    "ur": (_ur, "One row each 8 ms; timestamp in s since the controller started. actual_q_0..2: joint positions; "
           "actual_qd_0..2: velocities, rad/s; actual_current_0..2: motor currents.", f"{_TWICE}; last row cut off"),
    "beckhoff": (_beckhoff, "A time column (100 ns since 1601) before each channel. ActPosRaw_1..3: motor encoders, "
                 "2^20 counts per turn, each 2 ms; ActTorque_1..3: motor torques, each 4 ms.",
                 f"each channel: {_TWICE}; channels start up to 2 ms apart; slow channels end in blank cells"),
    "siemens": (_siemens, "One row each 4 ms, stamped to 1 ms. C1: position of the motor; B2 and Z3: of the joint "
                "(glass scales). Iq: motor currents, A rms.", f"jitter, {_TWICE}; decimal comma, cp1252"),
}  # fmt: skip
_SENSES = {1: ("anticlockwise seen from above", "arm up", "clockwise seen along the arm", "outward"),
           -1: ("clockwise seen from above", "arm down", "anticlockwise seen along the arm", "inward")}  # fmt: skip


def slipped(vendor: str, seed: int, folder: Path, slip: str | None) -> Truth:
    """Writes the log of a run with one of SLIPS, which neither files nor data sheet tell, or with none of them."""
    if slip not in (None, *SLIPS):
        raise ValueError(f"slip is {slip!r}; expected one of {', '.join(SLIPS)}")
    run, kind = Run(vendor, seed, slip), VENDORS[vendor]
    folder.mkdir(parents=True, exist_ok=True)
    write, columns, faults = _SHEETS[vendor]
    lines = [f"The machine stands on the floor; motor 3 is {'' if run.n_32 else 'not '}coupled to axis 2.", columns]
    for i in range(3):
        slides, motor = kind.linear and i == 2, "motor" if kind.motor_side[i] else "joint"
        sense = {sign: words[i + slides] for sign, words in _SENSES.items()}
        zero = f", {kind.zero[1]:g} {kind.units[1]} with the arm horizontal" if i == 1 else ""
        kt, full = f"torque constant {run.constant[i]} N m per A", f"100 % is {run.largest[i]:g} A"
        size = {"kuka": f"{kt}, {full}", "abb": "no constant", "siemens": f"{kt} rms"}.get(vendor, kt)
        size = f"rated motor torque {run.rated[i]:g} N m" if vendor == "beckhoff" else size
        lines.append(f"Axis {i + 1} ({'slides' if slides else 'turns'}): position of the {motor} in {kind.units[i]}, "
                     f"positive {sense[kind.signs[i]]}{zero}; gear {run.gears[i]:.8g} motor "
                     f"{'rad per m' if slides else 'turns per turn'}; effort in {kind.effort_unit}, positive "
                     f"drives {sense[kind.effort_signs[i]]}; {size}.")  # fmt: skip
    if n := run.n_32:
        lines.append(f"Coupling: per rad that the arm (axis 2) goes up, motor 3 turns {n:g} rad more in the sense "
                     f"'{_SENSES[1][2 + kind.linear]}'; {n:g} times its torque drives the arm up.")  # fmt: skip
    lines.append(f"Efforts: offset to {100 * OFFSET:g} %, drift to {100 * DRIFT:g} %, noise {100 * NOISE:g} % of rms.")
    t = np.arange(0, DURATION, 0.004)
    parameters = {f"{name}_{i + 1}": float(x[i]) for name, x in zip("Jvc", (run.J, run.v, run.c), strict=True)
                  for i in range(3)} | {"mgl": run.gravity}  # fmt: skip
    numbers = {"gears": run.gears.tolist(), "n_32": run.n_32, "effort_units_per_Nm": run.per_Nm.tolist(),
               "position_units_per_SI": list(kind.per_SI), "position_signs": list(kind.signs),
               "position_zero": list(kind.zero), "effort_signs": list(kind.effort_signs)}  # fmt: skip
    told = {"sign": f"effort of axis {run.axis + 1} has the other sign", "unit": kind.slip_unit[0],
            "order": f"efforts of axes {run.pair[0] + 1} and {run.pair[1] + 1} are exchanged",
            "frame": "the machine hangs from the ceiling: gravity along +z of its base",
            "clock": f"efforts are written {1e3 * LATE:g} ms late", None: ""}[slip]  # fmt: skip
    signals = dict(zip(["t", "q", "qd", "qdd", "tau"], (t, *run.motion(t), run.torques(t, run.gravity)), strict=True))
    return Truth(vendor, seed, write(run, folder), "\n".join(lines), numbers, parameters, faults, slip, told, signals)


def clean(vendor: str, seed: int, folder: Path) -> Truth:
    """Writes the log of one run into folder; the data sheet of the result is right."""
    return slipped(vendor, seed, folder, None)
