"""The nonlinear problem of one cycle, in C from the same plan at rest, cold: ours repeats linearising and its quadratic
program; CasADi generates `sqpmethod` with `qrqp`, given the same Hessian of Gauss and Newton."""

from __future__ import annotations

import ctypes
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from gtmodel._files import codegen_dir
from gtmodel.cgen.body import body
from gtmodel.predictive import Controller
from gtmodel.predictive.qp_text import QPText, called
from tests.bench.callgrind import _run
from tests.bench.rivals.horizon_rivals import compiled
from tests.predictive.compiled import FLAGS, SHARED

STEP = 1e-6  # of the last change, relative to 1 + the number
PROGRAMS = 30  # at most
MAX_ITER = 1000  # of qrqp
SCALE = 1e-3  # of the rival's cost, whose tolerances are absolute
UNIT = 20.0  # of the rival's inputs: their tolerance

_SQP = """\
#include "gt_sqp_body.h"
#include "gt_stage_qp.h"

%(table)s
int gt_sqp_solve(const double *at, const double *p, double *plan_x, double *plan_v, int *programs)
{
    gt_stage_qp_work work;
    gt_stage_qp_call call;
    gt_stage_qp_outcome out = {0, 0.0, 0.0, 0.0, 0.0};
    static double data[%(count)d * %(numbers)d], last[%(last)d], kept[%(sides)d];
    const double *arg[5];
    double *res[1];
    double step = 1.0;
    int status = 0;
    int k;
%(arrays)s
%(pointers)s
    call.f = &sqp_qp;
    call.data = data;
    call.last_data = last;
    call.w = &work;
    for (*programs = 0; (status == 0) && (step > %(step)r) && (*programs < %(most)d); (*programs)++) {
        for (k = 0; k <= %(count)d; k++) {
            arg[0] = &plan_x[k * %(n)d];
            arg[1] = (k < %(count)d) ? &plan_v[k * %(m)d] : data;
            arg[2] = (k < %(count)d) ? data : p;
            arg[3] = p;
            arg[4] = &plan_x[(k + 1) * %(n)d];
            res[0] = (k < %(count)d) ? &data[k * %(numbers)d] : last;
            (void)((k < %(count)d) ? sqp_prepare : sqp_finish)(arg, res, 0, 0, 0);
        }
        for (k = 0; k < %(n)d; k++) {
            x[k] = at[k] - plan_x[k];
        }
        for (k = 0; k < %(count)d * %(m)d; k++) {
            u[k] = 0.0;
        }
        status = gt_stage_qp_solve(&call, (*programs > 0) ? kept : 0, &out);
        gt_stage_qp_copy(kept, sides, %(sides)d);
        step = 0.0;
        for (k = 0; k < (%(count)d + 1) * %(n)d; k++) {
            step = gt_stage_qp_larger(fabs(x[k]) / (1.0 + fabs(plan_x[k])), step);
            plan_x[k] += x[k];
        }
        for (k = 0; k < %(count)d * %(m)d; k++) {
            step = gt_stage_qp_larger(fabs(u[k]) / (1.0 + fabs(plan_v[k])), step);
            plan_v[k] += u[k];
        }
    }
    return (step > %(step)r) ? 1 : status;
}
"""


class Repeated:
    """The programs of a controller, repeated in C."""

    def __init__(self, c: Controller, folder: Path) -> None:
        program, qp = c.program, c.program.qp
        n, m, count = qp.stage.states, qp.stage.inputs, qp.count
        of = QPText(qp, "sqp")
        own = [called(getattr(program, name), f"sqp_{name}") for name in ("prepare", "finish")]
        source, declarations = body("sqp", [], [*own, *of.kernels()])
        arrays, pointers = of.memory()
        text = _SQP % {
            "table": of.table(), "arrays": arrays, "pointers": pointers, "n": n, "m": m, "count": count,
            "numbers": qp.stage.numbers, "last": qp.last.numbers, "sides": of.sides, "step": STEP, "most": PROGRAMS,
        }  # fmt: skip
        folder.mkdir()
        for name in SHARED:
            (folder / name).write_text((codegen_dir() / "runtime" / name).read_text())
        (folder / "gt_sqp_body.h").write_text(declarations)
        (folder / "sqp.c").write_text(source + text)
        _run("gcc", *FLAGS, "-shared", "-fPIC", f"-I{folder}", folder / "sqp.c", "-o", folder / "sqp.so", "-lm")
        self._solve, self.c = ctypes.CDLL(str(folder / "sqp.so")).gt_sqp_solve, c

    def __call__(self, x0: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, int, float]:
        """States, inputs, programs (0: not solved), CPU time."""
        count, programs = self.c.program.qp.count, ctypes.c_int()
        x, v = np.tile(x0, (count + 1, 1)), np.tile(self.c.first, (count, 1))
        begun = time.process_time()
        status = self._solve(*[ctypes.c_void_p(a.ctypes.data) for a in (x0, p, x, v)], ctypes.byref(programs))
        spent = time.process_time() - begun
        return x, v, 0 if status else programs.value, spent


class BySqpmethod:
    """`sqpmethod` with `qrqp`, generated and compiled: states, inputs and excesses of the soft limits decide."""

    def __init__(self, c: Controller, folder: Path) -> None:
        program, qp = c.program, c.program.qp
        n, m, count = qp.stage.states, qp.stage.inputs, qp.count
        s = program.statement
        rows, size = len(s.rows), np.array([r.size for r in s.rows])
        soft = [k for k, r in enumerate(s.rows) if r.soft]
        x, v = ca.MX.sym("x", n, count + 1), ca.MX.sym("v", m, count)
        e, p = ca.MX.sym("e", 2 * len(soft), count + 1), ca.MX.sym("p", s.p.numel())
        at = ca.MX.sym("at", n)
        values = program.rows.map(count)(x[:, :-1], v, v, p) / size
        end = program.rows(x[:, -1], v[:, -1], v[:, -1], p) / size
        low, high = (np.array([getattr(r, k) for r in s.rows]) / size for k in ("low", "high"))
        hard = [k for k in range(rows) if k not in soft]
        price = np.array([q.price for r, q in zip(s.rows, qp.stage.rows, strict=True) if r.soft])
        prices = [np.repeat(price[:, k], 2) for k in (0, 1)]
        limited = ca.horzcat(values[soft, :], end[soft])
        g = ca.vertcat(
            x[:, 0] - at, ca.vec(program.step.map(count)(x[:, :-1], v, p) - x[:, 1:]), ca.vec(values[hard, :]),
            ca.vec(limited + e[::2, :]), ca.vec(limited - e[1::2, :]),
        )  # fmt: skip
        gaps, free = n * (count + 1), len(soft) * (count + 1)
        self.lbg = np.concatenate([np.zeros(gaps), np.tile(low[hard], count), np.tile(low[soft], count + 1),
                                   np.full(free, -np.inf)])  # fmt: skip
        self.ubg = np.concatenate([np.zeros(gaps), np.tile(high[hard], count), np.full(free, np.inf),
                                   np.tile(high[soft], count + 1)])  # fmt: skip
        cost = ca.sum2(program.cost.map(count)(x[:, :-1], v, p)) + program.final_cost(x[:, -1], p)
        cost += ca.sum2(ca.mtimes(prices[0][None, :], e) + ca.mtimes(prices[1][None, :], e**2) / 2)
        w = ca.MX.sym("w", m, count)
        g, cost = ca.substitute([g, cost], [v], [UNIT * w])
        z = ca.veccat(x, w, e)
        cost *= SCALE
        # the cost is a sum of squares of expressions linear in x and v in this problem's causality: its Hessian is that
        # of Gauss and Newton
        hessian = ca.hessian(cost, z)[0]
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
        split = ca.MX.sym("parameters", n + s.p.numel())
        g, cost, hessian = ca.substitute([g, cost, hessian], [at, p], [split[:n], split[n:]])
        options: dict[str, Any] = {
            "qpsol": "qrqp", "print_time": False, "print_header": False, "print_iteration": False,
            "print_status": False, "max_iter": PROGRAMS, "max_iter_ls": 0, "tol_pr": STEP, "tol_du": STEP,
            "error_on_fail": False,
            "hess_lag": ca.Function("gauss_newton", [z, split, lam_f, lam_g], [hessian]),
            "qpsol_options": {
                "print_iter": False, "print_header": False, "error_on_fail": False, "max_iter": MAX_ITER,
                "dual_inf_tol": STEP, "constr_viol_tol": STEP,
            },
        }  # fmt: skip
        solver = ca.nlpsol("rival", "sqpmethod", {"x": z, "p": split, "f": cost, "g": g}, options)
        self.solver, self.c = compiled(solver, folder), c
        self.lbx = np.concatenate([np.full(n * (count + 1) + m * count, -np.inf), np.zeros(2 * free)])
        self.sizes = n * (count + 1), m * count, 2 * free

    def __call__(self, x0: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """States, inputs, CPU time."""
        count = self.c.program.qp.count
        start = np.concatenate([np.tile(x0, count + 1), np.tile(self.c.first / UNIT, count), np.zeros(self.sizes[2])])
        begun = time.process_time()
        o = self.solver(
            x0=start, p=np.concatenate([x0, p]), lbx=self.lbx, ubx=np.inf, lbg=self.lbg, ubg=self.ubg
        )  # fmt: skip
        spent = time.process_time() - begun
        z = o["x"].full()[:, 0]
        a, b = self.sizes[0], self.sizes[0] + self.sizes[1]
        return z[:a].reshape(count + 1, -1), UNIT * z[a:b].reshape(count, -1), spent
