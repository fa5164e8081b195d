"""The three-link Gantry-Tau: every causality against equations written by hand, and identities between causalities."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

import gtmodel as gt
from gtmodel import Status
from gtmodel.compiler.alias import eliminate
from gtmodel.compiler.causal import flat_of
from gtmodel.compiler.structure import analyse
from tests.oracle.hand_written import ThreeLink
from tests.oracle.pantelides import differentiation_counts
from tests.oracle.point_masses import MIDPOINT, UNIFORM, Mechanism
from tests.support.compare import relative_error
from tests.support.examples import examples
from tests.support.residuals import original_residuals
from tests.support.strategies import MIN_COSINE, SIDES, State, columns, random_states, reachable_states

# Two roads of some hundred operations in double precision (2.2e-16) differ by some 1e-14; the poses lose at most two
# digits more (tests/support/strategies.py).
ROUND_OFF = 1e-12
# Inverse and forward dynamics one after the other: two linear solves with masses from 9 to 38 kg between them.
TWO_SOLVES = 1e-12
# Kinematics must not notice masses at all; the same expressions, perhaps summed in another order.
LAST_BITS = 1e-15

FAR = 1024.0  # m

COUNT = 200
SETS = ["l1_tape", "l1_camera", "l1_tracker", "l1_tracker_2008", "l1_vision"]
LINK_MASSES = [2.1, 3.4, 5.2]
MASSES = {"massless links": [0.0, 0.0, 0.0], "heavy links": LINK_MASSES}
MOVING = ["l1_tape", "l1_camera", "l1_tracker_2008"]  # for dynamics, which take longer to compile
EXAMPLES = examples(30)
FORWARD = ["T", "der(T)", "der(T,2)", "tau"]
INVERSE = ["q", "der(q)", "der(q,2)", "tau"]


RODS = {"MidpointRod": gt.mechanics.MidpointRod, "UniformRod": gt.mechanics.UniformRod}


@cache
def robot(name: str = "l1_tape", m_a: tuple[float, ...] = (0.0, 0.0, 0.0), rod: Any = None) -> gt.robots.GantryTau:
    return gt.robots.gantry_tau(name, m_a=list(m_a), rod=rod)


def heavy(name: str = "l1_tape", rod: Any = None) -> gt.robots.GantryTau:
    return robot(name, tuple(LINK_MASSES), None if rod is gt.mechanics.MidpointRod else rod)  # one cache entry


def oracle_of(r: gt.robots.GantryTau) -> ThreeLink:
    assert np.array_equal(r.v, [[1.0, 0.0, 0.0]] * 3)
    return ThreeLink(
        *(np.array(getattr(r, k), dtype=float) for k in ("A", "L", "m_p", "m_c", "m_a", "coulomb", "viscous")),
        float(r.velocity_scale),
    )  # fmt: skip


def mechanism_of(r: gt.robots.GantryTau, rod: tuple[float, float]) -> Mechanism:
    return Mechanism(
        *(np.array(getattr(r, k), dtype=float) for k in ("A", "v", "L", "m_p", "m_c", "m_a", "coulomb", "viscous")),
        float(r.velocity_scale),
        rod,
    )  # fmt: skip


def arm_branches(sides: tuple[int, ...]) -> dict[str, int]:
    return {f"arm[{i}].ahead": s for i, s in enumerate(sides)}


def plate_side(r: gt.robots.GantryTau, state: State) -> int:
    """On which side of the plane through the carts the plate lies, along the first guideway."""
    p = np.asarray(r.A) + state.q[:, None] * np.asarray(r.v)
    normal = np.cross(p[1] - p[0], p[2] - p[0])
    return int(np.sign((state.T - p[0]) @ normal) * np.sign(normal @ np.asarray(r.v)[0]))


def values(f: gt.CausalFunction, *arguments: Any) -> Any:
    """The targets; every status must be OK."""
    *result, status = f(*arguments)
    assert np.all(np.asarray(status) == Status.OK), f.diagnose(*[np.atleast_2d(a)[0] for a in arguments])
    return result[0] if len(result) == 1 else result


# The states of the oracle tests are shared: plate ahead of all carts, as both prototypes work.
@pytest.fixture(scope="module", params=list(MASSES))
def case(request: pytest.FixtureRequest) -> tuple[gt.robots.GantryTau, ThreeLink, list[State]]:
    r = robot("l1_tape", tuple(MASSES[request.param]))
    return r, oracle_of(r), random_states(r, COUNT, seed=1)


class TestAgainstDressler:
    """Eqs. (6.3)-(6.8) with v = (1, 0, 0), at 200 poses."""

    def test_forward_kinematics_is_trilateration(self, case):
        r, oracle, states = case
        T, _, _, q = columns(states)
        expected = np.array([oracle.forward_kinematics(s.q, +1) for s in states])
        assert relative_error(expected, T) < ROUND_OFF  # the oracle's own round trip
        assert relative_error(values(r.causal("q", "T"), q), expected) < ROUND_OFF

    @pytest.mark.parametrize("sides", SIDES)
    def test_inverse_kinematics_on_every_branch(self, sides):
        r = robot()
        oracle = oracle_of(r)
        T = columns(random_states(r, COUNT, seed=2, sides=sides))[0]
        q = values(r.causal("T", "q", branches=arm_branches(sides)), T)
        expected = np.array([oracle.inverse_kinematics(t, np.array(sides)) for t in T])
        assert relative_error(q, expected) < ROUND_OFF

    @pytest.mark.parametrize("axis", [0, 1, 2])
    def test_inverse_kinematics_a_kilometre_from_the_origin(self, axis):
        offset = FAR * np.eye(3)[axis]
        r = robot()
        A = np.round(np.array(r.A, dtype=float) * 2**30) / 2**30  # so that adding the offset rounds nothing
        T = np.round(columns(random_states(r, COUNT, seed=2))[0] * 2**30) / 2**30
        here, there = (gt.robots.gantry_tau("l1_tape", A=(A + a).tolist()) for a in (0.0, offset))
        q = values(here.causal("T", "q"), T)
        assert np.max(np.abs(values(there.causal("T", "q"), T + offset) - q)) < LAST_BITS * FAR

    def test_jacobian_and_velocities(self):
        r = robot()
        oracle, states = oracle_of(r), random_states(r, COUNT, seed=1)
        T, Td, _, q = columns(states)
        j_inv = np.array([oracle.inverse_jacobian(s.T, s.q) for s in states])
        jacobian, status = r.causal("q", "T").jacobian(q)
        assert np.all(status == Status.OK)
        assert relative_error(j_inv @ jacobian, np.broadcast_to(np.eye(3), j_inv.shape)) < ROUND_OFF
        inverse, _ = r.causal("T", "q").jacobian(T)
        assert relative_error(inverse, j_inv) < ROUND_OFF
        qd = np.einsum("nij,nj->ni", j_inv, Td)
        assert relative_error(values(r.causal("q", "der(T)"), q, qd), Td) < ROUND_OFF
        assert relative_error(values(r.causal("T", "der(q)"), T, Td), qd) < ROUND_OFF

    def test_accelerations(self):
        r = robot()
        oracle, states = oracle_of(r), random_states(r, COUNT, seed=1)
        T, Td, Tdd, q = columns(states)
        qd = np.array([oracle.inverse_jacobian(s.T, s.q) @ s.Td for s in states])
        qdd = np.array([oracle.cart_acceleration(s.T, s.q, s.Td, s.Tdd) for s in states])
        forward = np.array([oracle.tcp_acceleration(s.T, s.q, s.Td, a) for s, a in zip(states, qdd, strict=True)])
        assert relative_error(values(r.causal("q", "der(T,2)"), q, qd, qdd), forward) < ROUND_OFF
        assert relative_error(values(r.causal("T", "der(q,2)"), T, Td, Tdd), qdd) < ROUND_OFF

    def test_inverse_dynamics(self, case):
        r, oracle, states = case
        T, Td, Tdd, q = columns(states)
        qd = np.array([oracle.inverse_jacobian(s.T, s.q) @ s.Td for s in states])
        qdd = np.array([oracle.cart_acceleration(s.T, s.q, s.Td, s.Tdd) for s in states])
        tau = np.array([oracle.inverse_dynamics(s.T, s.q, s.Td, s.Tdd) for s in states])
        for known, targets, given_ in (("T", INVERSE, (T, Td, Tdd)), ("q", FORWARD, (q, qd, qdd))):
            found = values(r.causal(known, targets), *given_)
            expected = [q, qd, qdd, tau] if known == "T" else [T, Td, Tdd, tau]
            for a, b in zip(found, expected, strict=True):
                assert relative_error(a, b) < ROUND_OFF

    def test_forward_dynamics_in_both_states(self, case):
        r, oracle, states = case
        T, Td, _, q = columns(states)
        tau = 300.0 * np.random.default_rng(3).uniform(-1, 1, T.shape)
        expected = [oracle.forward_dynamics(s.T, s.q, s.Td, t) for s, t in zip(states, tau, strict=True)]
        Tdd, qdd = (np.array(x) for x in zip(*expected, strict=True))
        qd = np.array([oracle.inverse_jacobian(s.T, s.q) @ s.Td for s in states])
        accelerations = ["der(T,2)", "der(q,2)"]
        in_T = values(r.causal("tau", accelerations, prefer="T"), T, Td, tau)
        in_q = values(r.causal("tau", accelerations, prefer="q"), q, qd, tau)
        for found in (in_T, in_q):
            assert relative_error(found[0], Tdd) < ROUND_OFF
            assert relative_error(found[1], qdd) < ROUND_OFF

    def test_states_are_the_preferred_ones(self):
        names = {p: [s.name for s in robot().causal("tau", "der(T,2)", prefer=p).inputs] for p in ("T", "q")}
        assert names == {"T": ["T", "der(T)", "tau"], "q": ["q", "der(q)", "tau"]}

    def test_gravity_column_sums_to_zero(self):
        # identity for v = (1, 0, 0) and vertical gravity: the first row of J^-T is ones (Dressler 2012, Table 6.2)
        r = heavy()
        T = columns(random_states(r, COUNT, seed=4))[0]
        rest = np.zeros_like(T)
        tau = values(r.causal("T", INVERSE), T, rest, rest)[3]
        assert np.max(np.abs(np.sum(tau, axis=1))) < ROUND_OFF * np.max(np.abs(tau)) * 10


class TestAnyGuideways:
    """|v| != 1 and guideways that are not parallel: identities, and virtual work as the oracle."""

    @pytest.mark.parametrize("name, sides", [(n, (1, 1, 1)) for n in SETS] + [("l1_vision", (-1, -1, -1))])
    def test_round_trip_and_closure(self, name, sides):
        r = robot(name)
        states = random_states(r, COUNT, seed=5, sides=sides)
        T, _, _, q = columns(states)
        side = plate_side(r, states[0])
        here = np.array([plate_side(r, s) == side for s in states])
        found = values(r.causal("q", "T", branches={"plate_ahead": side}), q[here])
        assert relative_error(found, T[here]) < ROUND_OFF
        back = values(r.causal("T", "q", branches=arm_branches(sides)), found)
        assert relative_error(back, q[here]) < ROUND_OFF
        links = found[:, None, :] - np.asarray(r.A) - back[:, :, None] * np.asarray(r.v)
        assert relative_error(np.linalg.norm(links, axis=2), np.broadcast_to(r.L, links.shape[:2])) < ROUND_OFF

    @pytest.mark.parametrize("sides", SIDES)
    def test_forward_kinematics_from_every_inverse_branch(self, sides):
        r = robot("l1_camera")
        states = random_states(r, COUNT, seed=6, sides=sides)
        for side in (1, -1):
            here = [s for s in states if plate_side(r, s) == side]
            if here:
                T, _, _, q = columns(here)
                assert relative_error(values(r.causal("q", "T", branches={"plate_ahead": side}), q), T) < ROUND_OFF

    def test_both_sides_of_the_carts(self):
        r = robot()
        q = columns(random_states(r, COUNT, seed=7))[3]
        ahead = values(r.causal("q", "T"), q)
        behind = values(r.causal("q", "T", branches={"plate_ahead": -1}), q)
        oracle = oracle_of(r)
        assert relative_error(behind, [oracle.forward_kinematics(x, -1) for x in q]) < ROUND_OFF
        assert np.all(behind[:, 0] < ahead[:, 0])

    def test_a_whole_configuration_may_be_given_to_every_causality(self):
        r = robot("l1_camera")
        everything = {**arm_branches((-1, -1, -1)), "plate_ahead": -1}
        T, _, _, q = columns(random_states(r, COUNT, seed=8, sides=(-1, -1, -1)))
        assert relative_error(values(r.causal("T", "q", branches=everything), T), q) < ROUND_OFF
        assert relative_error(values(r.causal("q", "T", branches=everything), q), T) < ROUND_OFF

    @pytest.mark.parametrize("name", MOVING)
    @pytest.mark.parametrize("rod", ["MidpointRod", "UniformRod"])
    def test_inverse_dynamics_by_virtual_work(self, name, rod):
        r = heavy(name, RODS[rod])
        oracle = mechanism_of(r, {"MidpointRod": MIDPOINT, "UniformRod": UNIFORM}[rod])
        states = random_states(r, COUNT, seed=9)
        T, Td, Tdd, q = columns(states)
        expected = np.array([oracle.inverse_dynamics(s.T, s.q, s.Td, s.Tdd) for s in states])
        qd = np.array([oracle.rates(s.T, s.q) @ s.Td for s in states])
        qdd = np.array([oracle.cart_acceleration(s.T, s.q, s.Td, s.Tdd) for s in states])
        found = values(r.causal("T", INVERSE), T, Td, Tdd)
        assert relative_error(found[2], qdd) < ROUND_OFF
        assert relative_error(found[3], expected) < ROUND_OFF
        assert relative_error(values(r.causal("q", FORWARD), q, qd, qdd)[3], expected) < ROUND_OFF

    @pytest.mark.parametrize("name", MOVING)
    def test_power_balance(self, name):
        # motor power = d/dt (kinetic + potential energy) + friction power, the derivative by a complex step: exact
        r = heavy(name)
        oracle = mechanism_of(r, MIDPOINT)
        states = random_states(r, COUNT, seed=10)
        T, Td, Tdd, _ = columns(states)
        _, qd, _, tau = values(r.causal("T", INVERSE), T, Td, Tdd)
        step = 1e-30
        change = np.array(
            [oracle.energy(s.T + 1j * step * s.Td, s.Td + 1j * step * s.Tdd, np.ones(3)).imag / step for s in states]
        )
        lost = np.sum([oracle.friction(x) * x for x in qd], axis=1)
        power = np.sum(tau * qd, axis=1)
        size = np.sum(np.abs(tau * qd), axis=1)
        assert np.max(np.abs(power - change - lost) / size) < ROUND_OFF

    @pytest.mark.parametrize("name", MOVING)
    @pytest.mark.parametrize("prefer", ["T", "q"])
    def test_forward_after_inverse_dynamics_is_the_identity(self, name, prefer):
        r = heavy(name)
        T, Td, Tdd, q = columns(random_states(r, COUNT, seed=11))
        _, qd, _, tau = values(r.causal("T", INVERSE), T, Td, Tdd)
        state = (T, Td) if prefer == "T" else (q, qd)
        found = values(r.causal("tau", "der(T,2)", prefer=prefer), *state, tau)
        assert relative_error(found, Tdd) < TWO_SOLVES


class TestRods:
    """Another mass distribution along the rods changes forces and nothing else."""

    @pytest.mark.parametrize("known, targets", [("q", FORWARD), ("T", INVERSE)])
    def test_kinematics_do_not_see_the_rod_and_forces_do(self, known, targets):
        a, b = heavy("l1_camera", gt.mechanics.MidpointRod), heavy("l1_camera", gt.mechanics.UniformRod)
        T, Td, Tdd, q = columns(random_states(a, COUNT, seed=12))
        first = (q if known == "q" else T, Td, Tdd)
        *kinematics, tau = zip(*(values(r.causal(known, targets), *first) for r in (a, b)), strict=True)
        for x, y in kinematics:
            assert relative_error(x, y) <= LAST_BITS
        difference = tau[0] - tau[1]
        assert np.median(np.max(np.abs(difference), axis=1)) > 1.0  # N; links of some kg at 5 m/s2

    def test_at_rest_the_rods_are_alike(self):
        a, b = heavy("l1_camera", gt.mechanics.MidpointRod), heavy("l1_camera", gt.mechanics.UniformRod)
        T = columns(random_states(a, COUNT, seed=14))[0]
        rest = np.zeros_like(T)
        weights = [values(r.causal("T", INVERSE), T, rest, rest)[3] for r in (a, b)]
        assert relative_error(*weights) < ROUND_OFF

    def test_massless_links_need_no_distribution(self):
        a, b = robot(), robot(rod=gt.mechanics.UniformRod)
        T, Td, Tdd, _ = columns(random_states(a, COUNT, seed=15))
        assert relative_error(*[values(r.causal("T", INVERSE), T, Td, Tdd)[3] for r in (a, b)]) < ROUND_OFF


class TestOriginalEquations:
    """What the compiler did on the way is taken back: all 129 equations hold, and the structure is Pantelides'."""

    # SI units, forces up to some hundred newtons; round-off of sums of such is 1e-13
    HOLDS = 1e-10

    @pytest.mark.parametrize(
        "known, prefer, branches",
        [
            ("T", (), {}),
            ("T", (), arm_branches((-1, 1, -1))),
            ("q", (), {}),
            ("q", (), {"plate_ahead": -1}),
            ("tau", "T", {}),
            ("tau", "q", {}),
        ],
    )
    def test_hold_at_the_solved_point(self, known, prefer, branches):
        r = heavy("l1_camera")
        s = random_states(r, 1, seed=16)[0]
        rates = s.Td / 2
        given_ = {"T": s.T, "der(T)": s.Td, "der(T,2)": s.Tdd, "q": s.q, "der(q)": rates, "der(q,2)": s.Tdd / 3}
        residuals = original_residuals(r, {**given_, "tau": [300.0, -200.0, 100.0]}, known, prefer, branches)
        assert len(residuals) == 129
        assert np.max(np.abs(residuals)) < self.HOLDS

    @pytest.mark.parametrize("known, degrees_of_freedom", [("q", 0), ("T", 0), ("tau", 6)])
    def test_structure(self, known, degrees_of_freedom):
        flat = flat_of(robot())
        given_ = set(flat.lookup(known)[1])
        kept = eliminate(flat, frozenset(given_))
        unknowns = [v.index for v in flat.variables if v.index not in kept.removed and v.index not in given_]
        structure = analyse(flat, kept.equations, unknowns)
        column = set(unknowns)
        pairs = [{p for p in flat.scope.symbols_in(e.residual) if p[0] in column} for e in kept.equations]
        assert structure.c.tolist() == differentiation_counts(pairs)
        assert (structure.degrees_of_freedom, structure.index) == (degrees_of_freedom, 3)


class TestProperties:
    """hypothesis over the reachable states of one strategy."""

    @EXAMPLES
    @given(st.data(), st.sampled_from(["l1_tape", "l1_camera"]), st.sampled_from(SIDES))
    def test_inverse_kinematics_closes_every_link(self, data, name, sides):
        r = robot(name)
        state = data.draw(reachable_states(r, sides))
        q = values(r.causal("T", "q", branches=arm_branches(sides)), state.T)
        links = state.T - np.asarray(r.A) - q[:, None] * np.asarray(r.v)
        assert relative_error(np.sum(links**2, axis=1), np.asarray(r.L) ** 2) < ROUND_OFF
        along = np.sum(links * np.asarray(r.v), axis=1) * np.array(sides)
        length = np.linalg.norm(np.asarray(r.v), axis=1) * np.asarray(r.L)
        assert np.all(along > (MIN_COSINE - 1e-9) * length)

    @EXAMPLES
    @given(st.data(), st.sampled_from(MOVING))
    def test_velocities_are_derivatives_of_positions(self, data, name):
        r = robot(name)
        s = data.draw(reachable_states(r))
        jacobian, status = r.causal("T", "q").jacobian(s.T)
        assert status == Status.OK
        found = values(heavy(name).causal("T", INVERSE), s.T, s.Td, s.Tdd)[1]  # masses play no part
        assert relative_error(jacobian @ s.Td, found) < ROUND_OFF

    @EXAMPLES
    @given(st.data(), st.sampled_from(MOVING), st.sampled_from(["T", "q"]))
    def test_accelerations_come_back_from_forces(self, data, name, prefer):
        r = heavy(name)
        s = data.draw(reachable_states(r))
        _, qd, _, tau = values(r.causal("T", INVERSE), s.T, s.Td, s.Tdd)
        state = (s.T, s.Td) if prefer == "T" else (s.q, qd)
        assert relative_error(values(r.causal("tau", "der(T,2)", prefer=prefer), *state, tau), s.Tdd) < TWO_SOLVES

    @EXAMPLES
    @given(st.data())
    def test_tensions_balance_the_plate(self, data):
        # Newton's law of the plate alone, from the asked tensions: m_p (Tdd - g) = -sum of tension_i d_i
        r = robot("l1_camera")
        s = data.draw(reachable_states(r))
        names = [f"arm[{i}].rod.tension" for i in range(3)]
        tension = np.array(values(r.causal("T", names), s.T, s.Td, s.Tdd))
        links = s.T - np.asarray(r.A) - s.q[:, None] * np.asarray(r.v)
        force = float(r.m_p) * (s.Tdd - [0.0, 0.0, -9.81])
        assert relative_error(-tension @ links, force) < TWO_SOLVES
