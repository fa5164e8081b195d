"""Rows summed some poses at a time, against all of them at once in dense matrices."""

import sys
import tracemalloc

import numpy as np
import pytest

from gtmodel.calibrate import Choice, block_rows, calibrate, prepare
from gtmodel.calibrate.problem import noise_covariance
from gtmodel.inference import Prior
from gtmodel.inference.weighting import loss_named, prior_rows
from tests.calibrate.synthetic import measured, true_robot

NOISE = {"q": 13e-6, "T": 50e-6}
CLOSE = 1e-10  # of a standard deviation, and of a covariance
PRIORS = (Prior("A[0,0]", -1.8085, 1e-4), Prior("L[2]", 2.0613, 3e-5))


def ready(kind="three_link", number=41, known=True, priors=(), seed=0):
    noise = {**NOISE, "e": 1e-4} if kind.startswith("f1") else NOISE
    return prepare(true_robot(kind), measured(kind, number, noise, seed, known), Choice(priors=priors))


def dense_rows(p, cost, x, sigma):
    """By block: its columns, r (N, k), J (N, k, n), Jacobian in the noise (N, k, ny), of all poses at once."""
    out = []
    for b in p.blocks_of(cost):
        if cost in ("length", "squared"):
            r, J, B, _ = b.evaluate_all(p.reading.data, x[b.columns])
            s = sigma(b)
            out.append((b.columns, r / s, J / s, B / s))
        else:
            a = p.adjustment(b, noise_covariance(p, cost))
            out.append((b.columns, *a.per_pose(x[b.columns]), a.by_noise(x[b.columns])))
    return out


def level(p):
    """Typical size of a residual at the start, by block with priors: what these are weighed against."""

    def sigma(b):
        if not {q.name for q in p.unknowns.priors} & {p.unknowns.names[k] for k in b.columns}:
            return 1.0
        S = noise_covariance(p, "orthogonal")[0]
        B = b.evaluate_all(p.reading.data, p.unknowns.start[b.columns])[2]
        return np.sqrt(np.mean(np.einsum("kmi,ij,kmj->km", B, S, B)))

    return sigma


def dense_covariance(p, parts, loss, width, known):
    """Covariance of the unknowns and the scaled residuals, by the gain of every residual (N, k, n)."""
    u, N, n = p.unknowns, len(p.measurements), len(p.unknowns.names)
    gains, rests, slopes, jacobians, by_noise, freedoms, priors = [], [], [], [], [], [], np.zeros((n, n))
    for columns, r, J, B in parts:
        own = tuple(q for q in u.priors if q.name in {u.names[k] for k in columns})
        P, _ = prior_rows(own, tuple(u.names[k] for k in columns))
        z, size = (r / width) ** 2, u.sizes[columns]
        W = (loss.weight(r, width)[..., None] * J * size).reshape(-1, len(columns))
        inverse = np.linalg.pinv(np.vstack([W, P * size]), rcond=1e-9)
        inverse = inverse @ inverse.T
        freedoms.append(r.size - np.sum((W @ inverse) * W))
        sharp = np.mean(loss.slope(z) + 2 * z * loss.bend(z)) / np.mean(loss.slope(z))
        inverse = inverse * np.outer(size, size) / sharp
        gain, full = np.zeros((N, r.shape[1], n)), np.zeros((N, r.shape[1], n))
        gain[..., columns], full[..., columns] = J @ inverse, J
        priors[np.ix_(columns, columns)] += (P @ inverse).T @ (P @ inverse)
        for kept, new in zip(
            (gains, rests, slopes, jacobians, by_noise), (gain, r, r * loss.slope(z), full, B), strict=True
        ):
            kept.append(new)
    G, r, psi, J = (np.concatenate(a, axis=1) for a in (gains, rests, slopes, jacobians))
    if known:
        B = np.concatenate(by_noise, axis=1)
        omega = B @ noise_covariance(p, "orthogonal") @ B.transpose(0, 2, 1)
    else:
        part = np.concatenate([np.full(a.shape[1], f / a.shape[1]) for a, f in zip(rests, freedoms, strict=True)])
        omega = np.broadcast_to(psi.T @ psi / np.sqrt(np.outer(part, part)), (N, len(part), len(part)))
    cov = np.einsum("kci,kcd,kdj->ij", G, omega, G) + priors
    if not known:
        return cov, psi
    size = np.sqrt(np.diagonal(omega, axis1=1, axis2=2))
    D, J, G = omega / (size[..., None] * size[:, None]), J / size[..., None], G * size[..., None]
    expected = r.size - 2 * np.sum((D @ G) * J) + np.einsum("kin,nm,kim->", J, cov, J)
    return cov, r / size * np.sqrt(sum(freedoms) / expected)


def dense_optimum(p, cost, loss, width, x):
    """Gauss-Newton by lstsq on all rows of all blocks at once."""
    u, sigma = p.unknowns, level(p)
    P, prior = prior_rows(u.priors, u.names)
    for _ in range(500):
        blocks = []
        for columns, r, J, _ in dense_rows(p, cost, x, sigma):
            weight, full = loss.weight(r.reshape(-1), width), np.zeros((r.size, len(x)))
            full[:, columns] = J.reshape(-1, len(columns))
            blocks.append(np.column_stack([full, r.reshape(-1)]) * weight[:, None])
        A = np.vstack([*blocks, np.column_stack([P, P @ x - prior])])
        step = np.linalg.lstsq(A[:, :-1] * u.sizes, A[:, -1], rcond=1e-9)[0] * u.sizes
        x = x - step
        if np.linalg.norm(step / u.sizes) < 1e-13 * np.linalg.norm(x / u.sizes):
            break
    return x


CASES = [
    ("three_link", "length", "linear", True, ()),
    ("three_link", "squared", "linear", False, ()),
    ("three_link", "length", "huber", False, ()),
    ("three_link", "squared", "cauchy", True, ()),
    ("three_link", "length", "linear", True, PRIORS),
    ("three_link", "length", "soft_l1", True, PRIORS),
    ("three_link", "orthogonal", "linear", True, ()),
    ("f1", "squared", "linear", True, ()),  # raw quaternions: a null space
    ("f1", "length", "huber", False, ()),
]


@pytest.mark.parametrize(("kind", "cost", "loss", "known", "priors"), CASES)
def test_parts_give_what_dense_matrices_give(kind, cost, loss, known, priors, monkeypatch):
    monkeypatch.setattr(block_rows, "PART", 8)
    p = ready(kind, 41, known, priors)  # five parts and one pose
    width = 1.3 if priors else 5e-4 if cost == "squared" else 5e-5
    c = calibrate(p, cost=cost, loss=loss, width=width)
    assert c.status.ok and c.estimate is not None
    x = dense_optimum(p, cost, loss_named(loss), width, c.x)
    covariance, scaled = dense_covariance(p, dense_rows(p, cost, x, level(p)), loss_named(loss), width, known)
    std = np.sqrt(np.diag(covariance))
    assert np.max(np.abs(c.x - x) / std) < (CLOSE if loss == "linear" else 1e-6)  # reweighted steps end more slowly
    tolerance = 1e-9 if loss == "linear" else 1e-5
    assert np.max(np.abs(c.estimate.covariance - covariance) / np.outer(std, std)) < tolerance
    np.testing.assert_allclose(c.estimate.residuals, scaled.reshape(-1), rtol=1e-6, atol=1e-8 * np.abs(scaled).max())
    monkeypatch.undo()
    whole = calibrate(p, cost=cost, loss=loss, width=width)
    assert whole.estimate is not None and c.identifiability is not None and whole.identifiability is not None
    assert np.max(np.abs(whole.x - c.x) / std) < (CLOSE if loss == "linear" else 1e-6)
    assert whole.estimate.degrees_of_freedom == pytest.approx(c.estimate.degrees_of_freedom, rel=1e-9)
    assert whole.identifiability.rank == c.identifiability.rank
    np.testing.assert_allclose(
        whole.identifiability.singular,
        c.identifiability.singular,
        rtol=1e-6,
        atol=1e-12 * whole.identifiability.singular[0],
    )


@pytest.mark.parametrize("number", [15, 16, 17, 32])
def test_parts_that_just_fill_and_just_do_not(number, monkeypatch):
    p = ready(number=number)
    whole = calibrate(p)
    monkeypatch.setattr(block_rows, "PART", 16)
    c = calibrate(p)
    assert c.estimate is not None and whole.estimate is not None
    np.testing.assert_allclose(c.x, whole.x, atol=CLOSE * np.min(whole.estimate.std), rtol=0)
    np.testing.assert_allclose(
        c.estimate.covariance, whole.estimate.covariance, rtol=1e-8, atol=1e-9 * np.abs(whole.estimate.covariance).max()
    )


def test_memory_grows_by_the_data_and_their_residuals_alone(monkeypatch):
    monkeypatch.setattr(block_rows, "PART", 256)
    peaks = []
    for number in (2000, 6000):
        p = ready(number=number)
        calibrate(p)
        tracemalloc.start()
        calibrate(p)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert (peaks[1] - peaks[0]) / 4000 < 8 * 3 * 21  # less than one Jacobian of a pose


def test_no_python_call_per_pose():
    def calls(number):
        p, count = ready(number=number), [0]
        calibrate(p)

        def tally(frame, event, _arg):
            count[0] += event == "call" and (
                "calibrate" in frame.f_code.co_filename or "inference" in frame.f_code.co_filename
            )

        sys.setprofile(tally)
        try:
            calibrate(p)
        finally:
            sys.setprofile(None)
        return count[0]

    assert calls(5000) < 1.1 * calls(500) < 2000  # iterations may differ by one
