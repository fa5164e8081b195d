"""Functions of a calibration: residuals and exact Jacobians per pose, in blocks that share no unknowns."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import scipy

from ..compiler.rows import map_columns


@dataclass(frozen=True, eq=False)
class Block:
    """Rows of the closure equations and their unknowns, independent of all other blocks.

    `rows`, `columns`, `hidden`: indices of its equations, unknowns and latent values. `function`: (d, noise, latent, x)
    -> r (m,) and its Jacobians in x (m, n), noise (m, ny) and latent values (m, nz). Without noise, `plain` (d, x)
    computes the first two as [J r]' (n + 1, m), and `alone` only r.
    """

    rows: np.ndarray
    columns: np.ndarray
    hidden: np.ndarray
    alone: ca.Function
    plain: ca.Function
    function: ca.Function
    made: dict[str, dict[int, ca.Function]] = field(default_factory=lambda: defaultdict(dict), repr=False)

    def residuals(self, data: np.ndarray, x: np.ndarray) -> np.ndarray:
        """r (N, m) of data (nd, N), without noise."""
        return self._mapped("alone", [data, _repeated(x, data)])[0].T

    def appended(self, data: np.ndarray, x: np.ndarray) -> np.ndarray:
        """[J r] (N * m, n + 1), pose by pose, of data (nd, N), without noise."""
        return self._mapped("plain", [data, _repeated(x, data)])[0].T

    def evaluate(self, data: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """r (N, m) and dr/dx (N, m, n) of data (nd, N), without noise."""
        rows = self.appended(data, x).reshape(data.shape[1], len(self.rows), len(self.columns) + 1)
        return rows[..., -1], rows[..., :-1]

    def evaluate_all(
        self, data: np.ndarray, x: np.ndarray, noise: np.ndarray | None = None, latent: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """r (N, m), dr/dx (N, m, n), dr/dnoise (N, m, ny), dr/dlatent (N, m, nz) for noise (N, ny), latent (N, nz)."""
        n, f = data.shape[1], self.function
        y, z = (np.zeros((f.size1_in(k), n)) if v is None else v.T for k, v in ((1, noise), (2, latent)))
        r, J, By, Bz = self._mapped("function", [data, y, z, _repeated(x, data)])
        return r.T, _stacked(J, n), _stacked(By, n), _stacked(Bz, n)

    def _mapped(self, name: str, columns: list[np.ndarray]) -> list[np.ndarray]:
        return map_columns(getattr(self, name), columns, self.made[name])


def blocks(
    residuals: ca.SX, d: ca.SX, noise: ca.SX, latent: ca.SX, x: ca.SX, joined: Sequence[int] = ()
) -> tuple[Block, ...]:
    """Split the equations by Jacobian sparsity: rows of a block share an unknown, latent value or noise of `joined`.

    Blocks are ordered by their first row; an unknown that occurs in no row belongs to the first block.
    """
    shared = ca.vertcat(x, latent, *[noise[k] for k in joined])
    pattern = ca.jacobian_sparsity(residuals, shared)
    m, n = residuals.numel(), shared.numel()
    r, c = pattern.get_triplet()
    graph = scipy.sparse.csr_matrix((np.ones(len(r)), (r, np.array(c, int) + m)), shape=(m + n, m + n))
    _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    parts = []
    order = list(dict.fromkeys(label[:m]))
    for k in order:
        rows = np.flatnonzero(label[:m] == k)
        inside = [j for j in range(x.numel()) if label[m + j] == k or (k == order[0] and label[m + j] not in order)]
        columns = np.array(inside, int)
        first = m + x.numel()
        hidden = np.array([j for j in range(latent.numel()) if label[first + j] == k], int)
        part, unknowns, latents = residuals[rows.tolist()], x[columns.tolist()], latent[hidden.tolist()]
        jacobian = [ca.densify(ca.jacobian(part, s)) for s in (unknowns, noise, latents)]
        zeros = [noise, latent], [ca.DM.zeros(noise.numel(), 1), ca.DM.zeros(latent.numel(), 1)]
        quiet, slopes = ca.cse(ca.substitute([ca.densify(part), jacobian[0]], *zeros))
        parts.append(
            Block(
                rows, columns, hidden, ca.Function("closure", [d, unknowns], [quiet]),
                ca.Function("closure", [d, unknowns], [ca.vertcat(slopes.T, quiet.T)]),
                ca.Function("closure", [d, noise, latents, unknowns], ca.cse([ca.densify(part), *jacobian])),
            )
        )  # fmt: skip
    return tuple(parts)


def _repeated(x: np.ndarray, data: np.ndarray) -> np.ndarray:
    # as np.broadcast_to, but faster
    return np.ndarray((len(x), data.shape[1]), buffer=np.ascontiguousarray(x, float), strides=(8, 0))


def _stacked(J: np.ndarray, n: int) -> np.ndarray:
    return J.reshape(J.shape[0], n, J.shape[1] // n if n else 0).transpose(1, 0, 2)
