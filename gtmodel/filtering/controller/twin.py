"""A filter cycle in Python: the same operations in the same order as gt_filter.h, on NumPy columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...cgen.newton_steps import run
from ...cgen.real import DOUBLE, Real
from ...results.status import Status
from ..transition import TAYLOR
from .plan import FilterPlan, Kernel, SensorPlan, TransitionPlan
from .sparse import EntryMatrix

# as in gt_filter.h
UNIT = 2e-6
MOST = 1_000_000_000


class Pair:
    """Mean, factors of the covariance U D U', time and counters of an instant. Rows of `factor` are columns of U."""

    def __init__(
        self, time: np.ndarray, x: np.ndarray, factor: np.ndarray, diagonal: np.ndarray, closed: np.ndarray
    ) -> None:
        self.time, self.x, self.factor, self.diagonal, self.closed = time, x, factor, diagonal, closed

    def copy(self) -> Pair:
        """Return an independent copy."""
        return Pair(*(a.copy() for a in (self.time, self.x, self.factor, self.diagonal, self.closed)))

    def variances(self) -> np.ndarray:
        """Return the diagonal of U D U', summed column by column."""
        terms = self.diagonal[:, None] * self.factor * self.factor
        return np.add.accumulate(terms, axis=0)[-1]


class Outcome:
    """Result of the readings of an instant: innovation and gates."""

    def __init__(self, sensors: int, zero: Any) -> None:
        self.nis, self.count, self.gated = zero, 0, [False] * sensors
        self.variances = np.zeros(0)


class _Called:
    """A kernel on columns of one number type."""

    def __init__(self, kernel: Kernel, real: Real) -> None:
        self.f, self.real = kernel.called(kernel.name), real
        self.shapes = [self.f.numel_out(k) for k in range(self.f.n_out())]
        if real is DOUBLE:
            self.arguments = [np.zeros(self.f.numel_in(k)) for k in range(self.f.n_in())]
            self.results = [np.zeros(n) for n in self.shapes]
            self.buffer, self.run = self.f.buffer()
            places: list[tuple[Any, list[Any]]] = [
                (self.buffer.set_arg, self.arguments), (self.buffer.set_res, self.results)
            ]  # fmt: skip
            for setter, arrays in places:
                for k, a in enumerate(arrays):
                    if a.size:
                        setter(k, memoryview(a))

    def __call__(self, *columns: Any) -> list[np.ndarray]:
        if self.real is not DOUBLE:
            return [r[:, 0] for r in run(self.f, [np.asarray(c, self.real.dtype).reshape(-1, 1) for c in columns])]
        for memory, value in zip(self.arguments, columns, strict=True):
            memory[...] = value
        self.run()
        return [r.copy() for r in self.results]


class FilterTwin:
    """The filter of a plan in one number type."""

    def __init__(self, plan: FilterPlan, real: Real, pivot: float) -> None:
        self.plan, self.real, self.pivot = plan, real, real.dtype(pivot)
        self.called = {k.name: _Called(k, real) for k in (*plan.kernels, plan.turn) if k is not None}
        if plan.motion is not None:
            motion = plan.motion
            self.weights, self.powers = real.array(motion.weights), real.array(motion.powers)
            self.fixed = [real.array(f) for f in (motion.fixed_path, motion.fixed_response, motion.fixed_total)]
        self.variance = [real.array(s.variance) for s in plan.sensors]
        self.values = {id(motion): real.array(motion.value) for motion in self._matrices()}
        self.same = real.array(np.array(plan.same))
        self.noise_at = tuple(np.array(plan.noise.places, int).reshape(-1, 2).T)

    def _matrices(self) -> Sequence[EntryMatrix]:
        m = self.plan.motion
        moving = [] if m is None else [m.jacobian, m.frames, m.arrival, m.drift, m.drive]
        return [self.plan.transition, self.plan.noise, *moving, *[s.jacobian for s in self.plan.sensors]]

    def filled(self, matrix: EntryMatrix, changing: np.ndarray) -> np.ndarray:
        """Return the values of all entries."""
        value = self.values[id(matrix)].copy()
        value[matrix.changing] = changing
        return value

    # -- from instant to instant -----------------------------------------------------------------------

    def _spread(self, belief: Pair, F: np.ndarray, noise: np.ndarray) -> Status:
        """Factor F U D U' F' + Q, from the last column to the first."""
        plan, n, one = self.plan, self.plan.errors, self.real.dtype(1.0)
        start, columns = plan.transition.start, np.array(plan.transition.columns, int)
        moved, P = belief.factor * self.same, np.zeros((n, n), F.dtype)
        P[self.noise_at] = noise
        for k in range(n):
            entries = slice(start[k], start[k + 1])
            moved[k:, columns[entries]] += F[entries] * belief.factor[k:, k, None]
        for k in reversed(range(n)):
            P += (belief.diagonal[k] * moved[k])[:, None] * moved[k]
        variances = np.diag(P).copy()
        for k in reversed(range(n)):
            if not np.isfinite(P[k, k]):
                return Status.NOT_FINITE
            if not P[k, k] > self.pivot * variances[k]:
                return Status.SINGULAR
            belief.diagonal[k] = P[k, k]
            belief.factor[k, :k] = P[k, :k] * (one / P[k, k])
            P[:k, :k] += (-P[k, k] * belief.factor[k, :k])[:, None] * belief.factor[k, :k]
        return Status.OK

    def _move(self, time: Any, x: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> tuple[np.ndarray, ...]:
        """Mean after one step, F, and the entries of Q."""
        plan, real, step = self.plan, self.real, self.real.dtype(self.plan.step)
        m: Any = plan.motion
        fixed = self.fixed[0]
        noise = self._noise(m, time, x, u0)
        begin = np.zeros(m.moving * m.width, real.dtype)
        frame = self.called["frame"](x)[0] if m.frame is not None else np.zeros(0, real.dtype)
        begin[m.frame_places] = self.filled(m.frames, frame)
        begin = begin.reshape(m.moving, m.width)
        rates, change = np.zeros_like(x), np.zeros_like(begin)
        total, whole = np.zeros_like(x), np.zeros_like(begin)
        for stage, (share, weight) in enumerate(((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0))):
            part = real.dtype(share) * step
            u = u0 + real.dtype(share) * (u1 - u0)
            x_stage = x + part * rates
            rates, changing = self.called["rates"](time + part, x_stage, u)
            path = np.concatenate([begin + part * change, fixed[stage]])
            change = m.jacobian.times(self.filled(m.jacobian, changing), path)
            total = total + real.dtype(weight) * rates
            whole = whole + real.dtype(weight) * change
        sixth = step / real.dtype(6.0)
        mean, changing = x + sixth * total, [np.zeros(0, real.dtype)]
        for place, _ in plan.turned:
            mean[place : place + 4], unit_values = self.called["unit"](mean[place : place + 4])
            changing.append(unit_values)
        path = np.concatenate([begin + sixth * whole, fixed[4]])
        after = m.arrival.times(self.filled(m.arrival, np.concatenate(changing)), path)
        return mean, self.filled(plan.transition, after.ravel()[m.picked]), noise

    def _noise(self, m: TransitionPlan, time: Any, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Entries of Q."""
        real, (_, fixed, totals) = self.real, self.fixed
        if m.noise is None:
            drift, drive = np.zeros(0, real.dtype), np.zeros(0, real.dtype)
        else:
            drift, drive = self.called["noise"](time, x, u)
        A = self.filled(m.drift, drift)
        first = np.zeros(len(m.responses) - fixed.shape[1], real.dtype)
        first[[m.responses.index(place) for place in m.drive.places]] = self.filled(m.drive, drive)
        powers = [first]
        for k in range(TAYLOR):
            powers.append(m.response.applied(A, np.concatenate([powers[-1], fixed[k]])))
        noise = np.zeros(len(m.spread.start) - 1, real.dtype)
        for node, weight in enumerate(self.weights):
            total = powers[0].copy()
            for k in range(1, TAYLOR + 1):
                total = total + self.powers[node, k - 1] * powers[k]
            total = np.concatenate([total, totals[node]])
            noise = noise + weight * m.spread.applied(total, total)
        return self.filled(self.plan.noise, noise)

    def advance(self, belief: Pair, u0: np.ndarray, u1: np.ndarray) -> Status:
        """Advance the belief by one cycle."""
        plan, real = self.plan, self.real
        for part in range(plan.parts):
            begin, end = (u0 + (real.dtype(k) / real.dtype(plan.parts)) * (u1 - u0) for k in (part, part + 1))
            if plan.motion is not None:
                belief.x, F, noise = self._move(belief.time, belief.x, begin, end)
            else:
                belief.x, changing = self.called["given"](belief.time, belief.x, begin, end)
                F = self.filled(plan.transition, changing)
                noise = self.values[id(plan.noise)]
            status = self._spread(belief, F, noise)
            belief.time = belief.time + real.dtype(plan.step)
            if status != Status.OK:
                return status
        return Status.OK

    # -- readings --------------------------------------------------------------------------------------

    def _gated(self, s: int, belief: Pair, lever: np.ndarray, residual: np.ndarray) -> bool:
        """Whether the gate of a sensor leaves its reading out, tested with this reading alone on a copy."""
        error = np.zeros(self.plan.errors, self.real.dtype)
        return not self._used(s, belief.copy(), error, lever, residual) <= self.real.dtype(self.plan.sensors[s].gate)

    def correct(
        self, belief: Pair, u: np.ndarray, readings: np.ndarray, present: np.ndarray, outcome: Outcome
    ) -> Status:
        """Correct the belief with the readings of an instant."""
        plan, real = self.plan, self.real
        residuals, levers = {}, {}
        for s, sensor in enumerate(plan.sensors):
            outcome.gated[s] = False
            if present[s]:
                z = readings[sensor.first : sensor.first + sensor.size]
                residuals[s], changing = self.called[sensor.kernel.name](belief.time, belief.x, u, z)
                levers[s] = self.filled(sensor.jacobian, changing)
                if sensor.gate > 0:
                    outcome.gated[s] = self._gated(s, belief, levers[s], residuals[s])
        error, nis, count = np.zeros(plan.errors, real.dtype), real.dtype(0.0), 0
        for s, sensor in enumerate(plan.sensors):
            if outcome.gated[s]:
                belief.closed[s] += belief.closed[s] < MOST
            elif present[s]:
                nis = nis + self._used(s, belief, error, levers[s], residuals[s])
                count += sensor.jacobian.shape[0]
                belief.closed[s] = 0
        belief.x = self._plus(belief.x, error)
        outcome.nis, outcome.count = nis, count
        outcome.variances = belief.variances()
        if not all(np.all(np.isfinite(v)) for v in (belief.x, nis, outcome.variances)):
            return Status.NOT_FINITE
        if not np.all(belief.diagonal > self.pivot * outcome.variances):
            return Status.SINGULAR
        if any(0 < sensor.closed < belief.closed[s] for s, sensor in enumerate(plan.sensors)):
            return Status.OUT_OF_RANGE
        return Status.OK

    def _plus(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        error_of = np.array(self.plan.error_of)
        moved = np.where(error_of >= 0, x + error[np.maximum(error_of, 0)], x)
        for place, at in self.plan.turned:
            moved[place : place + 4] = self.called["turn"](x[place : place + 4], error[at : at + 3])[0]
        return moved

    def _used(self, s: int, belief: Pair, error: np.ndarray, lever: np.ndarray, residual: np.ndarray) -> Any:
        """Use all numbers of a reading, one after the other; return their normalised innovation squared."""
        H, total = self.plan.sensors[s].jacobian, self.real.dtype(0.0)
        for row, variance in enumerate(self.variance[s]):
            along = range(H.start[row], H.start[row + 1])
            total = total + self._used_number(
                belief, error, [H.columns[k] for k in along], lever[along.start : along.stop], variance, residual[row]
            )
        return total

    def _used_number(
        self, belief: Pair, error: np.ndarray, columns: list[int], values: np.ndarray, variance: Any, residual: Any
    ) -> Any:
        """Use one number of a reading; sums go from column to column of U, and columns before the first entry stay."""
        one, columns_from = self.real.dtype(1.0), slice(columns[0], None)
        U, D = belief.factor[columns_from], belief.diagonal[columns_from]
        lever = np.zeros_like(D)
        for c, v in zip(columns, values, strict=True):
            residual = residual - v * error[c]
            lever = lever + v * U[:, c]
        share = D * lever
        sums = np.add.accumulate(np.concatenate([[variance], lever * share]))
        inverse = one / sums
        gain = np.add.accumulate(np.concatenate([np.zeros_like(U[:1]), share[:, None] * U]), axis=0)
        belief.factor[columns_from] = U - (lever * inverse[:-1])[:, None] * gain[:-1]
        belief.diagonal[columns_from] = D * (sums[:-1] * inverse[1:])
        share = residual * inverse[-1]
        error += gain[-1] * share
        return residual * share

    # -- cycles ----------------------------------------------------------------------------------------

    def cycle(self, state: Any, u: np.ndarray, z: np.ndarray, flags: np.ndarray) -> tuple[Status, Pair | None, Outcome]:
        """Do one cycle on a state of arrays, see `ControllerFilter`."""
        plan, ring = self.plan, self.plan.depth + 1
        outcome = Outcome(len(plan.sensors), self.real.dtype(0.0))
        if not np.all(np.isfinite(u)):
            return Status.NOT_FINITE, None, outcome
        for s, sensor in enumerate(plan.sensors):
            if flags[s]:
                status = self._judged(sensor, z[sensor.first : sensor.first + sensor.size])
                if status != Status.OK:
                    return status, None, outcome
        slot = (int(state["place"]) + 1) % ring
        state["place"] = slot
        state["begun"] = min(int(state["begun"]) + 1, ring)
        state["inputs"][slot] = u
        state["present"][slot] = 0
        for s, sensor in enumerate(plan.sensors):
            if not flags[s]:
                state["age"][s] += state["age"][s] < MOST
                if 0 < sensor.stale < state["age"][s]:
                    return Status.STALE_INPUT, None, outcome
                continue
            state["age"][s] = 0
            if sensor.delay < state["begun"]:
                taken = (slot + ring - sensor.delay) % ring
                along = slice(sensor.first, sensor.first + sensor.size)
                state["readings"][taken, along] = z[along]
                state["present"][taken, s] = 1
        belief, remaining, before = state["belief"], int(state["begun"]), state["before"]
        if remaining > plan.depth:
            slot, remaining = (slot + 1) % ring, plan.depth
            status = self._instant(state, belief, before, slot, outcome)
            before = state["before"] = state["inputs"][slot].copy()
            if status != Status.OK:
                return status, None, outcome
        now = belief
        if plan.depth:
            now, ahead = belief.copy(), Outcome(len(plan.sensors), self.real.dtype(0.0))
            slot = (int(state["place"]) + ring + 1 - remaining) % ring
            for _ in range(remaining):
                status = self._instant(state, now, before, slot, ahead)
                if status != Status.OK:
                    return status, None, outcome
                before, slot = state["inputs"][slot], (slot + 1) % ring
        return Status.OK, now, outcome

    def _instant(self, state: Any, belief: Pair, before: np.ndarray, slot: int, outcome: Outcome) -> Status:
        u = state["inputs"][slot]
        with np.errstate(all="ignore"):
            status = self.advance(belief, before, u)
            if status != Status.OK:
                return status
            return self.correct(belief, u, state["readings"][slot], state["present"][slot], outcome)

    def _judged(self, sensor: SensorPlan, z: np.ndarray) -> Status:
        if not np.all(np.isfinite(z)):
            return Status.NOT_FINITE
        with np.errstate(over="ignore"):
            square = self.real.dtype(0.0)
            for x in z:
                square = square + x * x
        far = not np.all(np.abs(z) <= self.real.array(limits(sensor, self.real)))
        turned = sensor.quaternion and not abs(square - self.real.dtype(1.0)) <= self.real.dtype(UNIT)
        return Status.OUT_OF_RANGE if far or turned else Status.OK


def limits(sensor: SensorPlan, real: Real) -> np.ndarray:
    """Largest numbers of a reading: there the round-off reaches the smallest deviation."""
    most = 2.0 if sensor.quaternion else sensor.deviation / real.precision.round_off
    return np.full(sensor.size, most)
