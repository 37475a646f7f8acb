"""A file that is not as it was written is refused in words, quickly, or is a usable object.

The environment variable FUZZYKF_MUTATIONS sets how many are tried; 1,500 before a release.
"""

from __future__ import annotations

import importlib.util
import json
import os
import time
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, io
from fuzzykf.errors import FileFormatError, FuzzykfError

MUTATIONS = int(os.environ.get("FUZZYKF_MUTATIONS", "300"))

# the harness in the next folder, which is no package, uses them too
_spec = importlib.util.spec_from_file_location(
    "mutations", Path(__file__).parent / "torture" / "mutations.py"
)
mutations = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(mutations)
changed, reader, use = mutations.changed, mutations.reader, mutations.use

THINGS = mutations.things()


@pytest.mark.parametrize("name", THINGS)
def test_damaged_files_are_refused_or_of_use(name, tmp_path):
    thing, path = THINGS[name], tmp_path / "file.json"
    thing.save(path)
    text = path.read_text("utf-8")
    rng = np.random.default_rng([len(name), *name.encode()])
    read = reader(thing)
    for k in range(-(-MUTATIONS // len(THINGS))):
        content = changed(text, k, rng)
        path.write_bytes(content)
        start = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            found = None
            with suppress(FileFormatError):
                found = read(path)
            assert time.process_time() - start < 1.0, k
        if found is not None:
            with suppress(FuzzykfError), np.errstate(all="ignore"):  # numbers may be too large to go on with
                use(found)


# --------------------------------------------------------------------------- limits, one by one


def forget_law_after_many(document):
    del document["state"]["law"]
    document["state"]["n"] = 10**9


def saved(thing, path, change):
    thing.save(path)
    document = json.loads(path.read_text("utf-8"))
    change(document)
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("fmc1", lambda d: d.update(version=True), "has schema version True"),
        ("fmc1", lambda d: d.update(version=1.0), "has schema version 1.0"),
        ("fmc1", lambda d: d["form"].update(dim_x=10**400), "a whole number has 401 digits"),
        ("fmc1", lambda d: d["form"].update(dim_x=2**63), "a whole number has 19 digits"),
        ("fmc1", lambda d: d["form"].update(means="x" * 10**6), "damaged"),
        ("complete", lambda d: d["state"].update(n=2.7), "n: got 2.7, expected a whole number"),
        ("complete", lambda d: d["state"].update(n=True), "n: got True, expected a whole number"),
        ("complete", lambda d: d["state"].update(predicted=1), "predicted: got 1, expected true or false"),
        ("complete", lambda d: d["state"].update(log_likelihood="3"), "expected a number, got '3'"),
        ("complete", lambda d: d["state"].update(z=[True]), "expected numbers, got bool"),
        ("complete", lambda d: d["options"].update(n_nodes=100_000), "n_nodes: got 100000, but the state is"),
        ("complete", lambda d: d["options"].update(n_nodes=3.0), "n_nodes: got 3.0, expected a whole number"),
        ("fresh", lambda d: d["options"].update(n_nodes=100_000), "n_nodes: got 100000, expected at most"),
        ("fresh", lambda d: d["options"].update(n_nodes=True), "n_nodes: got True"),
        ("steady", lambda d: d["form"].update(order=10_000), "order: got 10000, expected at most 64"),
        ("moving filter", lambda d: d["state"].pop("law"), None),
        ("moving filter", forget_law_after_many, "law of a time-varying"),
        ("moving filter", lambda d: d["state"]["law"].update(factor=[]), "expected an array of 3 dimensions"),
        ("moving filter", lambda d: d["state"]["law"].update(factor=[[[1.0]]]), "the law after 68 obs"),
        ("moving filter", lambda d: d["state"]["law"].update(log_p=[0.0, 0.0]), r"law after 68 .* is none"),
    ],
)  # fmt: skip
def test_what_a_file_may_ask_for_has_limits(name, change, message, tmp_path):
    thing = THINGS[name]
    path = saved(thing, tmp_path / "file.json", change)
    start = time.perf_counter()
    if message is None:
        type(thing).load(path)
    else:
        with pytest.raises(FileFormatError, match=message) as raised:
            type(thing).load(path)
        assert len(str(raised.value)) < 1000
    assert time.perf_counter() - start < 1.0


@pytest.mark.parametrize("mark", ["[", '{"a":'])
@pytest.mark.parametrize("depth", [40, 900, 100_000, 5_000_000])
def test_nesting_has_a_limit(mark, depth, tmp_path):
    path = tmp_path / "file.json"
    path.write_text(mark * depth)
    start = time.perf_counter()
    with pytest.raises(FileFormatError, match="nested deeper than 32"):
        CGOMSModel.load(path)
    assert time.perf_counter() - start < 1.0


def test_size_has_a_limit_that_can_be_raised(tmp_path, monkeypatch):
    path = tmp_path / "file.json"
    THINGS["fmc1"].save(path)
    size = path.stat().st_size
    for read in (CGOFMSModel.load, io.load_model):
        with pytest.raises(FileFormatError, match=r"holds more than 100 bytes"):
            read(path, max_bytes=100)
        read(path, max_bytes=size)
    monkeypatch.setenv("FUZZYKF_MAX_BYTES", "100")
    with pytest.raises(FileFormatError, match=r"holds more than 100 bytes"):
        CGOFMSModel.load(path)
    CGOFMSModel.load(path, max_bytes=size)


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no endless device")
def test_an_endless_device_is_no_model():
    start = time.perf_counter()
    with pytest.raises(FileFormatError, match="/dev/zero: holds more than 33,554,432 bytes"):
        CGOMSModel.load("/dev/zero")
    assert time.perf_counter() - start < 1.0


def test_a_time_varying_filter_is_loaded_without_its_past(tmp_path, monkeypatch):
    path, f = tmp_path / "file.json", CGOMSMFilter(THINGS["moving"])
    f.filter(np.random.default_rng(1).normal(size=300))
    f.save(path)
    from fuzzykf.switching.state_space.converted import ConvertedSystem

    steps = []
    real = ConvertedSystem._next_law
    monkeypatch.setattr(
        ConvertedSystem, "_next_law", lambda self, n, law: steps.append(n) or real(self, n, law)
    )
    g = CGOMSMFilter.load(path)
    assert len(steps) < 10  # those that are proved
    for z in (0.3, -1.0, np.nan, 2.0):
        np.testing.assert_array_equal(f.step(z), g.step(z))
        assert f.log_likelihood == g.log_likelihood
        np.testing.assert_array_equal(f.P_prior, g.P_prior)


@pytest.mark.parametrize("n", [2, 4])
def test_a_number_of_observations_that_its_windows_contradict_is_refused(n, tmp_path):
    model = CGOMSModel.from_cglssm(
        [[0.9, 0.1], [0.2, 0.8]],
        [[[0.9]], [[0.5]]],
        [[[1.0]], [[0.7]]],
        [[[0.4]], [[1.0]]],
        [[[0.5]], [[0.8]]],
        order=3,
        mode="time_varying",
    )
    f, path = CGOMSMFilter(model), tmp_path / "filter.json"
    for z in (0.1, 0.2, 0.3)[: 3 if n == 2 else 2]:
        f.step(z)
    f.save(path)
    document = json.loads(path.read_text("utf-8"))
    document["state"]["n"] = n
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(FileFormatError, match="does not fit the model"):
        CGOMSMFilter.load(path)
