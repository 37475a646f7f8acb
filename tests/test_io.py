"""Files: bit for bit, whole or not at all, and a message for each kind of damage."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FadeLaw, FuzzyMarkovLaw, OFSRFilter, io
from fuzzykf.errors import FileFormatError, ParameterError

DATA = Path(__file__).parent / "data"
LAWS = [FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), FuzzyMarkovLaw.fmc2(0.1, 0.8 / 1.71, 0.3)]
FADES = FadeLaw(2, {(0, 1): (1 / 30, 9.5), (1, 0): (0.07, 20 / 3)}, jumps={(1, 0): 0.01}, turn_back=0.1)


def regressions(K, seed=0):
    rng = np.random.default_rng(seed)

    def covariances(*shape):
        root = 0.4 * rng.normal(size=shape) + np.eye(shape[-1])
        return root @ np.swapaxes(root, -1, -2)

    return {
        "Ayy": rng.normal(size=(K, K, 1, 1)) / 3,
        "Ny": rng.normal(size=(K, K, 1)),
        "Qyy": covariances(K, K, 1, 1),
        "Axx": rng.normal(size=(K, K, 2, 2)) / 3,
        "H": rng.normal(size=(K, K, 2, 1)),
        "G": rng.normal(size=(K, K, 2, 1)),
        "c": rng.normal(size=(K, K, 2)),
        "C": covariances(K, K, 2, 2),
        "means": rng.normal(size=(K, 3)),
        "covariances": covariances(K, 3, 3),
    }


def models(fuzzy, hard):
    form = fuzzy.form
    return {
        "fmc1 covariance": fuzzy,
        "fmc2 covariance": CGOFMSModel(LAWS[1], form.means, form.covariances, 1),
        "check": CGOFMSModel(LAWS[0], form.means, form.covariances, 1, constraint="check"),
        "transition": CGOFMSModel(LAWS[0], form.means, form.covariances, 1, interpolation="transition"),
        "regression": CGOFMSModel.from_regressions(LAWS[0], **regressions(2)),
        "fades": CGOFMSModel(FADES, form.means, form.covariances, 1),
        "hard transition": hard,
        "hard covariance": fuzzy.harden(),
        "hard regression": CGOMSModel.from_regressions(
            [[0.5, 0.5, 0], [0.1, 0.2, 0.7], [1 / 3, 1 / 3, 1 / 3]], **regressions(3), initial=[0.1, 0.2, 0.7]
        ),
    }


NAMES = ("fmc1 covariance", "fmc2 covariance", "check", "transition", "regression", "fades",
         "hard transition", "hard covariance", "hard regression")  # fmt: skip


@pytest.fixture(params=NAMES)
def model(request, fuzzy_model, hard_model):
    return models(fuzzy_model, hard_model)[request.param]


def make_filter(model):
    if not isinstance(model, CGOFMSModel):
        return CGOMSMFilter(model)
    return OFSRFilter(model, 4, "cell" if model.law.kind == "fade" else "midpoint")


# --------------------------------------------------------------------------- models


def test_models_come_back_bit_for_bit(model, tmp_path):
    path = tmp_path / "model.json"
    model.save(path)
    again = type(model).load(path)
    assert type(again) is type(model)
    assert again.form.kind == model.form.kind
    assert repr(again) == repr(model)
    y = model.simulate(20, np.random.default_rng(0)).y
    a, b = make_filter(model).filter(y), make_filter(again).filter(y)
    for name in ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    # what is saved again is the same file
    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()


def test_models_load_without_naming_the_class(fuzzy_model, hard_model, tmp_path):
    for model in (fuzzy_model, hard_model):
        model.save(tmp_path / "model.json")
        assert type(io.load_model(tmp_path / "model.json")) is type(model)


def test_documents_name_themselves(fuzzy_model, tmp_path):
    fuzzy_model.save(tmp_path / "model.json")
    document = json.loads((tmp_path / "model.json").read_text())
    assert {k: document[k] for k in ("format", "version", "kind")} == {
        "format": "fuzzykf",
        "version": 1,
        "kind": "CGOFMSModel",
    }


# --------------------------------------------------------------------------- filters

ATTRIBUTES = ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood", "y", "S", "z")


@pytest.mark.parametrize("n", [0, 1, 2, 9])
@pytest.mark.parametrize("predicted", [False, True])
def test_filters_resume_bit_for_bit(model, n, predicted, tmp_path):
    path = tmp_path / "filter.json"
    y = model.simulate(15, np.random.default_rng(0)).y
    f = make_filter(model)
    for z in y[:n]:
        f.step(z)
    if predicted:
        f.predict()
    f.save(path)
    g = type(f).load(path)
    for _ in range(2):
        for name in ATTRIBUTES:
            np.testing.assert_array_equal(getattr(f, name), getattr(g, name), err_msg=name)
        if not predicted:
            for z in y[n:]:
                np.testing.assert_array_equal(f.step(z), g.step(z))
        else:
            f.update(y[n])
            g.update(y[n])
            predicted = False
    g.reset()
    np.testing.assert_array_equal(g.x, make_filter(model).x)


@pytest.mark.parametrize("gap", [[0, 1], [3, 4], [8]])
def test_filters_resume_in_a_gap(model, gap, tmp_path):
    y = model.simulate(15, np.random.default_rng(0)).y
    y[gap] = np.nan
    f = make_filter(model)
    for z in y[: gap[-1] + 1]:
        f.step(z)
    f.save(tmp_path / "filter.json")
    g = type(f).load(tmp_path / "filter.json")
    for z in y[gap[-1] + 1 :]:
        np.testing.assert_array_equal(f.step(z), g.step(z))
        assert f.log_likelihood == g.log_likelihood


def test_a_signed_chain_resumes(fuzzy_model, tmp_path):
    model = CGOFMSModel(
        FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2), fuzzy_model.form.means, fuzzy_model.form.covariances, 1
    )
    f = OFSRFilter(model, 20, "product")
    assert f._system.chain.is_signed
    y = model.simulate(12, np.random.default_rng(1)).y
    for z in y[:6]:
        f.step(z)
    f.save(tmp_path / "filter.json")
    g = OFSRFilter.load(tmp_path / "filter.json")
    assert (g.n_nodes, g.rule) == (20, "product")
    for z in y[6:]:
        np.testing.assert_array_equal(f.step(z), g.step(z))


def test_extreme_numbers_survive(fuzzy_model, tmp_path):
    # subnormal probabilities and the stand-in for log 0 are written in full
    f = OFSRFilter(CGOFMSModel(FuzzyMarkovLaw.fmc1(0.3, 0.0, 0.0), fuzzy_model.form.means,
                               fuzzy_model.form.covariances, 1), 3)  # fmt: skip
    for z in (1e6, -1e6, 1 / 3):
        f.step(z)
    f.save(tmp_path / "filter.json")
    g = OFSRFilter.load(tmp_path / "filter.json")
    np.testing.assert_array_equal(f._mixture.table, g._mixture.table)


# --------------------------------------------------------------------------- damage


def save(model, tmp_path):
    path = tmp_path / "model.json"
    model.save(path)
    return path, json.loads(path.read_text())


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "damaged, or not a JSON file"),
        (b"{", "damaged, or not a JSON file"),
        (b"\xff\xfe\x00", "damaged, or not a JSON file"),
        (b"[1, 2]", "not a file written by fuzzykf"),
        (b"3", "not a file written by fuzzykf"),
        (b"{}", "not a file written by fuzzykf"),
        (b'{"format": "other", "version": 1}', "not a file written by fuzzykf"),
        (b'{"format": "fuzzykf"}', "has schema version None; this version of fuzzykf reads 1"),
        (b'{"format": "fuzzykf", "version": 2}', "has schema version 2; this version of fuzzykf reads 1"),
        (b'{"format": "fuzzykf", "version": 1}', "holds a None, expected CGOFMSModel"),
        (
            b'{"format": "fuzzykf", "version": 1, "kind": "CGOMSModel"}',
            "holds a 'CGOMSModel', expected CGOFMS",
        ),
        (b'{"format": "fuzzykf", "version": 1, "kind": "CGOFMSModel"}', "damaged: KeyError: 'form'"),
        (b'{"format": "fuzzykf", "version": 1, "kind": "CGOFMSModel", "form": 3}', "damaged: TypeError"),
        (b'{"format": "fuzzykf", "version": NaN}', "damaged, or not a JSON file: NaN is no number"),
    ],
)
def test_files_that_are_no_model(content, message, tmp_path):
    path = tmp_path / "model.json"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=rf"model\.json: {message}"):
        CGOFMSModel.load(path)


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["form"].pop("means"),
        lambda d: d["form"].update(kind="unknown"),
        lambda d: d["form"].update(surplus=1),
        lambda d: d["form"].update(means="text"),
        lambda d: d["form"].update(means=[[1.0, 2.0]]),
        lambda d: d["form"].update(means=[[1.0], [1.0, 2.0]]),
        lambda d: d["form"].update(dim_x=7),
        lambda d: d["form"].update(dim_x="one"),
        lambda d: d["form"]["covariances"][0][0][0].__setitem__(1, 99.0),
        lambda d: d["law"].update(alpha=0.9),
        lambda d: d["law"].update(kind="fmc9"),
        lambda d: d["law"].pop("eta"),
        lambda d: d.update(law=None),
        lambda d: d.pop("law"),
    ],
)
def test_damaged_models(fuzzy_model, change, tmp_path):
    path, document = save(fuzzy_model, tmp_path)
    change(document)
    path.write_text(json.dumps(document))
    with pytest.raises(FileFormatError, match=r"model\.json: damaged: "):
        CGOFMSModel.load(path)


@pytest.mark.parametrize(
    "change",
    [
        lambda law: law.update(n_classes=3),
        lambda law: law.update(n_classes=10**9),
        lambda law: law.pop("jumps"),
        lambda law: law.update(turn_back="often"),
        lambda law: law["fades"].pop(),
        lambda law: law["fades"][0].pop(),
        lambda law: law["fades"][0].__setitem__(0, 0.5),
        lambda law: law["fades"][0].__setitem__(2, 1.5),
        lambda law: law["jumps"][0].__setitem__(2, None),
    ],
)
def test_damaged_fades(fuzzy_model, hard_model, change, tmp_path):
    path, document = save(models(fuzzy_model, hard_model)["fades"], tmp_path)
    change(document["law"])
    path.write_text(json.dumps(document))
    with pytest.raises(FileFormatError, match=r"model\.json: damaged: "):
        CGOFMSModel.load(path)


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s.pop("belief"),
        lambda s: s.pop("z"),
        lambda s: s.update(n="many"),
        lambda s: s.update(n=-1),
        lambda s: s.update(n=0),
        lambda s: s.update(z=[1.0, 2.0]),
        lambda s: s.update(z=None),
        lambda s: s.update(z="text"),
        lambda s: s.update(log_likelihood=None),
        lambda s: s.update(belief=None),
        lambda s: s.update(before=None),
        lambda s: s["belief"].update(window=[]),
        lambda s: s["belief"].update(window=[1.0, 2.0]),
        lambda s: s["belief"].update(window=[None]),
        lambda s: s["belief"].update(kind="other"),
        lambda s: s["belief"]["state"].update(table=[[1.0]]),
        lambda s: s["belief"]["state"].update(table=[[1.0], [1.0, 2.0]]),
        lambda s: s["belief"]["state"]["table"].pop(),
        lambda s: s["belief"]["state"]["table"][0].__setitem__(0, None),
        lambda s: s["before"]["state"]["table"].pop(),
        lambda s: s["belief"]["state"].update(sign=[1.0]),
    ],
)
def test_damaged_states(fuzzy_model, change, tmp_path):
    path = tmp_path / "filter.json"
    f = OFSRFilter(fuzzy_model, 3)
    f.filter([0.0, 1.0, 2.0])
    f.save(path)
    document = json.loads(path.read_text())
    change(document["state"])
    path.write_text(json.dumps(document))
    with pytest.raises(FileFormatError, match=r"filter\.json: damaged: "):
        OFSRFilter.load(path)


def test_damaged_options(fuzzy_model, tmp_path):
    path = tmp_path / "filter.json"
    OFSRFilter(fuzzy_model, 3).save(path)
    document = json.loads(path.read_text())
    for options in ({"n_nodes": -3}, {"rule": "none"}, {"colour": 3}, 3):
        path.write_text(json.dumps(document | {"options": options}))
        with pytest.raises(FileFormatError, match="damaged: "):
            OFSRFilter.load(path)


def test_other_filters_and_models_are_named(fuzzy_model, hard_model, tmp_path):
    path = tmp_path / "file.json"
    OFSRFilter(fuzzy_model).save(path)
    with pytest.raises(FileFormatError, match="holds a 'OFSRFilter', expected CGOMSMFilter"):
        CGOMSMFilter.load(path)
    with pytest.raises(FileFormatError, match="holds a 'OFSRFilter', expected CGOFMSModel"):
        CGOFMSModel.load(path)
    with pytest.raises(FileFormatError, match="holds a 'OFSRFilter', expected CGOFMSModel or CGOMSModel"):
        io.load_model(path)
    hard_model.save(path)
    with pytest.raises(FileFormatError, match="holds a 'CGOMSModel', expected CGOFMSModel"):
        CGOFMSModel.load(path)
    with pytest.raises(FileNotFoundError):
        CGOFMSModel.load(tmp_path / "absent.json")


# --------------------------------------------------------------------------- whole or not at all


@pytest.mark.parametrize("call", ["fsync", "replace", "write"])
def test_a_failing_write_leaves_the_old_file(fuzzy_model, monkeypatch, tmp_path, call):
    path = tmp_path / "model.json"
    path.write_text("old")

    def fail(*args, **kwargs):
        raise OSError("no space left on device")

    if call == "fsync":
        monkeypatch.setattr(os, "fsync", fail)
    elif call == "replace":
        monkeypatch.setattr(Path, "replace", fail)
    else:
        monkeypatch.setattr(os, "fdopen", fail)
    with pytest.raises(OSError, match="no space left"):
        fuzzy_model.save(path)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["model.json"]


def test_an_interrupted_write_leaves_the_old_file(fuzzy_model, monkeypatch, tmp_path):
    path = tmp_path / "model.json"
    path.write_text("old")

    def interrupt(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        fuzzy_model.save(path)
    assert path.read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


def test_what_cannot_be_written_writes_nothing(fuzzy_model, tmp_path):
    law = FuzzyMarkovLaw.from_density([[0.2, 0.05], [0.05, 0.2]], 0.1, 0.1)
    model = CGOFMSModel(law, fuzzy_model.form.means, fuzzy_model.form.covariances, 1)
    for thing in (model, OFSRFilter(model)):
        with pytest.raises(ParameterError, match="law: a law given by functions cannot be written to a file"):
            thing.save(tmp_path / "file.json")
    with pytest.raises(ValueError, match="not JSON compliant"):
        io.write_document(tmp_path / "file.json", "numbers", {"value": float("nan")})
    assert not list(tmp_path.iterdir())
    with pytest.raises(FileNotFoundError):
        fuzzy_model.save(tmp_path / "absent" / "model.json")


def test_an_old_file_is_replaced_and_readable(fuzzy_model, tmp_path):
    path = tmp_path / "model.json"
    path.write_text("old")
    fuzzy_model.save(str(path))  # a path may be a string
    assert CGOFMSModel.load(str(path)).dim_x == 1
    umask = os.umask(0)
    os.umask(umask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~umask
    assert len(list(tmp_path.iterdir())) == 1


# --------------------------------------------------------------------------- older versions


def test_older_documents_are_brought_up_to_date(fuzzy_model, monkeypatch, tmp_path):
    # two made-up versions before the first: one upgrade after the other, and the kind is asked last
    path, document = save(fuzzy_model, tmp_path)
    law, form = document.pop("law"), document.pop("form")
    old = document | {"version": -1, "kind": "FuzzyModel", "chain": law, "gaussian": form}
    path.write_text(json.dumps(old))
    with pytest.raises(FileFormatError, match=r"has schema version -1; this version of fuzzykf reads 1$"):
        CGOFMSModel.load(path)

    def rename_parts(values):
        return values | {"law": values["chain"], "form": values["gaussian"]}

    upgrades = {-1: rename_parts, 0: lambda values: values | {"kind": "CGOFMSModel"}}
    monkeypatch.setattr(io, "UPGRADES", upgrades)
    model = io.load_model(path)
    assert model.to_dict() == fuzzy_model.to_dict()
    model.save(tmp_path / "again.json")
    assert json.loads((tmp_path / "again.json").read_text())["version"] == 1
    for damage in ({"version": 2}, {"version": "0"}, {"version": [0]}):
        path.write_text(json.dumps(old | damage))
        with pytest.raises(FileFormatError, match=r"this version of fuzzykf reads -1 and 0 and 1$"):
            CGOFMSModel.load(path)
    del old["chain"]
    path.write_text(json.dumps(old))
    with pytest.raises(FileFormatError, match=r"model\.json: damaged: KeyError: 'chain'"):
        CGOFMSModel.load(path)


FILES = DATA / "files" / "v1"
EXPECTED = json.loads((FILES / "expected.json").read_text())


@pytest.fixture(scope="module")
def written():
    """The module that wrote the files of version 1, with the code of its time."""
    spec = importlib.util.spec_from_file_location("write_files", DATA / "files" / "write_files.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def check_outputs(written, f, expected):
    """Compare five more estimates: what was read is the same to the bit, what follows may round otherwise.

    They were written on another processor; each step conditions on one observation, which
    magnifies rounding by no more than the condition of an innovation, 1e3 in these models.  What follows the
    observation that is missing among them was written anew when gaps of one became exact.
    """
    found = written.outputs(f, expected.get("predicted", False))
    for step, step_then in zip(found, expected["outputs"], strict=True):
        for name, then in step_then.items():
            np.testing.assert_allclose(floats(step[name]), floats(then), rtol=1e-10, atol=1e-11)


def assert_alike(got, expected):
    """Compare plain values, numbers to their last bit but one."""
    if isinstance(expected, dict):
        assert got.keys() == expected.keys()
        for key in expected:
            assert_alike(got[key], expected[key])
    elif isinstance(expected, list):
        assert len(got) == len(expected)
        for pair in zip(got, expected, strict=True):
            assert_alike(*pair)
    elif isinstance(expected, float):
        assert got == pytest.approx(expected, rel=4e-16, abs=1e-16)
    else:
        assert got == expected


def floats(numbers):
    return np.vectorize(float.fromhex, otypes=[float])(numbers)


@pytest.mark.parametrize("name", EXPECTED["models"])
def test_models_of_version_1(name, written, tmp_path):
    expected, path = EXPECTED["models"][name], FILES / f"{name}.json"
    model = io.load_model(path)
    assert written.parameters(model) == expected["parameters"]
    f = OFSRFilter(model, 2) if isinstance(model, CGOFMSModel) else CGOMSMFilter(model)
    check_outputs(written, f, expected)
    assert type(model).load(path).to_dict() == model.to_dict()
    model.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()


#: Filters on nodes further apart than the band of their law, which are no longer made, but go on working.
APART = {"ofsr_complete"}


@pytest.mark.filterwarnings("ignore:n_nodes. got 3 with rule='midpoint', whose nodes:UserWarning")
@pytest.mark.parametrize("name", EXPECTED["filters"])
def test_filters_of_version_1(name, written, tmp_path):
    path = FILES / f"{name}.json"
    if name in APART:
        with pytest.warns(UserWarning, match=r"are 0\.3333 apart, but the band of the law is only 0\.3 wide"):
            f = io.load_filter(path)
        with pytest.raises(ParameterError, match="the band of the law is only"):  # and only from a file
            OFSRFilter(f.model, f.n_nodes, f.rule)
    else:
        f = io.load_filter(path)
    f.save(tmp_path / "again.json")
    again = json.loads((tmp_path / "again.json").read_text(encoding="utf-8"))
    then = json.loads(path.read_text(encoding="utf-8"))
    # what is known of a window was stored after arithmetic, and is itself now: the last bit may differ
    assert_alike(again.pop("state"), then.pop("state"))
    assert again == then
    assert type(f).load(path).to_dict() == f.to_dict()
    check_outputs(written, f, EXPECTED["filters"][name])


def test_files_of_every_kind_are_kept():
    documents = [json.loads(path.read_text()) for path in FILES.glob("*.json") if path.stem != "expected"]
    assert {d["kind"] for d in documents} == {"CGOFMSModel", "CGOMSModel", "OFSRFilter", "CGOMSMFilter"}
    models = [d for d in documents if "form" in d]
    assert {d["form"]["kind"] for d in models} == {"covariance", "transition", "regression", "cglssm"}
    assert {d["law"]["kind"] for d in models if "law" in d} == {"fmc1", "fmc2", "free"}
    states = [d["state"] for d in documents if "state" in d]
    assert {s["belief"] and s["belief"]["kind"] for s in states} == {None, "complete", "gap"}


# --------------------------------------------------------------------------- kinds


@pytest.mark.parametrize("registry", [io.MODELS, io.FILTERS], ids=["models", "filters"])
def test_kinds_name_their_classes(registry):
    for kind, cls in registry.items():
        assert cls.__name__ == kind
        assert issubclass(cls, io.Document)
    assert "unknown" not in registry
    assert len(registry) == len(list(registry))


def test_a_fresh_process_finds_the_class(fuzzy_model, tmp_path):
    path = tmp_path / "model.json"
    fuzzy_model.save(path)
    code = """if True:
        import sys
        from fuzzykf import io
        assert not [name for name in sys.modules if name.startswith("fuzzykf.switching")]
        print(type(io.load_model(sys.argv[1])).__name__)
    """
    run = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=True)
    assert run.stdout == "CGOFMSModel\n"


def test_a_state_space_model_comes_back(tmp_path):
    from fuzzykf import CGLSSM

    matrices = {"A": [[[0.9]], [[1 / 3]]], "B": [[[1.0]], [[0.7]]], "C": [[[0.3]], [[1.0]]]}
    system = CGLSSM([[0.9, 0.1], [0.3, 0.7]], **matrices, D=[[[0.5]], [[0.1]]])
    system.save(tmp_path / "system.json")
    for again in (CGLSSM.load(tmp_path / "system.json"), io.load_model(tmp_path / "system.json")):
        assert type(again) is CGLSSM
        assert again.to_dict() == system.to_dict()


class Mine(CGOFMSModel):
    """A user's own kind of model."""


def test_subclasses_come_back(fuzzy_model, tmp_path):
    path = tmp_path / "mine.json"
    Mine._from_form(fuzzy_model.law, fuzzy_model.form).save(path)
    assert type(Mine.load(path)) is Mine
    with pytest.raises(FileFormatError, match="holds a 'Mine', expected CGOFMSModel or CGOMSModel or CGLSSM"):
        io.load_model(path)


def test_a_gap_between_versions_is_noticed(tmp_path, monkeypatch):
    path = tmp_path / "old.json"
    path.write_text(json.dumps({"format": "fuzzykf", "version": 0, "kind": "CGOMSModel"}))
    monkeypatch.setattr(io, "SCHEMA_VERSION", 2)
    monkeypatch.setattr(io, "UPGRADES", {0: dict})
    with pytest.raises(FileFormatError, match="version 0 cannot be brought to version 2"):
        io.read_document(path, ("CGOMSModel",))


def test_a_model_is_no_filter(hard_model, tmp_path):
    path = tmp_path / "model.json"
    hard_model.save(path)
    with pytest.raises(FileFormatError, match="cls: got CGOMSModel, expected 'OFSRFilter', 'CGOM"):
        io.load_filter(path, CGOMSModel)
    with pytest.raises(FileFormatError, match="cls: got CGOMSMFilter, expected 'CGOFMSModel', "):
        io.load_model(path, CGOMSMFilter)
