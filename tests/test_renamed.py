"""Former Python names are accepted with a warning that names the present one."""

import inspect
import warnings
from dataclasses import dataclass

import pytest

import fenics_ehd as ehd
from fenics_ehd.base.lazy import lazily
from fenics_ehd.base.renamed import renamed_arguments, renamed_attributes


@renamed_attributes(lift="minus_gravity", doubled="twice", UNIT="DIMENSION")
@renamed_arguments(lift="minus_gravity")
@dataclass
class Body:
    """Class with a renamed field, a renamed method and a renamed constant."""

    minus_gravity: float
    mass: float = 1.0

    DIMENSION = "m/s^2"

    def twice(self):
        """Twice the acceleration."""
        return 2 * self.minus_gravity


@renamed_arguments(place="binding", many="count")
def bind(binding, count=1):
    """Function with two renamed arguments."""
    return binding, count


def test_former_attributes_are_those_of_the_present_name():
    body = Body(9.81)
    with pytest.warns(DeprecationWarning, match=r"Body\.lift is now Body\.minus_gravity") as notes:
        assert body.lift == 9.81
    assert notes[0].filename == __file__, "the warning names the line that uses the former name"
    assert "removed in 0.5" in str(notes[0].message)
    with pytest.warns(DeprecationWarning, match=r"Body\.lift"):
        body.lift = 1.62
    assert body.minus_gravity == 1.62
    with pytest.warns(DeprecationWarning, match=r"Body\.doubled is now Body\.twice"):
        assert body.doubled() == 3.24
    with pytest.warns(DeprecationWarning, match=r"Body\.UNIT is now Body\.DIMENSION"):
        assert Body.UNIT == "m/s^2"


def test_former_arguments_are_accepted_by_functions_and_constructors():
    with pytest.warns(DeprecationWarning, match=r"bind\(place=\) is now bind\(binding=\)") as notes:
        assert bind(place="bore", count=2) == ("bore", 2)
    assert notes[0].filename == __file__
    with pytest.warns(DeprecationWarning, match="former name") as notes:
        assert bind(place="bore", many=3) == ("bore", 3)
    assert len(notes) == 2
    with pytest.warns(DeprecationWarning, match=r"Body\(lift=\) is now Body\(minus_gravity=\)"):
        assert Body(lift=3.7, mass=2.0) == Body(3.7, 2.0)
    with pytest.raises(TypeError, match="binding and its former name place"):
        bind(binding="bore", place="hole")


def test_a_body_may_be_written_with_the_former_parameter():
    with pytest.warns(DeprecationWarning, match=r"Old\.balance\(lift=\) is now") as notes:

        class Old(ehd.MasslessBody):
            def balance(self, coordinates, rates, accelerations, *, lift):
                return lift

    assert notes[0].filename == __file__
    assert Old({}).balance(0, 0, 0, minus_gravity=9.81) == 9.81
    assert Old({}).balance(0, 0, 0, lift=9.81) == 9.81


def test_present_names_do_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Body(minus_gravity=9.81).twice() == 2 * 9.81
        assert bind(binding="bore") == ("bore", 1)
    assert list(inspect.signature(bind).parameters) == ["binding", "count"]
    assert list(inspect.signature(Body).parameters) == ["minus_gravity", "mass"]


def test_a_package_has_its_former_names():
    names = {"base.plane": ("rotation",)}
    look_up = lazily("fenics_ehd", names, former={"turn": "rotation"})

    def use(name):
        """Access of an attribute by the interpreter, one call above the table."""
        return look_up(name)

    with pytest.warns(DeprecationWarning, match=r"fenics_ehd\.turn is now fenics_ehd\.rotation"):
        assert use("turn") is use("rotation")
    with pytest.raises(AttributeError, match="no attribute 'twist'"):
        use("twist")
