"""Models and filter states on disk: JSON with a schema version, written atomically.

Numbers are written so that they are read back bit for bit.  Nothing is pickled:
a file holds values, never code.
"""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from fuzzykf.errors import FileFormatError, FuzzykfError, ParameterError

if TYPE_CHECKING:
    from os import PathLike

__all__ = [
    "load_filter",
    "load_model",
    "read_document",
    "save_filter",
    "save_model",
    "write_document",
    "write_text",
]

#: Version of the files that this package writes, and the only one that it reads.
SCHEMA_VERSION = 1

M = TypeVar("M")


# --------------------------------------------------------------------------- files


def write_text(path: str | PathLike[str], text: str) -> None:
    """Write a text file so that a reader sees the old one or the new one, whole."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | PathLike[str], content: bytes) -> None:
    """Write a file so that a reader sees the old one or the new one, whole."""
    target = Path(path)
    handle, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        umask = os.umask(0)
        os.umask(umask)
        Path(name).chmod(0o666 & ~umask)  # mkstemp makes private files
        Path(name).replace(target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_document(path: str | PathLike[str], kind: str, content: dict[str, Any]) -> None:
    """Write ``content`` as a document of the given kind.

    Raises
    ------
    ValueError
        If a number is NaN or infinite, which JSON cannot express.
    """
    write_text(path, json.dumps(as_document(kind, content), allow_nan=False, indent=1) + "\n")


def as_document(kind: str, content: dict[str, Any]) -> dict[str, Any]:
    """Return ``content`` with the head that says what it is."""
    return {"format": "fuzzykf", "version": SCHEMA_VERSION, "kind": kind} | content


def read_document(path: str | PathLike[str], kinds: tuple[str, ...]) -> dict[str, Any]:
    """Read a document of one of the given kinds.

    Raises
    ------
    FileFormatError
        If the file is no JSON, not from fuzzykf, of another version or another kind.
    """
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=_refuse_constant)
    except ValueError as error:  # not UTF-8, not JSON, or NaN
        raise FileFormatError(f"{path}: damaged, or not a JSON file: {error}") from error
    if not isinstance(document, dict) or document.get("format") != "fuzzykf":
        raise FileFormatError(f"{path}: not a file written by fuzzykf")
    version = document.get("version")
    if version != SCHEMA_VERSION:
        raise FileFormatError(
            f"{path}: has schema version {version!r}; this version of fuzzykf reads {SCHEMA_VERSION}"
        )
    if document.get("kind") not in kinds:
        raise FileFormatError(f"{path}: holds a {document.get('kind')!r}, expected {' or '.join(kinds)}")
    return document


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"{name} is no number of JSON")


# --------------------------------------------------------------------------- models


def save_model(model: Any, path: str | PathLike[str]) -> None:
    """Write a model to a file; see `CGOFMSModel.save`."""
    write_document(path, type(model).__name__, model_to_dict(model))


def load_model(path: str | PathLike[str], cls: type[M] | None = None) -> M:
    """Read a model from a file.

    Parameters
    ----------
    path : path-like
    cls : type, optional
        The model expected; by default either.

    Returns
    -------
    CGOFMSModel or CGOMSModel

    Raises
    ------
    FileFormatError
        If the file is damaged, foreign, of another version, or holds something else.
    """
    kinds = ("CGOFMSModel", "CGOMSModel") if cls is None else (cls.__name__,)
    document = read_document(path, kinds)
    model: M = _rebuild(path, lambda: model_from_dict(document["kind"], document))
    return model


def model_to_dict(model: Any) -> dict[str, Any]:
    """Return the parameters of a model as plain values."""
    form = {"kind": model.form.kind} | model.form.to_dict()
    if hasattr(model, "law"):
        if model.law.kind == "from_density":
            raise ParameterError("law: a law given by functions cannot be written to a file")
        law = {"kind": model.law.kind} | model.law.parameters
        if model.law.kind == "free":
            law["joint"] = model.law.masses.tolist()
        return {"law": law, "form": form}
    return {"transition": model.transition.tolist(), "initial": model.initial.tolist(), "form": form}


def model_from_dict(kind: str, values: dict[str, Any]) -> Any:
    """Build a model from what `model_to_dict` returned."""
    from fuzzykf.switching.dynamics import forms
    from fuzzykf.switching.laws.cells import CellLaw
    from fuzzykf.switching.laws.law import FuzzyMarkovLaw
    from fuzzykf.switching.models.fuzzy import CGOFMSModel
    from fuzzykf.switching.models.hard import CGOMSModel
    from fuzzykf.switching.state_space.converted import ConvertedSystem

    parameters = dict(values["form"])
    if parameters["kind"] == ConvertedSystem.kind:
        del parameters["kind"]
        return CGOMSModel._from_system(ConvertedSystem.from_dict(parameters))
    known = {c.kind: c for c in (forms.CovarianceForm, forms.TransitionForm, forms.RegressionForm)}
    make_form: Any = known[parameters.pop("kind")]
    form = make_form(**parameters)
    if kind == "CGOFMSModel":
        law = dict(values["law"])
        laws = {"fmc1": FuzzyMarkovLaw.fmc1, "fmc2": FuzzyMarkovLaw.fmc2, "free": CellLaw}
        make_law: Any = laws[law.pop("kind")]
        return CGOFMSModel._from_form(make_law(**law), form)
    return CGOMSModel._from_form(values["transition"], form, values["initial"])


def _rebuild(path: str | PathLike[str], build: Any) -> Any:
    try:
        return build()
    except (KeyError, TypeError, IndexError, AttributeError, ValueError, FuzzykfError) as error:
        raise FileFormatError(f"{path}: damaged: {type(error).__name__}: {error}") from error


# --------------------------------------------------------------------------- filters


def save_filter(filter_: Any, path: str | PathLike[str]) -> None:
    """Write a switching filter, model and state, to a file; see `OFSRFilter.save`."""
    content = {
        "model_kind": type(filter_.model).__name__,
        "model": model_to_dict(filter_.model),
        "options": filter_._options(),
        "state": filter_._export_state(),
    }
    write_document(path, type(filter_).__name__, content)


def load_filter(path: str | PathLike[str], cls: type[M]) -> M:
    """Read a switching filter that `save_filter` has written."""
    document = read_document(path, (cls.__name__,))

    def build() -> Any:
        model = model_from_dict(document["model_kind"], document["model"])
        make: Any = cls
        loaded = make(model, **document["options"])
        loaded._import_state(document["state"])
        return loaded

    loaded: M = _rebuild(path, build)
    return loaded


def encode(array: np.ndarray | None) -> Any:
    """Return an array as nested lists, None staying None; NaN, in vectors, becomes None."""
    if array is None:
        return None
    if array.ndim == 1 and array.dtype == np.float64:
        return [None if np.isnan(v) else v for v in array.tolist()]
    return array.tolist()


def decode(values: Any, ndim: int) -> Any:
    """Return nested lists as a float array of the given dimension, None staying None."""
    if values is None:
        return None
    array = np.array(values, dtype=np.float64)
    if array.ndim != ndim:
        raise FileFormatError(f"expected an array of {ndim} dimensions, got {array.ndim}")
    return array
