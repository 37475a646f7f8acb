"""A file that is not as it was written is refused in words, quickly, or is a usable object.

The environment variable FUZZYKF_MUTATIONS sets how many are tried; 1,500 before a release.
"""

from __future__ import annotations

import json
import os
import time
import warnings
from contextlib import suppress

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FuzzyMarkovLaw, OFSRFilter, io
from fuzzykf.errors import FileFormatError, FuzzykfError
from fuzzykf.switching import CGLSSM
from fuzzykf.switching.laws.cells import CellLaw

MUTATIONS = int(os.environ.get("FUZZYKF_MUTATIONS", "300"))

LINEAR = {
    "transition": [[0.9, 0.1], [0.2, 0.8]],
    "A": [[[0.9]], [[0.5]]],
    "B": [[[1.0]], [[1.0]]],
    "C": [[[0.3]], [[1.0]]],
    "D": [[[0.5]], [[0.5]]],
}


def covariance_model(law):
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    return CGOFMSModel(law, [[0.0, 3.0], [0.0, 0.0]], np.broadcast_to(pair, (2, 2, 4, 4)), 1)


def regressions(K):
    one = np.full((K, K, 1, 1), 0.5)
    parts = {
        "Ayy": one,
        "Ny": one[..., 0],
        "Qyy": one,
        "Axx": one,
        "H": one,
        "G": one,
        "c": one[..., 0],
        "C": one,
    }
    return parts | {"means": np.zeros((K, 2)), "covariances": np.broadcast_to(np.eye(2), (K, 2, 2))}


def things():
    """Return one of each kind of thing that can be saved, by name."""
    rng = np.random.default_rng(0)
    fmc1, fmc2 = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2)
    fuzzy, banded = covariance_model(fmc1), covariance_model(fmc2)
    free = covariance_model(CellLaw(rng.random((5, 5))))
    hard = CGOMSModel.from_regressions([[0.9, 0.1], [0.2, 0.8]], **regressions(2))
    steady = CGOMSModel.from_cglssm(**LINEAR, order=2)
    moving = CGOMSModel.from_cglssm(**LINEAR, mode="time_varying", initial_probability=[1.0, 0.0])
    found = {
        "fmc1": fuzzy,
        "fmc2": banded,
        "free": free,
        "regressions": CGOFMSModel.from_regressions(fmc1, **regressions(2)),
        "hard": fuzzy.harden(),
        "hard regressions": hard,
        "steady": steady,
        "moving": moving,
        "CGLSSM": CGLSSM(**LINEAR),
        "fresh": OFSRFilter(fuzzy, 3),
    }
    filters = {
        "complete": OFSRFilter(fuzzy, 3, "midpoint"),
        "signed": OFSRFilter(banded, 12, "product"),
        "hard filter": CGOMSMFilter(hard),
        "steady filter": CGOMSMFilter(steady),
        "moving filter": CGOMSMFilter(moving),
    }
    for name, f in filters.items():
        f.filter(rng.normal(size=70 if name == "moving filter" else 5))
    gap = CGOMSMFilter(steady)
    gap.filter([0.1, 0.2, np.nan])
    return found | filters | {"gap": gap}


THINGS = things()

VALUES = (
    None, True, False, 0, 1, -1, 2, 2.7, 7, 10**5, 10**400, -(2**63), 1e308, -1e308, 1e-320,
    "", "text", "1.0", [], [[]], {}, [1.0], [None], {"kind": "fmc1"}, [[1.0, 2.0], [3.0]],
)  # fmt: skip


PIECES = (b"0", b"9", b"-", b"e", b".", b",", b"NaN", b"1e999", b'"')


def places(value, at=()):
    """Yield the way to every part of a document."""
    for key, part in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*at, key)
        if isinstance(part, dict | list):
            yield from places(part, (*at, key))


def at(document, way):
    for key in way:
        document = document[key]
    return document


def change_values(text, rng):
    document = json.loads(text)
    for _ in range(int(rng.integers(1, 4))):
        ways = list(places(document))
        *above, key = ways[rng.integers(len(ways))]
        parent, what = at(document, above), rng.integers(6)
        if what == 0:
            del parent[key]
        elif what == 1:
            parent[key] = json.loads(json.dumps(at(document, ways[rng.integers(len(ways))])))
        elif what == 2 and isinstance(parent[key], int | float):
            parent[key] = parent[key] * float(rng.choice([-1.0, 0.0, 1e-9, 1 + 1e-12, 10.0, 1e9]))
        elif what == 3:
            parent[key] = [parent[key]]
        elif what == 4 and isinstance(parent[key], list) and parent[key]:
            parent[key] = parent[key] + parent[key][:1]
        else:
            parent[key] = VALUES[rng.integers(len(VALUES))]
        if not document:
            break
    return json.dumps(document).encode()


def change_bytes(text, rng):
    content = bytearray(text.encode())
    for _ in range(int(rng.integers(1, 4))):
        start = int(rng.integers(len(content)))
        stop, what = start + int(rng.integers(1, 40)), rng.integers(6)
        if what == 0:
            content[start] ^= 1 << int(rng.integers(8))
        elif what == 1:
            del content[start:stop]
        elif what == 2:
            content[start:start] = content[start:stop]
        elif what == 3:
            content[start:start] = bytes(
                rng.choice([b"0", b"9", b"-", b"e", b".", b",", b"NaN", b"1e999", b'"'])
            )
        elif what == 4:
            content[start:start] = (b"[" if rng.integers(2) else b'{"a":') * int(rng.integers(1, 3000))
        else:
            del content[start:]
        if not content:
            break
    return bytes(content)


def use(thing):
    """Do with it what it is for."""
    if isinstance(thing, CGLSSM):
        thing.simulate(3, np.random.default_rng(0))
        return
    f = thing.filter() if hasattr(thing, "simulate") else thing
    f.step(0.3 if f.dim_z == 1 else np.zeros(f.dim_z))
    f.filter(np.zeros((3, f.dim_z)))


@pytest.mark.parametrize("name", THINGS)
def test_damaged_files_are_refused_or_of_use(name, tmp_path):
    thing, path = THINGS[name], tmp_path / "file.json"
    thing.save(path)
    text = path.read_text("utf-8")
    rng = np.random.default_rng([len(name), *name.encode()])
    read = io.load_model if type(thing).__name__ in io.MODELS else io.load_filter
    for k in range(-(-MUTATIONS // len(THINGS))):
        content = (change_values if k % 2 else change_bytes)(text, rng)
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
    f.filter(np.random.default_rng(1).normal(size=1500))
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
