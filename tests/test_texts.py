"""Names that others have chosen stay names."""

from __future__ import annotations

import pytest

from fuzzykf.texts import counted, listed, literal, printable, uncomputed


def test_few_of_many_names_are_listed():
    assert listed([]) == ""
    assert listed(["a"]) == "a"
    names = {f"c{k}": None for k in range(100_000)}
    assert listed(names).endswith("c19 and 99,980 more")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("load (GW), 90 %", "load (GW), 90 %"),
        ("Größe µ 温度", "Größe µ 温度"),
        ("a\x1b[31mb", r"a\x1b[31mb"),
        ("a\r\nb\tc\x07", r"a\r\nb\tc\x07"),
        ("\x9b2J", r"\x9b2J"),
        ("abc\u202edef\u2028", r"abc\u202edef\u2028"),
        ("\ud800", r"\ud800"),
        ("no\u00a0break", "no\u00a0break"),
    ],
)
def test_what_a_terminal_would_obey_is_shown(text, shown):
    assert printable(text) == shown


@pytest.mark.parametrize("name", ["$x^2$", "$a$ and $", r"$\frac$", "a$", "$", r"a\$b", "$$"])
def test_matplotlib_draws_names_as_they_are_written(name):
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    figure = Figure()
    text = figure.text(0, 0, literal(name))
    figure.canvas.draw()
    assert text._preprocess_math(text.get_text()) == (name, False)


@pytest.mark.parametrize(
    "cell", ["=1+1", "+A1", "-A1", "@SUM(A1)", "\t=1", "\r=1", " =1", "-1+1", "=", "\uff1d1"]
)
def test_formulas_get_an_apostrophe(cell):
    assert uncomputed(cell) == f"'{cell}"


@pytest.mark.parametrize(
    "cell", ["", "a", "-1", "+1.5", "-1e-5", "-,5", "2014-01-01T00:00+10:00", "a=b", "'=1"]
)
def test_other_cells_stay_as_they_are(cell):
    assert uncomputed(cell) == cell


@pytest.mark.parametrize(("n", "text"), [(0, "0 rows"), (1, "1 row"), (2, "2 rows"), (12345, "12,345 rows")])
def test_one_is_counted_in_the_singular(n, text):
    assert counted(n, "row") == text
