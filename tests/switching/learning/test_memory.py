"""What no machine could hold is refused before memory is asked for, with the number that would fit."""

from __future__ import annotations

import re
import tracemalloc

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel
from fuzzykf.errors import ParameterError
from fuzzykf.switching.learning import memory
from fuzzykf.switching.learning.data import gather
from fuzzykf.switching.learning.memory import installed_memory, memory_of_fuzzy, memory_of_hard

QUICK = {"max_iter": 1, "n_starts": 1, "progress": False}


def series(n=200, m=1, q=1):
    rng = np.random.default_rng(0)
    return rng.normal(size=(n, m)), rng.normal(size=(n, q))


def regimes(K, n=200):
    return np.random.default_rng(1).integers(0, K, n)


@pytest.mark.parametrize("form", ["regression", "covariance", "auto"])
@pytest.mark.parametrize("name", ["n_regimes", "n_switches"])
@pytest.mark.parametrize("known", [False, True])
def test_more_regimes_than_memory_holds_are_refused_with_numbers(form, name, known) -> None:
    x, y = series()
    r = regimes(500) if known else None
    with pytest.raises(ParameterError, match=r"^n_switches, n_regimes: got \d+, for which") as error:
        CGOMSModel.fit(x, y, r, form=form, **QUICK, **{name: 500 if form != "covariance" else 50_000})
    found = re.search(
        r"takes about [\d.,]+e?\+?\d* ([PTGE]iB) of memory, .*has (.*); expected at most (\d+)",
        str(error.value),
    )
    assert found
    most = int(found[3])
    needed = [
        memory_of_hard(k, gather(x, y, r), "covariance" if form == "covariance" else "regression")
        for k in (most, most + 1)
    ]
    assert needed[0] <= installed_memory() < needed[1]


def test_more_nodes_than_memory_holds_are_refused(monkeypatch) -> None:
    monkeypatch.setattr(memory, "installed_memory", lambda: 1 << 24)
    with pytest.raises(
        ParameterError, match=r"^n_nodes: got 900, .* and this machine has 16 MiB; expected at most \d\d$"
    ):
        CGOFMSModel.fit(*series(), n_nodes=900, **QUICK)


@pytest.mark.parametrize("kind", ["hidden", "known", "fuzzy"])
def test_what_is_told_is_about_what_it_takes(kind) -> None:
    x, y = series(3000 if kind == "fuzzy" else 200)
    r = regimes(8) if kind == "known" else None
    options = {"form": "regression", "max_iter": 1, "n_starts": 1, "progress": False}
    tracemalloc.start()
    try:
        if kind == "fuzzy":
            CGOFMSModel.fit(x, y, n_nodes=8, law="free", **options)
        else:
            CGOMSModel.fit(x, y, r, n_regimes=8, **options)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    data = gather(x, y, r)
    told = (
        memory_of_fuzzy(10, 2, data, "regression")
        if kind == "fuzzy"
        else memory_of_hard(8, data, "regression")
    )
    assert 0.4 * peak < told < 2.0 * peak


def test_a_machine_that_does_not_tell_is_a_usual_one(monkeypatch) -> None:
    monkeypatch.delattr(memory.os, "sysconf", raising=False)
    assert installed_memory() == memory.USUAL
