"""The balance of the energies that a model declares, checked in parts of the energy that moved."""

from __future__ import annotations

import casadi as ca

from ..compiler.flat import FlatModel
from ..results.check import Check

# of the energy that moved: amplitudes are right to half of it, which no picture shows. The default tolerance keeps an
# undamped motion below it for some two hundred periods, and any damped or driven one
ENERGY_BALANCE = 1e-4


def balance(error: float | None, moved: float) -> dict[str, Check]:
    """The check "energy_balance" of a model with energies: the error of their balance [J] in parts of what moved [J].

    Where nothing moved, as at rest, nothing is lost either.
    """
    if error is None:
        return {}
    return {"energy_balance": Check(error / moved if moved > 0 else error, ENERGY_BALANCE, "use a smaller tolerance")}


def unbalanced(checks: dict[str, Check], moved: float) -> str:
    """A sentence for a balance that does not hold; else an empty one."""
    check = checks.get("energy_balance")
    if check is None or check.passed:
        return ""
    return (
        f"the energy balance is off by {check.value:.2g} of the {moved:.3g} J that moved, more than "
        f"{check.bound:g}: {check.advice}"
    )


def stored_terms(flat: FlatModel) -> list[ca.SX]:
    """Terms of the stored energies, in original symbols: kinetic and potential energy of a swinging mass, apart.

    Their sum is conserved where nothing is supplied or dissipated, and says nothing about how much energy moves.
    """
    return [term for e in flat.energies if e.kind == "stored" for term in _terms(ca.SX(e.expression), ca.SX(1))]


def _terms(e: ca.SX, factor: ca.SX) -> list[ca.SX]:
    """Addends of an expression, also of a sum that is multiplied or divided by something that does not move."""
    if e.is_leaf() or e.numel() != 1:
        return [factor * e]
    operation = e.op()
    if operation in (ca.OP_ADD, ca.OP_SUB):
        return [t for k in range(2) for t in _terms(e.dep(k), factor)]
    if operation == ca.OP_MUL:
        for k in range(2):
            if e.dep(k).is_constant():
                return _terms(e.dep(1 - k), factor * e.dep(k))
    if operation == ca.OP_DIV and e.dep(1).is_constant():
        return _terms(e.dep(0), factor / e.dep(1))
    return [factor * e]
