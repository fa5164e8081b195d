"""One oscillator in each of x, y and z, whose mass, damping and stiffness vary with the pose of the tool; its TOML
file, for simulations with forces on the arm, such as milling."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ...results.disk import path_of
from ...results.read_bounds import toml_of
from .gaussian_process import STARTS, GaussianProcess, KernelInputs, Shape, fit_gaussian_processes, held_out, quantile
from .modal_fit import ADDED, SHARES

DIRECTIONS, QUANTITIES = ("x", "y", "z"), ("m", "c", "k")
SCALES = (0.5, 0.5, 0.5, 1.0)  # m, m, m, rad: typical lengths for an arm of three metres
UNDETERMINED = 0.5  # largest posterior variance, relative to the variance of the measured values


@dataclass(frozen=True, eq=False)
class OscillatorField:
    """m x'' + c x' + k x = F in x, y, z; log m, log c and log k are nine Gaussian processes over the pose.

    A pose is (x, y, z, A): tool centre point [m] and rotation about the spindle [rad] (Cvitanic 2021, section 3.2.2).
    `processes`: (direction, quantity) -> process of the logarithm. `synthetic`: seed and noise of synthetic data.
    """

    processes: Mapping[tuple[str, str], GaussianProcess]
    synthetic: str | None = None

    def at(self, pose: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return m [kg], c [N.s/m], k [N/m] in x, y, z, each (3,) at a pose (4,), or (n, 3) at poses (n, 4)."""
        return self.value("m", pose), self.value("c", pose), self.value("k", pose)

    def value(self, name: str, pose: Any) -> np.ndarray:
        """Return the median of "m", "c", "k", "fn" [Hz] or "zeta", (3,) at a pose (4,), (n, 3) at poses (n, 4)."""
        return np.exp(self._log(name, pose)[0])

    def prediction_interval(self, name: str, pose: Any, level: float = 0.95, *, of: str = "field") -> np.ndarray:
        """Return limits (3, 2) or (n, 3, 2) of a quantity as in value(), for the field or a new measurement of it.

        For fn and zeta the errors of m, c and k are assumed independent, which is conservative if errors of m and k are
        positively correlated.
        """
        log, std = self._log(name, pose, of)
        q = quantile(level)
        return np.exp(np.stack([log - q * std, log + q * std], axis=-1))

    def covers(self, pose: Any) -> Any:
        """Whether the measurements determine the oscillators at a pose (4,), or at each of poses (n, 4) -> (n,).

        False if the variance of a process, without inflation, exceeds half that of its measured logarithms: far from
        the measurements a prediction is little more than their mean. casadi_function() does not check this.
        """
        poses = np.atleast_2d(np.asarray(pose, float))
        determined = np.ones(len(poses), bool)
        for g in self.processes.values():
            determined &= (g.predict(poses)[1] / g.inflation) ** 2 <= UNDETERMINED * np.var(g.y)
        return determined if np.ndim(pose) > 1 else bool(determined[0])

    def casadi_function(self, *, std: bool = False, name: str = "oscillators") -> Any:
        """Return a CasADi function pose (4,) -> m, c, k (3,) each; with `std` also their relative standard deviations.

        It is smooth, so that optimisers can differentiate it; c_code() writes it as C.
        """
        import casadi as ca

        from .gaussian_process_symbols import predictions

        pose = ca.SX.sym("pose", 4)  # type: ignore[call-arg]
        order = [(d, q) for q in QUANTITIES for d in DIRECTIONS]
        means, stds = predictions([self.processes[key] for key in order], pose, std=std)
        columns = [ca.exp(ca.vertcat(*means[3 * q : 3 * q + 3])) for q in range(3)]
        names = list(QUANTITIES)
        if std:
            columns += [ca.vertcat(*stds[3 * q : 3 * q + 3]) for q in range(3)]
            names += [f"std_log_{q}" for q in QUANTITIES]
        return ca.Function(name, [pose], columns, ["pose"], names)

    def c_code(self, *, std: bool = False, name: str = "oscillators") -> str:
        """Return casadi_function() as one C file: a function `name` with CasADi's calling convention."""
        return _generated(self.casadi_function(std=std, name=name), name)

    def _logs(self, poses: np.ndarray, of: str) -> tuple[np.ndarray, np.ndarray]:
        """Means and standard deviations (3 quantities, n, 3 directions) of the logarithms."""
        predictions = [[self.processes[d, q].predict(poses, of=of) for d in DIRECTIONS] for q in QUANTITIES]
        stacked = np.array(predictions)  # (q, d, 2, n)
        return stacked[:, :, 0].transpose(0, 2, 1), stacked[:, :, 1].transpose(0, 2, 1)

    def _log(self, name: str, pose: Any, of: str = "field") -> tuple[np.ndarray, np.ndarray]:
        if name not in SHARES:
            raise ValueError(f"unknown quantity '{name}' of an oscillator; expected {', '.join(SHARES)}")
        poses = np.asarray(pose, float)
        if poses.shape[-1:] != (4,) or poses.ndim > 2:
            raise ValueError(f"the pose has the shape {poses.shape}; expected (4,) or (n, 4): x, y, z [m] and A [rad]")
        if not np.all(np.isfinite(poses)):
            raise ValueError("a pose is not finite")
        mean, std = self._logs(np.atleast_2d(poses), of)
        shares = np.array(SHARES[name])
        log = np.tensordot(shares, mean, 1) + ADDED.get(name, 0.0)
        size = np.sqrt(np.tensordot(shares**2, std**2, 1))
        return (log, size) if poses.ndim > 1 else (log[0], size[0])


def fit_oscillator_field(
    poses: np.ndarray,
    m: np.ndarray,
    c: np.ndarray,
    k: np.ndarray,
    *,
    scale: tuple[float, ...] = SCALES,
    periodic: bool = True,
    shape: Shape = "squared_exponential",
    shared: bool = True,
    starts: int = STARTS,
    seed: int = 0,
    calibrate: bool = True,
    synthetic: str | None = None,
) -> tuple[OscillatorField, dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]]:
    """Fit a field to measured oscillators; return it with the errors of held-out poses by (direction, quantity).

    poses (n, 4) as in OscillatorField; m, c, k (n, 3), NaN for directions without measurement. `scale` of the inputs;
    `periodic`: whether A has period 2 pi; `shared`: whether m, c and k of a direction share their lengths, which makes
    intervals more reliable and the C code three times shorter. `calibrate`: inflate intervals by held-out errors, see
    held_out(). The errors (2, n) are in logarithms, with the standard deviations before inflation. Raises ValueError
    for wrong shapes and for values that are not positive or infinite.

    >>> rng = np.random.default_rng(1)
    >>> poses = rng.uniform([-0.3, -3.1, 0.2, 0.0], [0.9, -2.1, 0.4, 2.0], (12, 4))  # x, y, z [m], A [rad]
    >>> m, c, k = (size * np.exp(0.1 * rng.standard_normal((12, 3))) for size in (200.0, 4000.0, 3e6))
    >>> field, _ = gt.vibration.fit_oscillator_field(poses, m, c, k, starts=1, calibrate=False)
    >>> [value.shape for value in field.at(poses[0])]  # m [kg], c [N.s/m], k [N/m] in x, y, z
    [(3,), (3,), (3,)]
    >>> field.covers([5.0, 5.0, 5.0, 0.0])  # far from all measured poses
    False
    """
    poses = np.asarray(poses, float)
    values = {q: np.asarray(v, float) for q, v in zip(QUANTITIES, (m, c, k), strict=True)}
    for q, v in values.items():
        if poses.ndim != 2 or poses.shape[1] != 4 or v.shape != (len(poses), 3):
            raise ValueError(f"poses {poses.shape} and {q} {v.shape} do not fit; expected (n, 4) and (n, 3)")
        wrong = (v <= 0) | np.isinf(v)
        if np.any(wrong):
            row = int(np.argwhere(wrong)[0, 0])
            what = "not positive" if np.any(v[row] <= 0) else "infinite"
            raise ValueError(f"{q} is {what} at pose {row}; mark that measurement as NaN")
    inputs = KernelInputs(tuple(scale), (False, False, False, periodic))
    processes, errors = {}, {}
    for d, direction in enumerate(DIRECTIONS):
        rows = np.all([np.isfinite(v[:, d]) for v in values.values()], axis=0)
        logs = {q: np.log(v[rows, d]) for q, v in values.items()}
        for group in (QUANTITIES,) if shared else tuple((q,) for q in QUANTITIES):
            Y = np.stack([logs[q] for q in group])
            fitted = fit_gaussian_processes(poses[rows], Y, inputs, shape=shape, starts=starts, seed=seed)
            error, std = held_out(fitted, seed=seed) if calibrate else (None, None)
            for j, (q, g) in enumerate(zip(group, fitted, strict=True)):
                if error is not None and std is not None:
                    errors[direction, q] = (error[j], std[j])
                    g = g.calibrated(error[j], std[j])
                processes[direction, q] = g
    return OscillatorField(processes, synthetic), errors


def _generated(f: Any, name: str) -> str:
    import casadi as ca

    from ...results.disk import scratch

    generator = ca.CodeGenerator(f"{name}.c")
    generator.add(f)
    with scratch() as folder:
        generator.generate(f"{folder}/")
        text = (folder / f"{name}.c").read_text(encoding="utf-8")
    if not text.endswith("#endif\n"):  # CasADi does not report a full disk
        raise OSError(f"the temporary folder {folder} cannot hold the code; free space, or set TMPDIR")
    return text


FORMAT = "gtmodel oscillator field 1"
_UNITS = {"m": "kg", "c": "N.s/m", "k": "N/m"}


def oscillator_text(field: OscillatorField) -> str:
    """Return the field as TOML with exact numbers: training poses, logarithms and hyperparameters.

    >>> rng = np.random.default_rng(1)
    >>> poses = rng.uniform([-0.3, -3.1, 0.2, 0.0], [0.9, -2.1, 0.4, 2.0], (12, 4))  # x, y, z [m], A [rad]
    >>> m, c, k = (size * np.exp(0.1 * rng.standard_normal((12, 3))) for size in (200.0, 4000.0, 3e6))
    >>> field, _ = gt.vibration.fit_oscillator_field(poses, m, c, k, starts=1, calibrate=False)
    >>> gt.vibration.oscillator_text(field).splitlines()[1]
    'format = "gtmodel oscillator field 1"'
    """
    first = field.processes[DIRECTIONS[0], QUANTITIES[0]]
    content: dict[str, Any] = {
        "format": FORMAT,
        "synthetic": field.synthetic or "",
        "pose": "x [m], y [m], z [m], A [rad]",
        "covariance": {
            "shape": first.shape,
            "scale": list(first.inputs.scale),
            "periodic": list(first.inputs.periodic),
        },
    }
    for d in DIRECTIONS:
        processes = [field.processes[d, q] for q in QUANTITIES]
        content[d] = {"poses": processes[0].X.tolist()}
        for q, g in zip(QUANTITIES, processes, strict=True):
            content[d][q] = {
                "unit": _UNITS[q],
                "lengths": g.lengths.tolist(),
                **{name: float(getattr(g, name)) for name in ("amplitude", "noise", "mean", "level", "inflation")},
                "logarithms": g.y.tolist(),
            }
    head = f"# SYNTHETIC: {field.synthetic}\n" if field.synthetic else ""
    return head + "# m x'' + c x' + k x = F by direction, over poses; see gtmodel.vibration.OscillatorField\n" + (
        tomli_w.dumps(content)
    )  # fmt: skip


def load_oscillator_field(path: str | Path) -> OscillatorField:
    """Load a field written by oscillator_text(), equal bit for bit. Raises ValueError for another file.

    >>> rng = np.random.default_rng(1)
    >>> poses = rng.uniform([-0.3, -3.1, 0.2, 0.0], [0.9, -2.1, 0.4, 2.0], (12, 4))  # x, y, z [m], A [rad]
    >>> m, c, k = (size * np.exp(0.1 * rng.standard_normal((12, 3))) for size in (200.0, 4000.0, 3e6))
    >>> field, _ = gt.vibration.fit_oscillator_field(poses, m, c, k, starts=1, calibrate=False)
    >>> from pathlib import Path
    >>> _ = Path("field.toml").write_text(gt.vibration.oscillator_text(field))
    >>> again = gt.vibration.load_oscillator_field("field.toml")
    >>> np.array_equal(again.at(poses[0]), field.at(poses[0]))
    True
    """
    name = path_of(path).name
    try:
        content = toml_of(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{name} cannot be read as an oscillator field: {error}") from error
    if content.get("format") != FORMAT:
        raise ValueError(
            f"{name} has the format {content.get('format')!r}; expected '{FORMAT}', as kind dynamic_stiffness writes it"
        )
    try:
        covariance = content["covariance"]
        inputs = KernelInputs(tuple(covariance["scale"]), tuple(covariance["periodic"]))
        processes = {
            (d, q): _process(np.array(content[d]["poses"], float), content[d][q], inputs, covariance["shape"])
            for d in DIRECTIONS
            for q in QUANTITIES
        }
    except KeyError as error:
        raise ValueError(f"{name} lacks the key {error}; write it again with kind dynamic_stiffness") from error
    return OscillatorField(processes, content.get("synthetic") or None)


def _process(X: np.ndarray, table: dict[str, Any], inputs: KernelInputs, shape: Any) -> GaussianProcess:
    numbers = [float(table[name]) for name in ("amplitude", "noise", "mean", "level", "inflation")]
    return GaussianProcess(X, np.array(table["logarithms"], float), inputs, shape, np.array(table["lengths"]), *numbers)
