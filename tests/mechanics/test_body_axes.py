"""Equations of trees of bodies, read in the axes of the bodies: operations of recursions by hand, the same values."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import mechanics as m
from tests.bench.bench_chains import ARMS, arm
from tests.mechanics.arms import industrial_arm
from tests.support.compare import relative_error

# round-off of two recursions; condition of the mass matrices below 1e4
ROUND_OFF = 1e-10
# the arms by hand of tests/bench/rivals/arm_dynamics_by_hand.py, their operations with the reading of inputs, and 1.1
BY_HAND, RATIO = {"inverse": 776, "forward": 1257}, 1.1


def forward_and_inverse(model, q, effort):
    rates = [f"der({name},2)" for name in q] if isinstance(q, list) else f"der({q},2)"
    return model.causal(effort, rates, prefer=q), model.causal(q, effort)


def test_an_arm_needs_the_operations_of_recursions_by_hand():
    forward, inverse = forward_and_inverse(arm(*ARMS["UR5e"]), "q", "tau")
    inputs_and_outputs = 4 * 6
    assert inverse.closed.n_instructions() - inputs_and_outputs <= RATIO * BY_HAND["inverse"]
    assert forward.closed.n_instructions() - inputs_and_outputs <= RATIO * BY_HAND["forward"]


def test_axes_parallel_at_home_stay_exact_far_from_it():
    # near home powers of the small angles vanish: equal entries must be found elsewhere
    forward, inverse = forward_and_inverse(industrial_arm().model(), "q", "tau")
    q, rate, effort = np.random.default_rng(5).uniform(-2.0, 2.0, (3, 20, 6))
    acceleration, status = forward(q, rate, 50.0 * effort)
    assert np.all(status == gt.Status.OK)
    assert relative_error(inverse(q, rate, acceleration)[0], 50.0 * effort) < ROUND_OFF


def tree(joints: str, parents: list[int], load: bool = False) -> tuple[gt.Builder, list[str], list[str]]:
    """Bodies behind revolute (r), prismatic (p) and cylindrical (c) joints with synthetic numbers, seed 4."""
    rng = np.random.default_rng(4)
    bench = gt.Builder("tree")
    frames, q, effort = [bench.part("ground", m.Ground()).frame], [], []
    for k, (kind, parent) in enumerate(zip(joints, parents, strict=True)):
        axis = rng.normal(size=3)
        joint = bench.part(
            f"j{k}", m.Prismatic(v=axis) if kind == "p" else (m.Cylindrical if kind == "c" else m.Revolute)(axis=axis)
        )
        link = bench.part(f"x{k}", m.FixedRpy(xyz=rng.normal(size=3) * 0.3, rpy=rng.normal(size=3)))
        root = rng.normal(size=(3, 3)) * 0.2
        body = m.RigidBody(m=rng.uniform(1, 3), c=rng.normal(size=3) * 0.2, I=root @ root.T + 0.05 * np.eye(3))
        bench.add(gt.connect([frames[parent], joint.b, link.b], [joint.a, link.a, bench.part(f"b{k}", body).frame]))
        if kind != "p":
            bench.add(gt.connect(joint.shaft, bench.part(f"m{k}", m.TorqueMotor()).shaft))
            q, effort = [*q, f"j{k}.shaft.phi"], [*effort, f"m{k}.torque"]
        if kind != "r":
            bench.add(gt.connect(joint.flange, bench.part(f"f{k}", m.ForceMotor()).flange))
            q, effort = [*q, f"j{k}.flange.s"], [*effort, f"f{k}.force"]
        frames.append(link.b)
    if load:
        bench.add(gt.connect(frames[-1], bench.part("load", m.FrameLoad()).frame))
    return bench, q, effort


@pytest.mark.parametrize("joints,parents", [("rrrrr", [0, 1, 1, 2, 3]), ("rpc", [0, 1, 2])])
def test_forward_dynamics_of_a_tree_inverts_its_inverse_dynamics(joints, parents):
    bench, q, effort = tree(joints, parents)
    forward, inverse = forward_and_inverse(bench, q, effort)
    n = len(q)
    x, v, u = np.random.default_rng(6).uniform(-1.0, 1.0, (3, n))
    by_order = {name: value for name, *_, value in zip(q, x, strict=True)}
    by_order |= {f"der({name})": value for name, value in zip(q, v, strict=True)}
    by_order |= dict(zip(effort, u, strict=True))
    *acceleration, status = forward(*[by_order[s.name] for s in forward.inputs])
    assert status == gt.Status.OK
    by_order |= {f"der({name},2)": value for name, value in zip(q, acceleration, strict=True)}
    *found, _ = inverse(*[by_order[s.name] for s in inverse.inputs])
    assert relative_error(np.array(found), u) < ROUND_OFF


def test_forces_on_bodies_and_reactions_are_in_world_axes():
    bench, q, _ = tree("rrr", [0, 1, 2], load=True)
    mass = [f"b{k}" for k in range(3)]
    wanted = ["ground.frame.f", *[f"{b}.frame.f" for b in mass]]
    f = bench.causal([*q, "load.force", "load.torque"], wanted)
    rng = np.random.default_rng(7)
    by_name = {s.name: rng.uniform(-1.0, 1.0, s.shape) for s in f.inputs}
    reaction, *on_bodies, status = f(*by_name.values())
    assert status == gt.Status.OK
    # a flow acts on its own component: the ground exerts the opposite on the tree
    assert relative_error(-reaction, np.sum(on_bodies, axis=0) - by_name["load.force"]) < ROUND_OFF
