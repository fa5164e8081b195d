"""Reachability: reasons by another road, rows and single calls, chunks, clusters, memory, numbers of the L1."""

import pickle
import tracemalloc
from itertools import product

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.kinematics.section import across_guideways
from gtmodel.kinematics.workspace import (
    FIRST_LIMIT,
    NOT_LOOKED_AT,
    REACHABLE,
    ActuatorLimits,
    BallJointCones,
    CartesianBox,
    FrameClearance,
    Grid,
    InverseKinematics,
    LinkClearance,
    Obstacles,
    Reach,
    Singularities,
    box_grid,
    map_grid,
    map_section,
    map_volume,
)
from gtmodel.results import Status
from tests.kinematics.by_hand import HOME, L1, disc_intersection_area

INVERSE = InverseKinematics(L1)
# the step's square, on boundaries with corners
AREA = 2e-3
SECTION = across_guideways(L1.A, L1.v, HOME)
WINDOW = ((-2.1, -0.7), (0.7, 2.0))


def limits() -> list:
    home = INVERSE(HOME[None])
    return [
        Singularities(L1.v, np.radians(0.5)),
        ActuatorLimits(np.full(3, -1.0), np.full(3, 0.5)),
        CartesianBox(np.array([-9.0, -1.3, -9.0]), np.full(3, 9.0)),
        BallJointCones.about_home(home, np.radians(40.0)),
        Obstacles(np.array([[0.9, -0.7, 0.0]]), np.array([[1.1, -0.5, 0.3]]), np.full(3, 0.05), 0.1),
        FrameClearance(np.array([[[0.3, -1.0, 0.8], [0.3, -1.0, 1.6]]]), np.array([0.05]), np.full(3, 0.03), [(0, 0)]),
    ]


def points(n: int = 400) -> np.ndarray:
    rng = np.random.default_rng(2)
    T = np.column_stack([rng.uniform(0.0, 2.0, n), rng.uniform(-2, 0.8, n), rng.uniform(-0.6, 2.0, n)])
    T[::50] = np.nan
    return T


class TestCodes:
    def test_reasons_by_hand_one_point_after_the_other(self) -> None:
        """The first limit that fails, by plain trigonometry and brute force on 400 points of each link."""
        reach, home = Reach(INVERSE, limits()), INVERSE(HOME[None]).directions[0]
        T = points()
        codes = reach(T)
        s = np.linspace(0, 1, 400)[:, None]
        beam = np.array([0.3, -1.0, 0.8]) + np.linspace(0, 1, 150)[:, None] * [0, 0, 0.8]
        doubtful = 0
        for t, code in zip(T, codes, strict=True):
            poses = INVERSE(t[None])
            if poses.status[0]:
                assert code == poses.status[0]
                continue
            q, a = poses.q[0], poses.a[0]
            u = (t - a) / np.linalg.norm(t - a, axis=1, keepdims=True)
            planes = [
                abs(np.linalg.det(u)) / np.linalg.norm(np.cross(u[(i + 1) % 3], u[(i + 2) % 3])) for i in range(3)
            ]
            links = [a[i] + s * (t - a[i]) for i in range(3)]
            box = [np.linalg.norm(p - np.clip(p, [0.9, -0.7, 0.0], [1.1, -0.5, 0.3]), axis=1).min() for p in links]
            plate = np.linalg.norm(t - np.clip(t, [0.9, -0.7, 0.0], [1.1, -0.5, 0.3]))
            frame = [np.linalg.norm(p[:, None] - beam[None], axis=2).min() for p in links[1:]]
            margins = [
                np.degrees(np.arcsin(min([*np.abs(u[:, 0]), *planes]))) - 0.5,
                min((q + 1.0).min(), (0.5 - q).min()),
                t[1] + 1.3,
                40.0 - np.degrees(np.arccos(np.clip((u * home).sum(axis=1), -1, 1))).max(),
                min(min(box) - 0.05, plate - 0.1),
                min(frame) - 0.08,
            ]
            if np.min(np.abs(margins)) < 3e-3:  # brute force cannot tell
                doubtful += 1
                continue
            failed = [k for k, margin in enumerate(margins) if margin < 0]
            assert code == (FIRST_LIMIT + failed[0] if failed else REACHABLE)
        assert doubtful < 12
        # every reason occurs
        assert {0, Status.OUT_OF_RANGE, Status.NOT_FINITE, *(FIRST_LIMIT + k for k in range(1, 6))} <= {*codes}

    def test_rows_and_single_calls_agree_and_nan_harms_nobody(self) -> None:
        reach, T = Reach(INVERSE, limits()), points()
        codes = reach(T)
        assert [reach(t) for t in T] == codes.tolist()
        assert (codes[::50] == Status.NOT_FINITE).all()
        good = np.isfinite(T).all(axis=1)
        np.testing.assert_array_equal(reach(T[good]), codes[good])

    def test_every_code_has_its_sentence(self) -> None:
        reach, T = Reach(INVERSE, limits()), points()
        codes = reach(T)
        assert sum(reach.counts(codes).values()) == len(T)
        for code in np.unique(codes):
            text = reach.diagnose(T[codes == code][0])
            assert text.endswith(" m can be reached") if code == 0 else ") m cannot be reached: " in text
        assert "ball-joint cones of 40 deg violated by" in reach.diagnose(T[codes == FIRST_LIMIT + 3][0])
        assert Status.NOT_FINITE.message in reach.diagnose(T[0])

    def test_singular_poses_are_out_of_the_workspace(self) -> None:
        reach = Reach(INVERSE, [Singularities(L1.v, 1e-6)])
        # link 3 orthogonal to its guideway, and beside it
        edge = np.array([1.0, -L1.L[2] / np.sqrt(2), L1.L[2] / np.sqrt(2)])
        assert reach(edge) in (FIRST_LIMIT, Status.OUT_OF_RANGE) and reach(edge * [1, 0.99, 0.99]) == REACHABLE
        # three carts and the plate in one plane: arms that hold nothing sideways
        flat = type(L1)(np.array([[0.0, -1, 0], [0, 0, 0], [0, 1, 0]]), L1.v, np.full(3, 2.0))
        reach = Reach(InverseKinematics(flat), [Singularities(L1.v, 1e-6)])
        assert reach([1.0, 0.1, 0.0]) == FIRST_LIMIT and reach([1.0, 0.1, 0.2]) == REACHABLE
        assert "singularity limit violated by" in reach.diagnose([1.0, 0.1, 0.0])

    def test_links_keep_off_one_another(self) -> None:
        offsets = np.array([[0.0, 0.0, 0.1], [0.0, -0.1, 0.0], [0.0, 0.1, -0.1]])
        inverse = InverseKinematics(L1, offsets)
        poses = inverse(HOME[None])
        clearance = LinkClearance(np.full(3, 0.02))
        s = np.linspace(0, 1, 300)
        for column, (i, j) in enumerate([(0, 1), (0, 2), (1, 2)]):
            p = poses.a[0, i] + s[:, None] * (poses.b[0, i] - poses.a[0, i])
            r = poses.a[0, j] + s[:, None] * (poses.b[0, j] - poses.a[0, j])
            brute = np.linalg.norm(p[:, None] - r[None], axis=2).min() - 0.04
            assert clearance.margins(poses)[0, column] == pytest.approx(brute, abs=1e-4)
        assert Reach(inverse, [clearance])(HOME) == REACHABLE
        for radius in (0.02, 0.0):  # without offsets they meet
            assert Reach(INVERSE, [LinkClearance(np.full(3, radius))])(HOME) == FIRST_LIMIT

    def test_wrong_shapes(self) -> None:
        with pytest.raises(TypeError, match=r"\(3,\) or \(n, 3\); found \(2,\)"):
            Reach(INVERSE)([1.0, 2.0])


class TestMaps:
    GRID = box_grid((0.5, -1.8, -0.5), (1.0, 0.6, 1.9), 0.1)

    def test_chunks_do_not_change_the_codes(self) -> None:
        reach = Reach(INVERSE, limits())
        expected = reach(self.GRID.points()).reshape(self.GRID.shape)
        for chunk in (7, 1000):
            found = map_grid(reach, self.GRID, chunk=chunk)
            assert found.complete
            np.testing.assert_array_equal(found.codes, expected)

    def test_a_model_travels_to_other_processes(self) -> None:
        robot = gt.robots.gantry_tau("l1_tape")
        function = robot.causal("T", ["q", *(f"arm[{i}].rod.{end}.r" for i in range(3) for end in "ab")])
        reach = pickle.loads(pickle.dumps(Reach(InverseKinematics(function), limits())))
        by_hand = map_grid(Reach(INVERSE, limits()), self.GRID)
        np.testing.assert_array_equal(map_grid(reach, self.GRID).codes, by_hand.codes)
        assert "arm[" in reach.diagnose(np.array([0.5, 3.0, 0.0]))

    def test_progress_and_stop(self) -> None:
        seen: list[float] = []

        def stop(fraction: float) -> bool:
            seen.append(fraction)
            return fraction > 0.5

        found = map_grid(Reach(INVERSE), self.GRID, chunk=100, progress=stop)
        assert not found.complete and seen == sorted(seen) and 0.5 < seen[-1] < 1.0
        left = np.count_nonzero(found.codes == NOT_LOOKED_AT)
        assert left == self.GRID.size - round(seen[-1] * self.GRID.size) > 0

    def test_memory_is_the_result_and_a_constant(self) -> None:
        reach, beyond = Reach(INVERSE, limits()[:4]), []
        for count in (40_000, 320_000):
            grid = Grid(HOME, np.eye(3)[1:], (np.linspace(-1, 1, 200), np.linspace(-1, 1, count // 200)))
            tracemalloc.start()
            found = map_grid(reach, grid, chunk=2000)
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            assert found.codes.nbytes == count
            beyond.append(peak - count)
        # a chunk's codes kept once more would add 280 kB; Python's own lists of freed tuples, which fill up to 2000
        # of a size, some 500 bytes a chunk until they are full
        assert beyond[1] < beyond[0] + 140_000
        assert beyond[0] > 2000 * 3 * 8  # it did measure the chunks


class TestNumbers:
    def test_three_discs_of_the_l1(self) -> None:
        found = map_section(Reach(INVERSE), SECTION, *WINDOW, 0.02)
        expected = disc_intersection_area(L1.A[:, 1:], L1.L)
        assert found.region.area == pytest.approx(expected, rel=AREA)
        assert 3.1 < found.region.area < 3.4 and found.region.extent == pytest.approx([2.3, 2.1], abs=0.1)

    @pytest.mark.parametrize(("angle", "low", "high"), [(30, 1.55, 1.7), (45, 2.6, 2.8)])
    def test_cones_of_the_l1(self, angle: float, low: float, high: float) -> None:
        home = INVERSE(HOME[None])
        cone = BallJointCones.about_home(home, np.radians(angle))
        assert "home pose (1.422, -0.4367, 0.9667) m" in cone.assumes and "not known" in cone.assumes
        found = map_section(Reach(INVERSE, [cone]), SECTION, *WINDOW, 0.02)
        assert low < found.region.area < high
        # by counting seeded draws: one in a hundred at four standard deviations
        n = 40_000
        uv = np.random.default_rng(8).uniform(*WINDOW, (n, 2))
        poses = INVERSE(np.column_stack([np.full(n, HOME[0]), uv]))
        cosine = (poses.directions * home.directions[0]).sum(axis=2).min(axis=1)
        size = np.prod(np.subtract(WINDOW[1], WINDOW[0]))
        share = np.mean(cosine >= np.cos(np.radians(angle)))
        assert found.region.area == pytest.approx(size * share, abs=4 * size * np.sqrt(share * (1 - share) / n))

    def test_volume_of_a_ball(self) -> None:
        ball = lambda T: (T[:, :1], T, T, np.where((T**2).sum(axis=1) <= 1, 0, 1))  # noqa: E731
        along = np.linspace(-1.05, 1.05, 85)
        section = across_guideways(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), [0, 0, 0])
        found = map_volume(Reach(InverseKinematics(ball)), section, (-1.1, -1.1), (1.1, 1.1), along, 0.1)
        assert found.volume == pytest.approx(4 / 3 * np.pi, rel=5e-3) and not found.on_edge
        assert found.counts["reachable"] > 0 and len(found.areas) == 85

    @pytest.mark.parametrize("sections", [2, 3, 6, 30])
    @pytest.mark.parametrize("range_m", [(-1.05, 1.05), (-40.0, 3.0), (-0.2, 17.0)])
    def test_added_sections_find_the_volume_from_any_start(self, sections: int, range_m: tuple[float, float]) -> None:
        # an ellipsoid, 1.6 m long, and a cylinder beside it of 0.3 m, whose area jumps
        def solid(T):
            ball = (T[:, 0] / 0.8) ** 2 + T[:, 1] ** 2 + T[:, 2] ** 2 <= 1
            can = (np.abs(T[:, 0] - 0.9) <= 0.15) & (T[:, 1] ** 2 + T[:, 2] ** 2 <= 0.25)
            return T[:, :1], T, T, np.where(ball | can, 0, 1)

        section = across_guideways(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), [0, 0, 0])
        low, high = range_m
        found = map_volume(
            Reach(InverseKinematics(solid)), section, (-1.1, -1.1), (1.1, 1.1), np.linspace(low, high, sections), 0.1,
            tolerance=0.01, coarse=True,
        )  # fmt: skip
        x = np.linspace(low, high, 400_001)
        area = np.pi * np.maximum(np.maximum(1 - (x / 0.8) ** 2, 0), np.where(np.abs(x - 0.9) <= 0.15, 0.25, 0))
        true = float(np.trapezoid(area, x))
        # beside the sections' own areas on a grid of 0.1 m
        assert abs(found.volume - true) <= found.error + 5e-3 * true and found.error <= 0.01 * found.volume
        assert len(found.along) <= 120 and found.coarse == pytest.approx(true, rel=3e-2)

    @pytest.mark.parametrize("number", range(5))
    def test_a_part_that_stands_apart_is_not_passed_over(self, number: int) -> None:
        rng = np.random.default_rng(number)
        apart, half, start = rng.uniform(1.4, 8), rng.uniform(0.45, 0.6), int(rng.choice([3, 5, 9, 14]))
        low, high = -rng.uniform(2, 20), rng.uniform(9, 14)

        def solid(T):
            square = T[:, 1] ** 2 + T[:, 2] ** 2
            parts = (T[:, 0] / 0.8) ** 2 + square <= 1, ((T[:, 0] - apart) / half) ** 2 + square / 0.81 <= 1
            return T[:, :1], T, T, np.where(parts[0] | parts[1], 0, 1)

        section = across_guideways(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), [0, 0, 0])
        found = map_volume(
            Reach(InverseKinematics(solid)), section, (-1.1, -1.1), (1.1, 1.1), np.linspace(low, high, start), 0.1,
            tolerance=0.02,
        )  # fmt: skip
        true = 4 / 3 * np.pi * (0.8 + 0.81 * half)
        assert abs(found.volume - true) <= found.error + 5e-3 * true and found.error <= 0.02 * true

    def test_too_few_sections_for_the_range_have_no_error_estimate(self) -> None:
        ball = lambda T: (T[:, :1], T, T, np.where((T**2).sum(axis=1) <= 1, 0, 1))  # noqa: E731
        section = across_guideways(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), [0, 0, 0])
        reach, window = Reach(InverseKinematics(ball)), ((-1.1, -1.1), (1.1, 1.1))
        assert (
            map_volume(reach, section, *window, np.linspace(-90, 90, 3), 0.2, tolerance=0.05, most=40).error == np.inf
        )

    def test_where_nothing_is_reached_the_error_has_no_bound(self) -> None:
        nothing = lambda T: (T[:, :1], T, T, np.ones(len(T)))  # noqa: E731
        section = across_guideways(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), [0, 0, 0])
        found = map_volume(
            Reach(InverseKinematics(nothing)), section, (-1, -1), (1, 1), np.array([0.0, 8.0]), 0.5, tolerance=0.01,
            most=33,
        )  # fmt: skip
        assert found.volume == 0.0 and found.error == np.inf and found.widest == 0.25 and len(found.along) == 33

    def test_stopped_volume(self) -> None:
        found = map_volume(
            Reach(INVERSE), SECTION, *WINDOW, np.linspace(0, 1, 5), 0.1, progress=lambda fraction: fraction > 0.3
        )
        assert not found.complete and len(found.areas) == len(found.along) == 2


def test_box_grid_holds_its_corners() -> None:
    grid = box_grid((0, 0, 0), (1, 2, 0.3), 0.25)
    T = grid.points()
    assert grid.size == len(T) == np.prod(grid.shape)
    for corner in product((0, 1), (0, 2), (0, 0.3)):
        assert np.any(np.all(np.abs(T - corner) < 1e-12, axis=1))
    np.testing.assert_array_equal(grid.points(5, 9), T[5:9])
