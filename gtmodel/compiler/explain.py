"""Text that describes how a causality is computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .analysis.sizes import DOUBLE

if TYPE_CHECKING:
    from .causal import CausalFunction
    from .closed_form.known_chain import KnownChain
    from .plan import CausalPlan


def explain(f: CausalFunction, full: bool = True) -> str:
    """Describe inputs, outputs, structure, and every block with its kind, unknowns, branch and equations.

    full: if False, list only conditions on known values and signs of roots.
    """
    plan, flat = f.plan, f.flat
    lines = [
        f"{flat.title}: {', '.join(s.name for s in f.outputs)} from {', '.join(s.name for s in f.inputs) or 'nothing'}",
        f"  {len(flat.equations)} equations, {len(plan.alias.equations)} after {len(plan.alias.removed)} aliases; "
        f"index {plan.structure.index}; {plan.structure.degrees_of_freedom} degrees of freedom",
    ]
    states = [flat.symbol_name(*p) for p in plan.states]
    if states:
        lines.append(f"  states: {', '.join(states)}")
    limited = [
        f"{s.name} {limit:.4g} {s.unit}"
        for s, limit in zip(f.inputs, f.sizes.limits, strict=False)
        if limit < DOUBLE.largest
    ]
    if limited:
        lines.append(f"  largest norms of inputs: {', '.join(limited)}")
    counts: dict[str, int] = {}
    for b in plan.blocks:
        counts[b.kind] = counts.get(b.kind, 0) + 1
    lines.append("  blocks: " + (", ".join(f"{n} {kind}" for kind, n in sorted(counts.items())) or "none"))
    lines[-1] += "" if full or not plan.blocks else "; add --full to list each with its source lines"
    for n, b in enumerate(plan.blocks, 1):
        if b.kind == "condition":
            lines += [f"  {n:3d} {b.detail}: {e}" for e in b.equations]
            continue
        if b.kind == "explicit":
            block = [f"  {n:3d} explicit  {b.unknowns[0]}  from {b.equations[0]}"]
            lines += block if full else []
            continue
        unknowns = f"{len(b.unknowns)} unknown{'s' if len(b.unknowns) != 1 else ''}"
        block = [f"  {n:3d} {b.kind}, {unknowns}: {', '.join(b.unknowns)}", f"      {b.detail}"]
        lines += block if full else []
        for r in b.roots:
            source = "from the start values"
            if r.settled_by:
                source = f"from branch '{r.settled_by}'"
            elif r.default:
                started = plan.chain is not None and plan.chain.started
                source = f"by default: {'the start values are singular' if started else 'there are no start values'}"
            lines.append(f"      root of {r.label}: sign {'+' if r.value > 0 else '-'}, {source}")
        for m in b.margins if full else ():
            requirement = "must not be negative" if m.kind == "discriminant" else "must not vanish"
            lines.append(f"      {m.kind} of {m.label} {requirement} (typical size {m.scale:.3g})")
        lines += [f"      {e}" for e in b.equations] if full else []
    if branches := [m.label for m in plan.sides if m.kind == "branch"]:
        lines.append(f"  branches of Newton's solutions: {', '.join(branches)}")
    lines += [f"  {note}" for note in flat.loops.notes]
    if plan.chain is not None and not plan.newton:
        lines.append(_start(plan.chain, [r.name for b in plan.blocks for r in b.roots if r.name and r.default]))
    elif plan.newton or any(not r.settled_by for b in plan.blocks for r in b.roots):
        lines += _home(plan)
    lines += [f"  {note}" for note in f.notes]
    assumed = sorted(q.name for q in flat.parameters if q.nonzero)
    if assumed:
        lines.append(f"  assumes nonzero: {', '.join(assumed)}")
    if plan.undetermined:
        names = [flat.variables[i].name for i in plan.undetermined]
        lines.append(f"  not determined by the known variables, and not needed: {', '.join(names)}")
    if flat.branches:
        lines.append(f"  declared branches: {', '.join(b.name for b in flat.branches)}")
    return "\n".join(lines)


def _start(chain: KnownChain, default: list[str]) -> str:
    """Return the home pose of a chain of joints solved in closed form, and the branches that it does not select."""
    line = f"  home pose: {chain.start_text}" if chain.started else "  no home pose: the joints have no start values"
    if chain.started and default:
        line += f", singular for {', '.join(default)}: another start, or `branches`, selects these branches"
    return line


def _home(plan: CausalPlan) -> list[str]:
    """Return the pose that roots and Newton's method continue: top-level variables that occur in the equations.

    Forces are left out, because their values belong to arbitrary rates: of the variables differentiated less often than
    positions, only those that roots and Newton's method solve for are listed.
    """
    flat, place = plan.flat, {pair: n for n, pair in enumerate(plan.pairs)}
    order = {i: k for i, k in sorted(plan.pairs)}  # the highest of each variable
    top = max(order.values(), default=0)
    continued = {name for b in plan.blocks if b.newton is not None or b.roots for name in b.unknowns}
    parts = []
    for name, (_, indices) in flat.groups.items():
        resolved = [plan.alias.resolve(i, 0) for i in indices]
        if "." in name or not all((kept, k) in place for _, kept, k in resolved):
            continue
        if all(order[kept] < top for _, kept, _ in resolved) and not continued & {
            flat.symbol_name(kept, k) for _, kept, k in resolved
        }:
            continue
        values = [f"{sign * plan.samples[0][place[kept, k]]:.6g}" for sign, kept, k in resolved]
        parts.append(f"{name} = {values[0] if len(values) == 1 else '[' + ', '.join(values) + ']'}")
    moved = "  the start values are singular: the home pose is a regular one near them" if plan.singular else ""
    return [f"  home pose: {'; '.join(parts)}", *([moved] if moved else [])] if parts else []
