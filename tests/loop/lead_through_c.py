"""gt_lead_through of the C loop through ctypes, and the same cycles by its twin in Python."""

from __future__ import annotations

import ctypes
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gtmodel._files import codegen_dir
from gtmodel.control.lead_through import LeadThroughLaw, LeadThroughState, SignTest, WrenchStatus
from gtmodel.loop.lead_through.law import numbers_of

# of a cycle: force and moment of handle and tool, their ages in cycles, rows of the tool's rotation matrix
COLUMNS = 6 + 6 + 2 + 9
OUT = 33
PLACES = (codegen_dir() / "runtime", codegen_dir() / "loop")
NAMES = ("gt_surface", "gt_turning", "gt_force_sensor", "gt_lead_through")
OK = SignTest(None, WrenchStatus.OK)
EXPORTED = """
#include "gt_lead_through.h"

int cycles(const double *numbers, const double *rows, int count, int again, double *out);
int begins(const double *numbers, const double *row);
static gt_wrench wrench_at(const double *row, double age)
{
    gt_wrench wrench;

    gt_copy(wrench.force_N, row, 3);
    gt_copy(wrench.moment_N_m, &row[3], 3);
    wrench.age_cycles = (uint32_t)age;
    wrench.status = 0U;
    return wrench;
}

/* Each row a cycle further, or, from row `again` on, all from the state that stood there. */
int cycles(const double *numbers, const double *rows, int count, int again, double *out)
{
    gt_lead_through law;
    gt_lead_through_state state, next;
    int n;

    if (!gt_lead_through_of(&law, numbers)) {
        return 0;
    }
    state.translation = gt_surface_start(&law.translation, GT_WRENCH_OK);
    state.rotation = gt_turning_start();
    for (n = 0; n < count; n++) {
        const double *row = &rows[23 * n];
        double *to = &out[33 * n];
        const gt_wrench handle = wrench_at(row, row[12]), tool = wrench_at(&row[6], row[13]);

        next = gt_lead_through_step(&law, &state, &handle, &tool, &row[14]);
        gt_vector_to(&to[0], next.translation.velocity_m_s);
        gt_vector_to(&to[3], next.translation.guided_m_s);
        gt_vector_to(&to[6], next.translation.normal);
        gt_vector_to(&to[9], next.translation.filtered);
        to[12] = (double)next.translation.contact;
        to[13] = next.translation.since;
        to[14] = next.translation.slow_N;
        to[15] = next.translation.energy_N2;
        to[16] = next.translation.share;
        to[17] = (double)next.translation.status;
        to[18] = (double)next.translation.allowed;
        gt_vector_to(&to[19], next.rotation.rate_rad_s);
        gt_vector_to(&to[22], next.rotation.guided_rad_s);
        gt_vector_to(&to[25], next.rotation.across);
        to[28] = next.rotation.about_rad;
        to[29] = to[30] = to[31] = to[32] = 0.0;
        if (n < again) {
            state = next;
        }
    }
    return 1;
}

int begins(const double *numbers, const double *row)
{
    gt_lead_through law;
    const gt_wrench handle = wrench_at(row, row[12]), tool = wrench_at(&row[6], row[13]);

    return gt_lead_through_of(&law, numbers)
               ? (int)gt_lead_through_start(&law, &handle, &tool, &row[14]).translation.status : -1;
}
"""


@dataclass
class Library:
    """The compiled step."""

    loaded: ctypes.CDLL

    @classmethod
    def made(cls, place: Path, *flags: str) -> Library:
        source, target = place / "exported.c", place / "lead.so"
        source.write_text(EXPORTED)
        files = [str(PLACES[1] / f"{name}.c") for name in NAMES] + [str(source)]
        command = [
            "cc",
            "-std=c99",
            "-O2",
            "-ffp-contract=off",
            *flags,
            *(f"-I{p}" for p in PLACES),
            "-fPIC",
            "-shared",
        ]
        done = subprocess.run([*command, *files, "-o", str(target), "-lm"], capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        return cls(ctypes.CDLL(str(target)))

    def cycles(self, law: LeadThroughLaw, rows: np.ndarray, again: int | None = None) -> np.ndarray:
        """(n, OUT) states, a row for each cycle."""
        out = np.zeros((len(rows), OUT))
        numbers, given = numbers_of(law, 1.0).rows.copy(), np.ascontiguousarray(rows, float)
        assert given.shape[1] == COLUMNS
        good = self.loaded.cycles(_at(numbers), _at(given), len(rows), len(rows) if again is None else again, _at(out))
        assert good == 1
        return out

    def begins(self, law: LeadThroughLaw, row: np.ndarray, drift: float = 1.0) -> int:
        """The wrench status of a start; -1 for numbers that are none of a law."""
        return self.loaded.begins(_at(numbers_of(law, drift).rows.copy()), _at(np.ascontiguousarray(row, float)))

    def refused(self, numbers: np.ndarray, row: np.ndarray) -> bool:
        """Whether a row of numbers is none of a law."""
        return self.loaded.begins(_at(numbers), _at(row)) == -1


def by_python(law: LeadThroughLaw, rows: np.ndarray, again: int | None = None) -> np.ndarray:
    """The same by the law itself."""
    state, out = law.start(OK, OK), []
    for n, row in enumerate(rows.tolist()):
        turn = (tuple(row[14:17]), tuple(row[17:20]), tuple(row[20:23]))
        handle, tool = ((tuple(row[k : k + 3]), tuple(row[k + 3 : k + 6])) for k in (0, 6))
        step: Any = law.step
        following = step(state, handle, tool, turn, row[12] * law.cycle, row[13] * law.cycle)
        out.append(_flat(following))
        if again is None or n < again:
            state = following
    return np.array(out)


def _flat(state: LeadThroughState) -> list[float]:
    t, r = state.translation, state.rotation
    numbers = [*t.velocity, *t.guided, *t.normal, *t.filtered, t.contact, t.since, *t.watched, t.status, t.allowed]
    return [float(x) for x in (*numbers, *r.rate, *r.guided, *r.across, r.about, 0, 0, 0, 0)]


def _at(array: np.ndarray) -> Any:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
