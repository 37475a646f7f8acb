"""Errors can be caught as what users expect them to be."""

from __future__ import annotations

import pytest

from fuzzykf import FuzzykfError, errors


def classes():
    return [getattr(errors, name) for name in errors.__all__ if issubclass(getattr(errors, name), Exception)]


@pytest.mark.parametrize("error", [e for e in classes() if not issubclass(e, Warning)])
def test_every_error_is_one_of_the_package(error):
    assert issubclass(error, FuzzykfError)
    # its own words, which say when it is raised
    assert error.__dict__["__doc__"].split("Examples")[0].strip().endswith(".")
    with pytest.raises(FuzzykfError) as caught:
        raise error("what is wrong")
    assert str(caught.value) == "what is wrong"


def test_every_error_and_warning_is_told_of():
    defined = {
        name
        for name, value in vars(errors).items()
        if isinstance(value, type) and issubclass(value, Exception) and value.__module__ == errors.__name__
    }
    assert set(errors.__all__) == defined
    assert {e.__name__ for e in classes() if issubclass(e, Warning)} == {
        "ClosenessWarning",
        "HindsightWarning",
        "StepsWarning",
        "SupportWarning",
    }


@pytest.mark.parametrize(
    ("error", "builtin"),
    [
        (errors.ParameterError, ValueError),
        (errors.ShapeError, ValueError),
        (errors.NotPositiveDefiniteError, ValueError),
        (errors.EmptyIntersectionError, ValueError),
        (errors.FileFormatError, ValueError),
        (errors.SequenceError, RuntimeError),
        (errors.QuadratureError, ArithmeticError),
        (errors.MissingDependencyError, ImportError),
    ],
)
def test_code_that_expects_a_builtin_error_goes_on_working(error, builtin):
    with pytest.raises(builtin):
        raise error("message")
    with pytest.raises(FuzzykfError, match="message"):
        raise error("message")


def test_shapes_and_definiteness_are_parameters():
    assert issubclass(errors.ShapeError, errors.ParameterError)
    assert issubclass(errors.NotPositiveDefiniteError, errors.ParameterError)
