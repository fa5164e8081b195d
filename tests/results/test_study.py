"""Studies: quantities declared once, verdicts, options, and the sections of problem files made from them."""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass, field
from typing import Annotated, Literal, Unpack

import numpy as np
import pytest
from hypothesis import given, strategies as st

from gtmodel.problem_files import InputError
from gtmodel.problem_files.base import Call, Problem
from gtmodel.problem_files.from_options import Made, key_of, made_from, section_of
from gtmodel.problem_files.load import validate
from gtmodel.results import (
    ArgumentError,
    Check,
    Long,
    Options,
    Quantity,
    SolveStatus,
    Study,
    Unit,
    Within,
    Work,
    at_least,
    at_most,
    read,
)  # fmt: skip
from gtmodel.results.disk import MadeFiles
from gtmodel.results.quantity import converted, described, named, split
from gtmodel.results.table import csv_text
from gtmodel.results.work import WorkOptions, study_function

UNITS = ["", "1", "m", "N", "N/m", "N.m", "N.m/rad", "m/s2", "Hz", "kg.m2", "%", "rad", "deg", "MN.m/rad", "kg/s"]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Beam(Study):
    stiffness: Annotated[np.ndarray, Quantity("N/m", "along the axes", "stiffness", "kN/m")]
    mass: Annotated[float | None, Quantity("kg", "of all", "mass")] = None
    reasons: Annotated[dict, Quantity("", "why")] = field(default_factory=dict)


def beam(**more) -> Beam:
    return Beam(status=SolveStatus.SOLVED, stiffness=np.array([2e3, 4e3]), **more)


def test_one_declaration_gives_attribute_value_row_and_description():
    b = beam()
    assert list(b.values) == ["stiffness_N_m", "mass_kg", "reasons"] == list(described(Beam))
    assert b.values["stiffness_N_m"] is b.stiffness
    (row,) = b.rows  # what has no value has no row
    assert tuple(row) == ("stiffness", "2, 4", "kN/m")
    assert beam(mass=3.0).rows[1].unit == "kg"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Tool(Study):
    sag: Annotated[float | None, Quantity("m", "by which it hangs", "hangs by", "um", written="mm")]
    turned: Annotated[list[float], Quantity("rad", "at both ends", written="deg")]


@given(st.floats(-7, 7))
def test_a_quantity_is_written_in_the_unit_that_people_write(angle):
    s = Tool(status=SolveStatus.SOLVED, sag=2e-3, turned=[0.0, angle])
    assert s.values["sag_mm"] == 2.0 and s.rows[0].value == 2000.0
    assert s.values["turned_deg"][1] == np.degrees(angle)
    assert s.with_(sag=None).values["sag_mm"] is None


@pytest.mark.parametrize("unit", UNITS)
def test_names_carry_units_both_ways(unit):
    assert split(named("inertia", unit)) == ("inertia", "" if unit == "1" else unit)


def test_a_unit_that_no_name_carries_is_refused():
    with pytest.raises(ValueError, match=r"no name can express the unit kg.m3: 'x_kgm3' reads as no unit"):
        named("x", "kg.m3")


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("compliance_m_per_N", ("compliance", "m/N")),
        ("range_noise_um_per_m", ("range_noise", "um/m")),
        ("gain_per_s", ("gain", "1/s")),
        ("device_per_session", ("device_per_session", "")),
        ("feed_per_tooth_m", ("feed_per_tooth", "m")),
        ("drawn_per", ("drawn_per", "")),
        ("damping_Ns_m", ("damping", "N.s/m")),
        ("gain_rad_s_Nm", ("gain", "rad/s/(N.m)")),
    ],
)
def test_per_divides_where_units_stand_about_it(name: str, parts: tuple[str, str]) -> None:
    assert split(name) == parts


def test_solved_with_a_failed_check_does_not_exist():
    failed = beam(checks={"end_m": at_most(2.0, 1.0, "go on")})
    assert failed.status is SolveStatus.CHECK_FAILED and "go on" in failed.message
    assert beam().with_(checks={"end_m": at_most(2.0, 1.0)}).status is SolveStatus.CHECK_FAILED
    assert beam(checks={"end_m": at_most(1.0, 1.0)}).status is SolveStatus.SOLVED


@given(st.floats(), st.floats(allow_nan=False))
def test_checks_compare_and_what_is_no_number_fails(value, bound):
    assert at_most(value, bound).passed == (value <= bound)
    assert at_least(value, bound).passed == (value >= bound)
    assert Check(value).passed == math.isfinite(value)
    assert not Check(value, bound, judged=False).passed


def test_notes_of_a_file_join_those_that_a_study_has_under_their_name():
    @dataclass(frozen=True, kw_only=True, eq=False, repr=False)
    class Doubtful(Study):
        limits: Annotated[tuple[str, ...], Quantity("", "what limits it", key="notes")] = ()
        last: Annotated[int, Quantity("", "behind")] = 0

    found = Doubtful(status=SolveStatus.SOLVED, limits=("few",))
    assert found.values == {"notes": ("few",), "last": 0}
    assert found.with_(notes=["old file"]).values == {"notes": ["few", "old file"], "last": 0}
    assert list(found.with_(notes=["old file"]).values) == ["notes", "last"]


def test_numbers_by_name_are_written_in_another_unit():
    assert Quantity("m", written="mm").value({"mean": 2e-3, "max": None}) == {"mean": 2.0, "max": None}
    stiff = 3926493.2683060767
    assert Quantity("N.m/rad", written="MN.m/rad").value(stiff) == stiff / 1e6 != 1e-6 * stiff


def test_files_are_made_when_they_are_asked_for():
    asked = []
    files = MadeFiles({"a.csv": lambda: asked.append(1) or "1", "b.csv": lambda: "2"})
    assert list(files) == ["a.csv", "b.csv"] and len(files) == 2 and not asked
    assert dict(files) == {"a.csv": "1", "b.csv": "2"} and asked == [1]


def test_a_call_may_be_finished():
    call = Call(lambda a, **work: beam(mass=a), 2.0).then(lambda study: study.with_(title="seen"))
    found = call(stop=lambda: False)
    assert found.mass == 2.0 and found.title == "seen"


@dataclass(frozen=True)
class _Prior(Options):
    std: Annotated[float, Unit("m", written="mm"), Within(above=0)] = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.std == 2e-3:
            raise ArgumentError("is two", "std")


@dataclass(frozen=True)
class _Fit(Options):
    priors: dict[str, _Prior] = field(default_factory=dict)
    sizes: Annotated[dict[str, float], Within(above=0)] = field(default_factory=dict)
    width: Annotated[float | list[float], Long(3)] = 1.0


def test_options_by_name_and_in_lists_keep_their_bounds_and_places():
    table = section_of(_Fit)
    found = validate(table, {"priors": {"A": {"std_mm": 5.0}}, "sizes": {"A": 2.0}}).options()
    assert found.priors["A"].std == pytest.approx(5e-3) and found.sizes == {"A": 2.0} and found.width == 1.0
    with pytest.raises(InputError) as refused:
        validate(table, {"sizes": {"A": -2.0}})
    assert refused.value.key == "sizes.A"
    with pytest.raises(ArgumentError) as caught:
        validate(table, {"priors": {"A": {"std_mm": 2.0}}}).options()
    assert caught.value.argument == "priors.A.std"
    for wrong in ({"sizes": {"A": -1.0}}, {"width": [1.0, 2.0]}):
        with pytest.raises(ArgumentError):
            _Fit(**wrong)


def test_texts_show_every_row_and_check():
    b = beam(mass=1.5, checks={"end_error_m": at_most(1e-3, 2e-3)}, notes=["a <b>"], title="T")
    for told in (str(b), b._repr_html_()):
        assert all(word in told for word in ("solved", "stiffness", "2, 4", "kN/m", "1.5", "end error", "passed"))
    assert "&lt;b&gt;" in b._repr_html_() and repr(b) == "<Beam: solved>"


def test_a_picture_that_is_not_there_is_refused():
    with pytest.raises(ArgumentError) as caught:
        beam(figures={"motion": object}).figure("force")
    assert caught.value.argument == "name"


@dataclass(frozen=True)
class Inner(Options):
    angle: Annotated[float, Unit("rad", written="deg"), Within(above=0.0, most=math.pi), "of it"] = math.pi / 2
    shape: Annotated[Literal["line", "arc"], "of it"] = "line"


@dataclass(frozen=True)
class Limits(Options):
    """How much."""

    force: Annotated[float | list[float], Unit("N"), Within(above=0.0), "largest motor force"]
    place: Annotated[list[float] | None, Unit("m"), Long(3), "where"] = None
    inner: Inner = Inner()


@pytest.mark.parametrize(
    ("made", "argument"),
    [
        (lambda: Limits(0.0), "force"),
        (lambda: Limits([1.0, -1.0]), "force"),
        (lambda: Limits(math.nan), "force"),
        (lambda: Limits(1.0, [1.0]), "place"),
        (lambda: Inner(4.0), "angle"),
        (lambda: Inner(shape="round"), "shape"),
    ],
)
def test_options_are_checked_whoever_makes_them(made, argument):
    with pytest.raises(ArgumentError) as caught:
        made()
    assert caught.value.argument == argument


def test_a_section_is_made_of_options_and_gives_them_back():
    given = {"force_N": [1.0, 2.0], "place_m": [0.0, 1.0, 2.0], "inner": {"angle_deg": 30.0}}
    found = validate(section_of(Limits), given).options()
    assert found == Limits([1.0, 2.0], [0.0, 1.0, 2.0], Inner(math.radians(30.0)))
    assert validate(section_of(Limits), {"force_N": 1.0}).options() == Limits(1.0)


@dataclass(frozen=True)
class Places(Options):
    places: Annotated[list[list[float]], Unit("m"), Long(2), "of it"]


def test_the_length_of_a_list_of_lists_is_that_of_its_rows():
    assert Places([]).places == [] and Places([[0.0, 1.0]] * 3).places
    with pytest.raises(ArgumentError) as caught:
        Places([[0.0, 1.0], [0.0]])
    assert caught.value.argument == "places"
    made = section_of(Places)
    assert validate(made, {"places_m": [[0.0, 1.0]] * 3}).options() == Places([[0.0, 1.0]] * 3)
    with pytest.raises(InputError) as refused:
        validate(made, {"places_m": [[0.0, 1.0], [0.0]]})
    assert refused.value.key == "places_m[1]"


@dataclass(frozen=True)
class Scales(Options):
    length: Annotated[float, Unit("m"), "of it"] = 1.0
    angle: Annotated[float, Unit("rad", written="deg", key="scale_deg"), "of it"] = math.pi / 3


def test_a_key_may_have_a_name_of_its_own_and_defaults_are_round():
    made = section_of(Scales)
    assert made.model_fields["scale_deg"].default == 60.0  # pi / 3 in degrees is 59.99999999999999
    assert validate(made, {}).options().angle == math.radians(60.0)


@pytest.mark.parametrize(
    ("given", "key"),
    [
        ({"force_N": 0.0}, "force_N"),
        ({}, "force_N"),
        ({"force_N": 1.0, "place_m": [1.0]}, "place_m"),
        ({"force_N": 1.0, "inner": {"angle_deg": 200.0}}, "inner.angle_deg"),
        ({"force_N": 1.0, "angle": 1.0}, "angle"),
    ],
)
def test_a_section_refuses_at_its_key(given, key):
    with pytest.raises(InputError) as caught:
        validate(section_of(Limits), given)
    assert caught.value.key == key


@made_from(Limits, "inner")
class _Table(Made):
    """With a key of its own."""

    more: int = 0


class _Schema(Problem):
    limits: _Table
    several: list[_Table]


def test_what_a_table_says_of_itself_leaves_out_the_python_examples_of_its_options() -> None:
    @dataclass(frozen=True)
    class Force(Options):
        """What a motor must keep.

        >>> Force(newtons=700.0)
        """

        newtons: float

    assert section_of(Force).model_json_schema()["description"] == "What a motor must keep."


@pytest.mark.parametrize(
    ("argument", "key"),
    [
        ("limits.force", "limits.force_N"),
        ("bounds.force", "limits.force_N"),
        ("bounds", "limits"),
        ("several[12]", "several[12]"),
        ("several[12].force", "several[12].force_N"),
        ("poses[3]", "several[3]"),
        ("poses[3].force", "several[3].force_N"),
        ("other", "other"),
    ],
)
def test_arguments_are_found_among_the_keys(argument, key):
    assert key_of(_Schema, argument, {"bounds": "limits", "poses": "several"}) == key


@pytest.mark.parametrize(
    ("written", "unit", "factor"), [("um", "m", 1e-6), ("mm", "m", 1e-3), ("deg", "rad", np.pi / 180)]
)
def test_a_file_gives_the_bits_that_a_call_gives(written, unit, factor):
    x = np.arange(1.0, 200.0)
    np.testing.assert_array_equal(converted(x, written, unit), factor * x)


def test_a_table_has_digits_by_column_and_empty_cells():
    text = csv_text({"a_m": np.array([1 / 3, np.nan]), "b_m": np.array([2 / 3, 1.0])}, {"a_m": 3, "b_m": 5})
    assert text == "a_m,b_m\n0.333,0.66667\n,1\n"


def test_work_ends_by_time_and_by_request():
    assert Work(max_seconds=0.0).interrupted() and Work(stop=lambda: True).interrupted()
    assert not Work().interrupted() and Work().seconds_left() is None


def test_a_study_that_is_ended_is_what_it_kept():
    @study_function
    def steps(count: int, **work_options: Unpack[WorkOptions]) -> Study:
        work, done = Work(**work_options), []
        if count:
            work.keep(lambda: Study(status=SolveStatus.INTERRUPTED, notes=done))
        for k in range(count):
            done.append(f"step {k}")
            inner = steps(0, stop=lambda: True)  # a study inside keeps nothing of the outer one
            assert inner.status is SolveStatus.INTERRUPTED and not inner.notes
        work.step("the end")
        return Study(status=SolveStatus.SOLVED)

    s = steps(3, stop=lambda: True)
    assert s.status is SolveStatus.INTERRUPTED and list(s.notes) == ["step 0", "step 1", "step 2"]
    assert steps(0, stop=lambda: True).message == "stopped before the end"


def test_an_optimiser_tells_of_its_iterations_and_is_stopped():
    told = []
    work = Work(progress=lambda *given: told.append(given), stop=lambda: len(told) > 1)
    assert [work.iterations("optimising")(k, 2.0, 0.5) for k in (1, 2)] == [False, True]
    assert told[0] == ("optimising", None, {"iteration": 1, "objective": 2.0, "violation": 0.5})


def test_a_written_study_is_given_back(tmp_path):
    b = beam(mass=2.5, checks={"end_m": at_most(0.5, 1.0)}, notes=["a note"], files={"map.csv": "a,b\n1,2\n"})
    paths = b.write(tmp_path / "out")
    assert {p.name for p in paths} == {"result.json", "run.toml", "map.csv"}
    again = read(tmp_path / "out")
    assert again.status is b.status and again.values == {**b.values, "stiffness_N_m": [2e3, 4e3]}
    assert again.notes == ["a note"]
    assert str(again).count("a note") == again._repr_html_().count("a note") == 1
    assert again.mass == 2.5 and again.checks["end_m"].passed and "solved" in str(again)
    assert b.write(tmp_path / "out") == paths  # what gtmodel wrote it may replace
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a.txt").write_text("mine")
    for call in (
        lambda: b.write(tmp_path / "mine"),
        lambda: b.write(3),
        lambda: read(tmp_path / "mine"),
        lambda: read(tmp_path / "none"),
    ):
        with pytest.raises(ArgumentError) as caught:
            call()
        assert caught.value.argument == "folder"


def test_what_a_machine_follows_is_not_written_of_a_failed_study(tmp_path):
    b = beam(checks={"end_m": at_most(2.0, 1.0)}, files={"motion.mod": "MODULE\n"}, machine_files=("motion.mod",))
    assert "motion.mod" not in {p.name for p in b.write(tmp_path / "a")}
    b.write(tmp_path / "b", write_failed=True)
    assert "NOT TO BE USED" in (tmp_path / "b" / "motion.mod").read_text().splitlines()[0]


def test_a_study_takes_what_work_takes_and_shows_it():
    @study_function
    def one(count: int, **work_options: Unpack[WorkOptions]) -> Study:
        return Study(status=SolveStatus.SOLVED, title=Work(**work_options).title)

    assert list(inspect.signature(one).parameters) == ["count", *WorkOptions.__annotations__]
    assert one(1, title="of one").title == "of one" and one(1).title == ""
    with pytest.raises(ArgumentError) as refused:
        one(1, max_seconds=-1.0)
    assert refused.value.argument == "max_seconds"
    with pytest.raises(TypeError, match=r"one\(\) got an unexpected keyword argument 'titel'"):
        one(1, titel="of one")  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"one\(\) missing a required argument: 'count'"):
        one()  # type: ignore[call-arg]
