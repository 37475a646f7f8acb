"""Write files of every kind with the fuzzykf that is imported, and the numbers they stand for.

Run once for each version of the files, by the last code that wrote it:
FUZZYKF_ENGINE=numpy python write_files.py v1.  What it wrote is never written again.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FuzzyMarkovLaw, OFSRFilter

SINGLE = np.array([[[0.5, 0.3], [0.3, 1.0]], [[0.75, 0.3], [0.3, 0.5]]])
CROSS = np.array([[[0.1, 0.35], [0.0, 0.4]], [[0.5, 0.33], [0.0, 0.3]]])
MEANS = [[0.0, 3.0], [0.0, 0.0]]
LAWS = {"fmc1": FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), "fmc2": FuzzyMarkovLaw.fmc2(0.1, 0.8 / 1.71, 0.3)}
SPACE = {
    "transition": [[0.95, 0.05], [0.1, 0.9]],
    "A": [[[0.98]], [[0.5]]],
    "B": [[[1.0]], [[0.7]]],
    "C": [[[0.2]], [[1.0]]],
    "D": [[[0.5]], [[0.3]]],
}


def covariances():
    """Covariances of two consecutive (X, Y) for pairs of regimes, (2, 2, 4, 4)."""
    gamma = np.empty((2, 2, 4, 4))
    for i, j in np.ndindex(2, 2):
        K = CROSS[j].copy()
        K[1, 0] = K[1, 1] * SINGLE[i, 0, 1] / SINGLE[i, 1, 1]
        gamma[i, j] = np.block([[SINGLE[i], K.T], [K, SINGLE[j]]])
    return gamma


def definite(rng, *shape):
    """Random covariances."""
    root = 0.4 * rng.normal(size=shape) + np.eye(shape[-1])
    return root @ np.swapaxes(root, -1, -2)


def regressions(K, m):
    """Random regressions of K regimes: m states, one observation."""
    rng = np.random.default_rng(K)
    return {
        "Ayy": rng.normal(size=(K, K, 1, 1)) / 3,
        "Ny": rng.normal(size=(K, K, 1)),
        "Qyy": definite(rng, K, K, 1, 1),
        "Axx": rng.normal(size=(K, K, m, m)) / 3,
        "H": rng.normal(size=(K, K, m, 1)),
        "G": rng.normal(size=(K, K, m, 1)),
        "c": rng.normal(size=(K, K, m)),
        "C": definite(rng, K, K, m, m),
        "means": rng.normal(size=(K, m + 1)),
        "covariances": definite(rng, K, m + 1, m + 1),
    }


def make_models():
    """Models by the name of their file."""
    paper = CGOFMSModel(LAWS["fmc1"], MEANS, covariances(), 1)
    data = paper.simulate(150, np.random.default_rng(0))
    learned = CGOFMSModel.fit(
        data.x, data.y, law="free", form="regression", n_nodes=2, n_starts=1, max_iter=4
    )
    A = 0.3 * np.broadcast_to([[1.0, 0.5, 0.2], [-0.4, 0.7, 1.0], [0.0, 0.0, 1.1]], (2, 2, 3, 3))
    rng = np.random.default_rng(3)
    moments = definite(rng, 2, 2, 3, 3), rng.normal(size=(2, 3)), definite(rng, 2, 3, 3)
    return {
        "fuzzy_fmc1_covariance": paper,
        "fuzzy_fmc2_check": CGOFMSModel(LAWS["fmc2"], MEANS, covariances(), 1, constraint="check"),
        "fuzzy_fmc2_transition": CGOFMSModel(
            LAWS["fmc2"], MEANS, covariances(), 1, interpolation="transition"
        ),
        "fuzzy_fmc1_regression": CGOFMSModel.from_regressions(LAWS["fmc1"], **regressions(2, 2)),
        "fuzzy_free_regression": learned.model,
        "hard_covariance": CGOMSModel([[0.8, 0.2], [0.3, 0.7]], MEANS, covariances(), 1),
        "hard_transition": CGOMSModel.from_transitions(
            [[0.8, 0.2], [0.3, 0.7]], A, *moments, dim_x=2, initial=[1 / 3, 2 / 3]
        ),
        "hard_regression": CGOMSModel.from_regressions(
            [[0.5, 0.5, 0], [0.1, 0.2, 0.7], [1 / 3, 1 / 3, 1 / 3]],
            **regressions(3, 1),
            initial=[0.1, 0.2, 0.7],
        ),
        "converted_gain": CGOMSModel.from_cglssm(**SPACE),
        "converted_order_3": CGOMSModel.from_cglssm(**SPACE, order=3),
        "converted_clip": CGOMSModel.from_cglssm(**SPACE, construction="clip", noise="averaged"),
        "converted_markov_x": CGOMSModel.from_cglssm([[1.0]], **one_regime(), construction="markov_x"),
        "converted_moving": CGOMSModel.from_cglssm(
            **SPACE,
            mode="time_varying",
            order=3,
            initial_probability=[1.0, 0.0],
            initial_covariance=[[[2.0]], [[3.0]]],
        ),
    }


def one_regime():
    """Matrices for which all constructions exist."""
    return {"A": [[[0.3]]], "B": [[[1.0]]], "C": [[[1.0]]], "D": [[[2.0]]]}


def make_filters(models):
    """Filters by the name of their file: (model, options, observations taken, predicted)."""
    gap, late = [0.3, -1.2, None, None], [None, 0.4]
    complete = [0.3, -1.2, 2.5, 0.7, 1.1]
    plans = {
        "ofsr_fresh": ("fuzzy_fmc1_covariance", {"n_nodes": 3}, [], False),
        "ofsr_first": ("fuzzy_fmc1_covariance", {"n_nodes": 0}, [0.3], False),
        "ofsr_complete": ("fuzzy_fmc2_transition", {"n_nodes": 3, "rule": "midpoint"}, complete, False),
        "ofsr_predicted": ("fuzzy_fmc1_regression", {"n_nodes": 2}, complete, True),
        "ofsr_gap": ("fuzzy_fmc1_covariance", {"n_nodes": 3, "rule": "gauss"}, gap, False),
        "ofsr_signed": ("fuzzy_fmc2_check", {"n_nodes": 12, "rule": "product"}, complete, False),
        "ofsr_signed_gap": ("fuzzy_fmc2_check", {"n_nodes": 9, "rule": "product"}, gap, False),
        "ofsr_free": ("fuzzy_free_regression", {"n_nodes": 2}, gap, True),
        "cgomsm_complete": ("hard_transition", {}, complete, False),
        "cgomsm_gap": ("hard_regression", {}, late, False),
        "cgomsm_order_3": ("converted_order_3", {}, complete, False),
        "cgomsm_order_3_gap": ("converted_order_3", {}, gap, True),
        "cgomsm_order_3_early": ("converted_order_3", {}, [0.3, -0.1], False),
        "cgomsm_moving": ("converted_moving", {}, complete, True),
        "cgomsm_moving_gap": ("converted_moving", {}, late, False),
    }
    filters = {}
    for name, (model, options, zs, predicted) in plans.items():
        f = (OFSRFilter if name.startswith("ofsr") else CGOMSMFilter)(models[model], **options)
        for z in zs:
            f.step(z)
        if predicted:
            f.predict()
        filters[name] = f, predicted
    return filters


REGRESSIONS = ("Axx", "H", "G", "c", "C", "Ayy", "Ny", "Qyy")
NEXT = [0.5, None, 2.0, -1.5, 0.25]


def numbers(array):
    """Return an array as nested lists of hexadecimal floats."""
    return np.vectorize(lambda v: float(v).hex(), otypes=[object])(np.asarray(array, dtype=float)).tolist()


def outputs(f, predicted=False):
    """Take five more observations, one of them missing, and return what comes out."""
    taken = []
    for z in NEXT:
        if predicted:
            f.update(z)
            predicted = False
        else:
            f.step(z)
        taken.append({k: numbers(getattr(f, k)) for k in ("x", "P", "mu", "log_likelihood", "switch_mean")})
    return taken


def parameters(model):
    """Return the numbers that make a model, under the names of its attributes."""
    found = {}
    if hasattr(model, "law"):
        found = {f"law.{name}": value for name, value in model.law.parameters.items()}
        found["law.corners"] = model.law.corners
        if model.law.kind == "free":
            found["law.masses"] = model.law.masses
    else:
        found = {"transition": model.transition, "initial": model.initial}
    names = {
        "covariance": ("means", "covariances"),
        "transition": ("A", "Q", "means", "stationary"),
        "regression": (
            "means",
            "covariances",
            *(f"table.{name}" for name in REGRESSIONS),
        ),
        "cglssm": ("order", *(f"cglssm.{f}" for f in ("A", "B", "C", "D", "initial_covariance"))),
    }
    for name in names[model.form.kind]:
        value = model.form
        for part in name.split("."):
            value = getattr(value, part)
        found[f"form.{name}"] = value
    return {name: numbers(value) for name, value in found.items()}


def main(version):
    """Write all files into the folder of a version."""
    folder = Path(__file__).parent / version
    folder.mkdir(exist_ok=True)
    models = make_models()
    expected = {"arithmetic": arithmetic(), "models": {}, "filters": {}}
    for name, model in models.items():
        model.save(folder / f"{name}.json")
        f = OFSRFilter(model, 2) if isinstance(model, CGOFMSModel) else CGOMSMFilter(model)
        expected["models"][name] = {"parameters": parameters(model), "outputs": outputs(f)}
    for name, (f, predicted) in make_filters(models).items():
        f.save(folder / f"{name}.json")
        expected["filters"][name] = {"predicted": predicted, "outputs": outputs(f, predicted)}
    (folder / "expected.json").write_text(json.dumps(expected) + "\n")


def arithmetic():
    """Tell machines apart whose linear algebra rounds differently."""
    S = definite(np.random.default_rng(0), 5, 3, 3)
    values = np.linalg.solve(S, np.linalg.cholesky(S) @ S), np.exp(S), np.log(S * S), np.linalg.eigvalsh(S)
    return [float(np.sin(v.astype(float)).sum()).hex() for v in values]


if __name__ == "__main__":
    main(sys.argv[1])
