"""Models as configurations: modifiers, parts, redeclaration, outer references, immutability."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.mechanics import PointFrame, PointMass, World


class Gain(gt.Model):
    """y = k"""

    k = gt.parameter(1.0, unit="1")
    y = gt.variable(unit="1")

    def equations(self):
        yield self.y == self.k


class Doubled(Gain):
    """y = 2 k + offset"""

    offset = gt.parameter(0.0, unit="1")

    def equations(self):
        yield self.y == 2 * self.k + self.offset


class Holder(gt.Model):
    """A part inside a part; `k` here is not the `k` of whoever holds the holder."""

    k = gt.parameter(5.0, unit="1")
    inner = gt.part(Gain)


def value(model: gt.Model, *names: str) -> Any:
    *found, status = model.causal((), list(names))()
    assert status == gt.Status.OK
    return found[0] if len(found) == 1 else found


class Sum(gt.Model):
    """Three digits."""

    a = gt.parameter(shape=3, unit="1")
    y = gt.variable(unit="1")

    def equations(self):
        yield self.y == self.a @ np.array([1.0, 10.0, 100.0])


class TestModifiers:
    def test_default_given_and_replaced(self):
        assert value(Gain(), "y") == 1.0
        assert value(Gain(k=3.0), "y") == 3.0
        assert value(Gain(k=3.0).with_(k=4.0), "y") == 4.0

    def test_read_back_from_the_configuration(self):
        assert Gain(k=3.0).k == 3.0
        assert Gain().k == 1.0
        assert repr(Gain(k=3.0)) == "Gain(k=3.0)"

    def test_of_a_part_by_value_by_name_by_function(self):
        class Top(gt.Model):
            c = gt.parameter(7.0, unit="1")
            a = gt.part(Gain, k=2.0)
            b = gt.part(Gain, k=c)
            d = gt.part(Gain, k=lambda self: self.c**2)

        assert value(Top(), "a.y", "b.y", "d.y") == [2.0, 7.0, 49.0]
        assert value(Top(c=3.0), "b.y", "d.y") == [3.0, 9.0]

    def test_in_dictionaries_belong_to_the_model_that_wrote_them(self):
        class Top(gt.Model):
            k = gt.parameter(7.0, unit="1")
            c = gt.parameter(11.0, unit="1")
            same_name = gt.part(Holder, inner=dict(k=k))
            other_name = gt.part(Holder, inner=dict(k=c))
            function = gt.part(Holder, inner=dict(k=lambda self: self.k + self.c))
            instance = gt.part(Holder, inner=Doubled(k=c))

        assert value(Top(), *(f"{n}.inner.y" for n in ("same_name", "other_name", "function", "instance"))) == [
            7.0, 11.0, 18.0, 22.0,
        ]  # fmt: skip

    def test_outer_ones_win_and_leave_the_rest(self):
        class Top(gt.Model):
            holder = gt.part(Holder, inner=dict(k=2.0))

        assert value(Top(), "holder.inner.y") == 2.0
        assert value(Top(holder=dict(inner=dict(k=3.0))), "holder.inner.y") == 3.0
        assert value(Top(holder=dict(k=9.0)), "holder.inner.y") == 2.0

    def test_vector_from_scalar_parameters(self):
        class Top(gt.Model):
            c = gt.parameter(7.0, unit="1")
            part = gt.part(Sum, a=[c, 0.0, c])

        assert value(Top(), "part.y") == 707.0

    def test_variable_attributes(self):
        class Top(gt.Model):
            home = gt.parameter(0.25, unit="1")
            gain = gt.part(Gain, y=dict(start=home, max=2.0))

        y = next(v for v in Top().causal((), "gain.y").flat.variables if v.name == "gain.y")
        assert (y.start, y.max, y.min) == (0.25, 2.0, -np.inf)


class TestRedeclaration:
    def test_keeps_modifiers(self):
        class Top(gt.Model):
            c = gt.parameter(7.0, unit="1")
            gain = gt.part(Gain, k=c)

        assert value(Top(gain=Doubled), "gain.y") == 14.0
        assert value(Top(gain=Doubled(offset=1.0)), "gain.y") == 15.0
        assert value(Top(gain=Doubled(k=1.0)), "gain.y") == 2.0

    def test_of_a_part_of_a_part(self):
        class Top(gt.Model):
            holder = gt.part(Holder, inner=dict(k=3.0))

        assert value(Top(holder=dict(inner=Doubled)), "holder.inner.y") == 6.0

    def test_in_an_array(self):
        class Top(gt.Model):
            gain = gt.parts(3, Gain, k=[1.0, 2.0, 3.0])

        names = [f"gain[{i}].y" for i in range(3)]
        assert value(Top(gain=Doubled), *names) == [2.0, 4.0, 6.0]
        assert value(Top(gain=[Gain, Doubled, dict(k=9.0)]), *names) == [1.0, 4.0, 9.0]


class TestArrays:
    def test_rows_and_each(self):
        class Top(gt.Model):
            c = gt.parameter([1.0, 2.0, 3.0], unit="1")
            s = gt.parameter(5.0, unit="1")
            rows = gt.parts(3, Gain, k=c)
            numbers = gt.parts(3, Doubled, k=[1.0, 2.0, 3.0], offset=gt.each(0.5))
            shared = gt.parts(2, Gain, k=gt.each(s))
            listed = gt.parts(2, Gain, k=lambda self: [self.s, self.c[2]])

        names = [f"{n}[{i}].y" for n in ("rows", "numbers") for i in range(3)]
        assert value(Top(), *names) == [1.0, 2.0, 3.0, 2.5, 4.5, 6.5]
        assert value(Top(), "shared[0].y", "shared[1].y", "listed[0].y", "listed[1].y") == [5.0, 5.0, 5.0, 3.0]

    def test_matrix_rows_go_to_parts_as_vectors(self):
        class Top(gt.Model):
            M = gt.parameter([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], unit="1")
            part = gt.parts(2, Sum, a=M)

        assert value(Top(), "part[0].y", "part[1].y") == [321.0, 654.0]

    def test_a_scalar_of_the_model_goes_to_each_part(self):
        class Top(gt.Model):
            s = gt.parameter(5.0, unit="1")
            declared = gt.parts(2, Gain, k=s)
            computed = gt.parts(2, Gain, k=lambda self: 2 * self.s)

        names = [f"{n}[{i}].y" for n in ("declared", "computed") for i in range(2)]
        assert value(Top(), *names) == [5.0, 5.0, 10.0, 10.0]
        assert value(Top(s=3.0), *names) == [3.0, 3.0, 6.0, 6.0]

    @pytest.mark.parametrize("single", [2.0, np.array(2.0)])
    def test_a_single_value_for_all_needs_each(self, single):
        class Top(gt.Model):
            gain = gt.parts(3, Gain, k=single)

        with pytest.raises(gt.ModelError, match=r"needs 3 rows; found a single value; use gt\.each"):
            value(Top(), "gain[0].y")

    def test_wrong_number_of_rows(self):
        class Top(gt.Model):
            gain = gt.parts(3, Gain, k=[1.0, 2.0])

        with pytest.raises(gt.ModelError, match=r"'gain\.k' of an array of 3 parts needs 3 rows; found 2"):
            value(Top(), "gain[0].y")


class TestMatrices:
    def test_elements_keep_their_places(self):
        class Inside(gt.Model):
            A = gt.parameter(shape=(2, 3), unit="1")
            X = gt.variable((2, 3), unit="1")

            def equations(self):
                yield self.X == 2 * self.A

        class Top(gt.Model):
            A = gt.parameter([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], unit="1")
            part = gt.part(Inside, A=A)

        assert value(Top(), "part.X[0,2]", "part.X[1,0]") == [6.0, 8.0]
        assert np.array_equal(value(Top(), "part.X"), [[2.0, 4.0, 6.0], [8.0, 10.0, 12.0]])

    def test_bindings_list_elements_row_by_row(self):
        class Inside(gt.Model):
            A = gt.parameter(shape=(2, 2), unit="1")
            y = gt.variable(unit="1")

            def equations(self):
                yield self.y == self.A[0, 1]

        class Top(gt.Model):
            A = gt.parameter([[1.0, 2.0], [3.0, 4.0]], unit="1")
            part = gt.part(Inside, A=A)

        flat = Top().causal((), "part.y").flat
        assert str(flat.bindings["part.A"]) == str(flat.bindings["A"])


class Probe(gt.Model):
    """Shows the gravity that a component feels."""

    world = gt.outer(World)
    g = gt.variable(3, unit="m/s2")

    def equations(self):
        yield self.g == self.world.g


MOON = [0.0, 0.0, -1.62]


class TestOuter:
    def test_a_default_is_made(self):
        class Top(gt.Model):
            probe = gt.part(Probe)

        assert np.array_equal(value(Top(), "probe.g"), [0.0, 0.0, -9.81])

    def test_a_part_above_overrides_it_wherever_it_is_declared(self):
        class Before(gt.Model):
            world = gt.part(World, g=MOON)
            probe = gt.part(Probe)

        class After(gt.Model):
            probe = gt.part(Probe)
            world = gt.part(World, g=MOON)

        class Added(Before.__mro__[1]):  # a model without a world of its own, and a subclass that adds one
            probe = gt.part(Probe)

        class Subclass(Added):
            surroundings = gt.part(World, g=MOON)

        for cls in (Before, After, Subclass):
            assert np.array_equal(value(cls(), "probe.g"), MOON), cls.__name__

    def test_the_nearest_one_counts(self):
        class Inside(gt.Model):
            probe = gt.part(Probe)
            world = gt.part(World, g=MOON)

        class Top(gt.Model):
            world = gt.part(World, g=[0.0, 0.0, -3.7])
            inside = gt.part(Inside)
            probe = gt.part(Probe)

        assert np.array_equal(value(Top(), "inside.probe.g"), MOON)
        assert np.array_equal(value(Top(), "probe.g"), [0.0, 0.0, -3.7])

    def test_a_redeclared_world_counts_as_what_it_is(self):
        class Tilted(World):
            pass

        class Place(gt.Model):
            pass

        class Top(gt.Model):
            probe = gt.part(Probe)
            place = gt.part(Place)

        assert np.array_equal(value(Top(place=Tilted(g=MOON)), "probe.g"), MOON)

    def test_weight_follows_it(self):
        class Anchor(gt.Model):
            frame = gt.port(PointFrame)

            def equations(self):
                yield self.frame.r == 0

        class Held(gt.Model):
            body = gt.part(PointMass, m=2.0)
            anchor = gt.part(Anchor)
            world = gt.part(World, g=MOON)

            def equations(self):
                yield gt.connect(self.body.frame, self.anchor.frame)

        # forces act on the component: the anchor is pulled down, the body held up
        assert np.array_equal(value(Held(), "anchor.frame.f"), [0.0, 0.0, -3.24])
        assert np.array_equal(value(Held(), "body.frame.f"), [0.0, 0.0, 3.24])


class TestImmutable:
    def test_no_assignment(self):
        gain = Gain(k=3.0)
        for change in (lambda: setattr(gain, "k", 4.0), lambda: setattr(gain, "new", 4.0)):
            with pytest.raises(gt.ModelError, match="models are immutable"):
                change()
        with pytest.raises(gt.ModelError, match="models are immutable"):
            del gain.new
        assert gain.k == 3.0

    def test_not_inside_equations_either(self):
        class Careless(Gain):
            def equations(self):
                self.y = 3.0
                yield self.y == 1

        with pytest.raises(gt.ModelError, match=r"'y' cannot be assigned.*\(lang/test_model\.py:\d+\)"):
            value(Careless(), "y")

    def test_with_leaves_the_old_model(self):
        old = Gain(k=3.0)
        new = old.with_(k=4.0)
        assert (old.k, new.k) == (3.0, 4.0)
        assert new is not old

    def test_arrays_given_are_copied(self):
        class Vector(gt.Model):
            a = gt.parameter(shape=2, unit="1")
            part = gt.part(Gain)
            y = gt.variable(2, unit="1")

            def equations(self):
                yield self.y == self.a

        mine = np.array([1.0, 2.0])
        nested = {"k": np.array(5.0)}
        model = Vector(a=mine, part=nested)
        mine[0] = 99.0
        nested["k"] = 99.0
        assert np.array_equal(value(model, "y"), [1.0, 2.0])
        assert value(model, "part.y") == 5.0
        with pytest.raises(ValueError, match="read-only"):
            model.a[0] = 99.0

    def test_two_models_of_one_class_share_nothing(self):
        a, b = Gain(k=1.0), Gain(k=2.0)
        assert value(a, "y") == 1.0
        assert value(b, "y") == 2.0
        assert value(a, "y") == 1.0


class TestRefusals:
    def test_missing_value(self):
        class Top(gt.Model):
            c = gt.parameter(unit="1")
            y = gt.variable(unit="1")

            def equations(self):
                yield self.y == self.c

        with pytest.raises(gt.ModelError, match=r"parameter 'c' of Top has no value.*\(lang/test_model\.py:\d+\)"):
            value(Top(), "y")

    @pytest.mark.parametrize(
        "make, sentence",
        [
            (lambda: Gain(kk=1.0), "Gain has no declaration 'kk'; did you mean 'k'?"),
            (lambda: Gain(zzz=1.0), "Gain has no declaration 'zzz'; it has k, y"),
            (lambda: Gain(k=[1.0, 2.0]), r"parameter 'k' has shape \(\); found a value of shape \(2,\)"),
            (lambda: Gain(k=np.inf), "parameter 'k' must be finite"),
            (lambda: Gain(k="three"), r"parameter 'k' takes a number; found 'three'"),
            (lambda: Gain(y=3.0), "'y' is a variable: its modifier must be a dictionary with keys from nominal, min"),
            (lambda: Gain(y=dict(begin=3.0)), "'y' is a variable: its modifier must be a dictionary"),
            (lambda: PointMass(frame=1.0), "'frame' of PointMass is a port and takes no modifier"),
            (lambda: PointMass(world=World()), "'world' of PointMass is an outer reference and takes no modifier"),
            (lambda: Gain().with_(kk=1.0), "Gain has no declaration 'kk'"),
        ],
    )
    def test_wrong_modifiers_quote_the_line_that_gives_them(self, make, sentence):
        with pytest.raises(gt.ModelError, match=sentence) as error:
            make()
        assert error.value.where.file == "lang/test_model.py"

    def test_wrong_modifier_of_a_part_quotes_the_part(self):
        class Top(gt.Model):
            gain = gt.part(Gain, kk=2.0)

        with pytest.raises(
            gt.ModelError, match=r"\(part 'gain'\) has no declaration 'kk'; did you mean 'k'\?"
        ) as error:
            value(Top(), "gain.y")
        assert error.value.where.file == "lang/test_model.py"

    def test_a_modifier_of_someone_elses_declaration(self):
        class Other(gt.Model):
            c = gt.parameter(1.0, unit="1")

        class Top(gt.Model):
            gain = gt.part(Gain, k=Other.c)

        with pytest.raises(gt.ModelError, match="refers to 'c', which Top does not declare"):
            value(Top(), "gain.y")

    def test_units_of_bound_parameters(self):
        class Top(gt.Model):
            c = gt.parameter(1.0, unit="m")
            gain = gt.part(Gain, k=c)

        with pytest.raises(gt.ModelError, match=r"units differ: parameter 'gain\.k' is in 1, its expression is in m"):
            value(Top(), "gain.y")

    @pytest.mark.parametrize("c", [-2.0, 0.0])
    def test_signs_hold_through_bindings(self, c):
        class Positive(gt.Model):
            p = gt.parameter(unit="1", positive=True)
            y = gt.variable(unit="1")

            def equations(self):
                yield self.y == 1 / self.p

        class Top(gt.Model):
            c = gt.parameter(unit="1")
            part = gt.part(Positive, p=c)

        class Half(Top):
            part = gt.part(Positive, p=lambda self: self.c / 2)

        for cls in (Top, Half):
            with pytest.raises(gt.ModelError, match=r"parameter 'part\.p' is declared positive; found"):
                value(cls(c=c), "part.y")

    @pytest.mark.parametrize(
        "body, sentence",
        [
            (dict(equations=gt.variable(unit="m")), "'equations' is an attribute of every model"),
            (dict(_x=gt.variable(unit="m")), "must not start with an underscore"),
        ],
    )
    def test_names(self, body, sentence):
        with pytest.raises(gt.ModelError, match=sentence):
            type("Odd", (gt.Model,), body)

    def test_units_with_a_scale_are_refused_at_the_declaration(self):
        with pytest.raises(gt.ModelError, match=r"unit 'mm' has a scale.*\(lang/test_model\.py:\d+\)"):
            gt.variable(unit="mm")

    def test_nominal_is_a_magnitude(self):
        with pytest.raises(gt.ModelError, match="nominal is a magnitude and must be positive; found -1"):
            gt.variable(unit="m", nominal=-1.0)

    def test_min_above_max(self):
        with pytest.raises(gt.ModelError, match=r"'y' has min 2 above max 1"):
            value(Gain(y=dict(min=2.0, max=1.0)), "y")
