"""Forward dynamics of a serial arm of revolute joints by hand: articulated bodies, and composite bodies with Cholesky.

Standard Denavit-Hartenberg parameters (a, d, alpha); vectors in the frames of the links, numbers folded in. A joint
turns about z of the frame before; z and p, the origin seen from the joint, are constant in the link's frame.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from gtmodel.compiler.emission import with_differences, with_gathered_constants, without_factors

GRAVITY = 9.81


class Link(NamedTuple):
    """A link at its joint's angle: rotation to the frame before, lever, axis, mass, first moments, inertia about the
    origin."""

    R: ca.SX
    p: ca.SX
    z: ca.SX
    m: ca.SX
    mc: ca.SX
    J: ca.SX


def links_of(arm: Any, a: np.ndarray, d: np.ndarray, alpha: np.ndarray, q: ca.SX) -> list[Link]:
    links = []
    for k in range(len(a)):
        c, s = ca.cos(q[k]), ca.sin(q[k])
        cos, sin = (float(x) if abs(x) > 1e-12 else 0.0 for x in (np.cos(alpha[k]), np.sin(alpha[k])))
        R = ca.blockcat([[c, -s * cos, s * sin], [s, c * cos, -c * sin], [0, sin, cos]])
        xx, xy, xz, yy, yz, zz = map(float, arm.J[k])
        J = ca.SX(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        lever, axis = ca.SX(np.array([a[k], d[k] * sin, d[k] * cos])), ca.SX(np.array([0.0, sin, cos]))
        links.append(Link(R, lever, axis, ca.SX(float(arm.m[k])), ca.SX(np.array(arm.mc[k], float)), J))
    return links


def inverse(links: list[Link], rate: ca.SX, acceleration: ca.SX) -> ca.SX:
    """Return the torques by Newton and Euler."""
    w, turn, a = ca.SX.zeros(3), ca.SX.zeros(3), ca.vertcat(0, 0, ca.SX(GRAVITY))
    loads = []
    for k, (R, p, z, m, mc, J) in enumerate(links):
        before = R.T @ w
        w = before + z * rate[k]
        turn = R.T @ turn + z * acceleration[k] + ca.cross(before, z * rate[k])
        a = R.T @ a + ca.cross(turn, p) + ca.cross(w, ca.cross(w, p))
        force = m * a + ca.cross(turn, mc) + ca.cross(w, ca.cross(w, mc))
        loads.append((force, J @ turn + ca.cross(w, J @ w) + ca.cross(mc, a)))
    torques, f, t = [], ca.SX.zeros(3), ca.SX.zeros(3)
    for link, (force, torque) in zip(reversed(links), reversed(loads), strict=True):
        force = force + f
        torque = torque + t + ca.cross(link.p, force)
        torques.insert(0, ca.dot(link.z, torque))
        f, t = link.R @ force, link.R @ torque
    return ca.vertcat(*torques)


def by_composite_bodies(links: list[Link], rate: ca.SX, torque: ca.SX) -> ca.SX:
    """Return the accelerations with the mass matrix of composite bodies and a Cholesky factorisation."""
    n = len(links)
    M = [[ca.SX(0)] * n for _ in range(n)]
    m, h, inertia = ([link[k] for link in links] for k in (3, 4, 5))
    for i in reversed(range(n)):
        R, p, z = links[i][:3]
        moment = h[i] + m[i] * p  # about the joint
        twice = -skew(h[i]) @ skew(p)
        J = inertia[i] + twice + twice.T - m[i] * (skew(p) @ skew(p))
        f, t = ca.cross(z, moment), J @ z
        M[i][i] = ca.dot(z, t)
        f, t = R @ f, R @ t
        for j in reversed(range(i)):
            t = t + ca.cross(links[j].p, f)
            M[i][j] = ca.dot(links[j].z, t)
            f, t = links[j].R @ f, links[j].R @ t
        if i:
            m[i - 1], h[i - 1] = m[i - 1] + m[i], h[i - 1] + R @ moment
            inertia[i - 1] = inertia[i - 1] + turned(R, J)
    right = ca.vertsplit(torque - inverse(links, rate, ca.SX.zeros(n)))
    reciprocals = []
    for k in range(n):
        reciprocals.append(1 / M[k][k])
        for i in range(k + 1, n):
            factor = M[i][k] * reciprocals[k]
            right[i] = right[i] - factor * right[k]
            for j in range(k + 1, i + 1):
                M[i][j] = M[i][j] - factor * M[j][k]
    x: list[ca.SX] = [ca.SX(0)] * n
    for k in reversed(range(n)):
        x[k] = (right[k] - sum((M[i][k] * x[i] for i in range(k + 1, n)), ca.SX(0))) * reciprocals[k]
    return ca.vertcat(*x)


def by_articulated_bodies(links: list[Link], rate: ca.SX, torque: ca.SX) -> ca.SX:
    """Return the accelerations by articulated bodies: [t; f] = [A, B; B', M] [turn; a] + load about each joint."""
    n, w = len(links), ca.SX.zeros(3)
    bias, load = [], []
    for k, (R, p, z, _, mc, J) in enumerate(links):
        before = R.T @ w
        w = before + z * rate[k]
        bias.append((ca.cross(before, z * rate[k]), ca.cross(w, ca.cross(w, p))))
        load.append((ca.cross(w, J @ w), ca.cross(w, ca.cross(w, mc))))
    A, B, M = [link.J for link in links], [skew(link.mc) for link in links], [link.m * ca.SX.eye(3) for link in links]
    M = [ca.densify(each) for each in M]
    kept: list[tuple[ca.SX, ca.SX, ca.SX, ca.SX]] = []
    for k in reversed(range(n)):
        R, p, z = links[k][:3]
        lever = skew(p)
        across = B[k] + lever @ M[k]
        about = symmetric(A[k] - B[k] @ lever + lever @ B[k].T - lever @ M[k] @ lever)
        f = load[k][1] + M[k] @ bias[k][1]
        t = load[k][0] + B[k] @ bias[k][1] + ca.cross(p, f)
        along, push = about @ z, across.T @ z
        share = 1 / ca.dot(z, along)
        rest = torque[k] - ca.dot(z, t + about @ bias[k][0])
        kept.insert(0, (along, push, share, rest))
        if k:
            t, f = t + about @ bias[k][0] + along * (share * rest), f + across.T @ bias[k][0] + push * (share * rest)
            load[k - 1] = load[k - 1][0] + R @ t, load[k - 1][1] + R @ f
            A[k - 1] = A[k - 1] + turned(R, symmetric(about - (along * share) @ along.T))
            B[k - 1] = B[k - 1] + R @ (across - (along * share) @ push.T) @ R.T
            M[k - 1] = M[k - 1] + turned(R, symmetric(M[k] - (push * share) @ push.T))
    turn, a, x = ca.SX.zeros(3), ca.vertcat(0, 0, ca.SX(GRAVITY)), []
    for link, (along, push, share, rest), (about, across) in zip(links, kept, bias, strict=True):
        turn, a = link.R.T @ turn, link.R.T @ a
        x.append(share * (rest - ca.dot(along, turn) - ca.dot(push, a)))
        turn = turn + link.z * x[-1] + about
        a = a + ca.cross(turn, link.p) + across
    return ca.vertcat(*x)


def skew(v: ca.SX) -> ca.SX:
    return ca.blockcat([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def symmetric(a: ca.SX) -> ca.SX:
    """Return the matrix of the lower triangle."""
    return ca.blockcat([[a[max(i, j), min(i, j)] for j in range(3)] for i in range(3)])


def turned(R: ca.SX, a: ca.SX) -> ca.SX:
    return symmetric(R @ a @ R.T)


def shortened(expression: ca.SX) -> ca.SX:
    """Return an expression after the passes that gtmodel makes on its own functions."""
    shared = ca.cse(with_differences(ca.cse(without_factors(ca.cse([expression])))))
    return ca.cse(with_gathered_constants(shared))[0]
