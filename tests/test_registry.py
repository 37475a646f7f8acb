"""Lists of classes by name: imported when asked for, not before."""

from __future__ import annotations

import pytest

from fuzzykf.registry import Registry, either


def test_a_class_is_imported_when_it_is_asked_for():
    registry = Registry({"fraction": "fractions:Fraction", "absent": "no_such_module:Class"})
    assert list(registry) == ["fraction", "absent"]
    assert len(registry) == 2
    assert "absent" in registry
    assert "other" not in registry
    assert registry["fraction"](1, 2) == 0.5
    with pytest.raises(ModuleNotFoundError):
        registry["absent"]
    with pytest.raises(KeyError, match="other"):
        registry["other"]


def test_choices():
    assert either(["a"]) == "'a'"
    assert either(["a", "b"]) == "'a' or 'b'"
    assert either(("a", "b", "c")) == "'a', 'b' or 'c'"
