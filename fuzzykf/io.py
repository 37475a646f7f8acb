"""Models and filter states on disk: JSON with a schema version, written atomically.

Numbers are written so that they are read back bit for bit.  Nothing is pickled:
a file holds values, never code.

What a file holds says so in its kind.  The class of a kind writes and reads the values
(`Document`); here stands only where it is found (`MODELS`, `FILTERS`).
"""

from __future__ import annotations

import json
import os
import tempfile
from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np

from fuzzykf.errors import FileFormatError, FuzzykfError
from fuzzykf.registry import Registry, either

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
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

#: Version of the files that this package writes.
SCHEMA_VERSION = 1

#: How a document of an older version becomes one of the next: functions of the whole document.
UPGRADES: dict[int, Callable[[dict[str, Any]], dict[str, Any]]] = {}

#: Kinds of documents that hold a model, and their classes.
MODELS = Registry(
    {
        "CGOFMSModel": "fuzzykf.switching.models.fuzzy:CGOFMSModel",
        "CGOMSModel": "fuzzykf.switching.models.hard:CGOMSModel",
        "CGLSSM": "fuzzykf.switching.state_space.cglssm:CGLSSM",
    }
)

#: Kinds of documents that hold a filter, with its model and its state.
FILTERS = Registry(
    {
        "OFSRFilter": "fuzzykf.switching.filters.ofsr:OFSRFilter",
        "CGOMSMFilter": "fuzzykf.switching.filters.cgomsm:CGOMSMFilter",
    }
)

#: What damaged values may raise where they are put together.
_DAMAGE = (KeyError, TypeError, IndexError, AttributeError, ValueError, FuzzykfError)

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
        document: Any = json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=_refuse_constant)
    except ValueError as error:  # not UTF-8, not JSON, or NaN
        raise FileFormatError(f"{path}: damaged, or not a JSON file: {error}") from error
    if not isinstance(document, dict) or document.get("format") != "fuzzykf":
        raise FileFormatError(f"{path}: not a file written by fuzzykf")
    version = document.get("version")
    readable = (*sorted(UPGRADES), SCHEMA_VERSION)
    if version not in readable:
        raise FileFormatError(
            f"{path}: has schema version {version!r}; this version of fuzzykf reads "
            f"{' and '.join(map(str, readable))}"
        )
    try:
        for old in readable[readable.index(version) : -1]:
            document = UPGRADES[old](document) | {"version": old + 1}
    except _DAMAGE as error:
        raise _damaged(path, error) from error
    if document["version"] != SCHEMA_VERSION:
        raise FileFormatError(f"{path}: version {version} cannot be brought to version {SCHEMA_VERSION}")
    if document.get("kind") not in kinds:
        raise FileFormatError(f"{path}: holds a {document.get('kind')!r}, expected {' or '.join(kinds)}")
    return dict(document)


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"{name} is no number of JSON")


def _damaged(path: str | PathLike[str], error: Exception) -> FileFormatError:
    return FileFormatError(f"{path}: damaged: {type(error).__name__}: {error}")


# --------------------------------------------------------------------------- documents


class Document(ABC):
    """What can be written to a file of its own, and read again."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return what it is made from as plain values."""

    @classmethod
    @abstractmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make it from what `to_dict` returned; other keys are passed over."""

    def save(self, path: str | PathLike[str]) -> None:
        """Write it to a JSON file, atomically; `load` gives it back bit for bit.

        Parameters
        ----------
        path : path-like

        Raises
        ------
        ParameterError
            If the model holds functions (a law made by `FuzzyMarkovLaw.from_density`).
        """
        write_document(path, type(self).__name__, self.to_dict())

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read what `save` has written; a filter in the state it was in.

        Raises
        ------
        FileFormatError
            If the file is damaged, foreign, of another version, or holds something else.
        """
        loaded: Self = _load(path, {cls.__name__: cls})
        return loaded


def _load(path: str | PathLike[str], classes: Mapping[str, Any]) -> Any:
    """Read a document of one of these classes, by their kinds."""
    document = read_document(path, tuple(classes))
    make = classes[document["kind"]]
    try:
        return make.from_dict(document)
    except _DAMAGE as error:
        raise _damaged(path, error) from error


def _expected(cls: Any, registry: Registry, others: Registry) -> Mapping[str, Any]:
    """Return the class that is expected, by its kind, or all of them; not one that a file holds otherwise."""
    if cls is None:
        return registry
    if cls.__name__ in others:
        raise FileFormatError(f"cls: got {cls.__name__}, expected {either(registry)}")
    return {cls.__name__: cls}


def save_model(model: Any, path: str | PathLike[str]) -> None:
    """Write a model to a file; see `Document.save`."""
    model.save(path)


def load_model(path: str | PathLike[str], cls: type[M] | None = None) -> M:
    """Read a model from a file.

    Parameters
    ----------
    path : path-like
    cls : type, optional
        The model expected; by default any.

    Returns
    -------
    CGOFMSModel, CGOMSModel or CGLSSM

    Raises
    ------
    FileFormatError
        If the file is damaged, foreign, of another version, or holds something else.
    """
    model: M = _load(path, _expected(cls, MODELS, FILTERS))
    return model


def save_filter(filter_: Any, path: str | PathLike[str]) -> None:
    """Write a switching filter, model and state, to a file; see `Document.save`."""
    filter_.save(path)


def load_filter(path: str | PathLike[str], cls: type[M] | None = None) -> M:
    """Read a switching filter from a file; by default any, otherwise one of the class ``cls``."""
    loaded: M = _load(path, _expected(cls, FILTERS, MODELS))
    return loaded


def model_to_dict(model: Any) -> dict[str, Any]:
    """Return the parameters of a model as plain values."""
    values: dict[str, Any] = model.to_dict()
    return values


# --------------------------------------------------------------------------- parts


def part_to_dict(part: Any) -> dict[str, Any]:
    """Return a part of a document, a law for instance, as plain values with its kind."""
    values: dict[str, Any] = {"kind": part.kind} | part.to_dict()
    return values


def part_from_dict(values: Mapping[str, Any], classes: Mapping[str, Any]) -> Any:
    """Build a part of a document from what `part_to_dict` returned.

    Parameters
    ----------
    values : mapping
    classes : mapping
        The classes that it may be of, by kind.
    """
    parameters = dict(values)
    return classes[parameters.pop("kind")].from_dict(parameters)


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
