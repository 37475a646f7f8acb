"""Models and filter states on disk: JSON with a schema version, written atomically.

Numbers are written so that they are read back bit for bit.  Nothing is pickled:
a file holds values, never code.

What a file holds says so in its kind.  The class of a kind writes and reads the values
(`Document`); here stands only where it is found (`MODELS`, `FILTERS`).
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np

from fuzzykf.errors import FileFormatError, FuzzykfError, ParameterError
from fuzzykf.files import read_bytes, write_text
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
        "SwitchingStateSpace": "fuzzykf.switching.state_space.model:SwitchingStateSpace",
    }
)

#: Kinds of documents that hold a filter, with its model and its state.
FILTERS = Registry(
    {
        "OFSRFilter": "fuzzykf.switching.filters.ofsr:OFSRFilter",
        "CGOMSMFilter": "fuzzykf.switching.filters.cgomsm:CGOMSMFilter",
        "SwitchingKalmanFilter": "fuzzykf.switching.filters.switching_kalman:SwitchingKalmanFilter",
        "FuzzyRelationEstimator": "fuzzykf.possibility.estimator:FuzzyRelationEstimator",
        "FilterPool": "fuzzykf.switching.filters.pool:FilterPool",
    }
)

#: What damaged values may raise where they are put together.
_DAMAGE = (
    KeyError,
    TypeError,
    IndexError,
    AttributeError,
    ValueError,
    ArithmeticError,
    MemoryError,
    FuzzykfError,
)

#: How many bytes a document may have unless told otherwise.
MAX_BYTES = 1 << 25

#: How deeply lists and mappings may be nested, and how large whole numbers may be.
MAX_DEPTH, MAX_WHOLE = 32, 1 << 63

_PIECE = 1 << 20

#: How much of an error about damaged values is shown: they may be as long as the file.
_SHOWN = 500

M = TypeVar("M")


# --------------------------------------------------------------------------- files


def write_document(path: str | PathLike[str], kind: str, content: dict[str, Any]) -> None:
    """Write plain values to a JSON file, as a document of a given kind.

    Parameters
    ----------
    path : path-like
        ``-`` is standard output.
    kind : str
        What the document holds; a reader asks for it.
    content : dict
        Numbers, text, None, and lists and dicts of these.

    Raises
    ------
    ValueError
        If a number is NaN or infinite, which JSON cannot express.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from fuzzykf.io import read_document, write_document
    >>> with TemporaryDirectory() as folder:
    ...     write_document(f"{folder}/law.json", "MyLaw", {"rate": 0.1})
    ...     found = read_document(f"{folder}/law.json", ("MyLaw",))
    >>> found["rate"]
    0.1
    """
    write_text(path, json.dumps(as_document(kind, content), allow_nan=False, indent=1) + "\n")


def as_document(kind: str, content: dict[str, Any]) -> dict[str, Any]:
    """Return ``content`` with the head that says what it is."""
    return {"format": "fuzzykf", "version": SCHEMA_VERSION, "kind": kind} | content


def read_document(
    path: str | PathLike[str], kinds: tuple[str, ...], max_bytes: int | None = None
) -> dict[str, Any]:
    """Read a JSON document of one of the given kinds.

    Parameters
    ----------
    path : path-like
    kinds : tuple of str
        Admissible kinds.
    max_bytes : int, optional
        Largest admissible file, in bytes; by default the environment variable FUZZYKF_MAX_BYTES, or else 32
        MiB.

    Returns
    -------
    dict

    Raises
    ------
    FileFormatError
        If the file is not JSON, not from fuzzykf, of another version or another kind, or larger than
        ``max_bytes``.

    See Also
    --------
    write_document : With an example.
    """
    content = read_bytes(path, max_bytes, MAX_BYTES)
    try:
        _check_depth(content)
        document: Any = json.loads(content.decode("utf-8"), parse_constant=_refuse_constant, parse_int=_whole)
    except ValueError as error:  # not UTF-8, not JSON, or NaN
        raise FileFormatError(f"{path}: damaged, or not a JSON file: {_shown(error)}") from error
    if not isinstance(document, dict) or document.get("format") != "fuzzykf":
        raise FileFormatError(f"{path}: not a file written by fuzzykf")
    version = document.get("version")
    readable = (*sorted(UPGRADES), SCHEMA_VERSION)
    if isinstance(version, bool) or not isinstance(version, int) or version not in readable:
        raise FileFormatError(
            f"{path}: has schema version {_shown(version)}; this version of fuzzykf reads "
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
        raise FileFormatError(
            f"{path}: holds a {_shown(document.get('kind'))}, expected {' or '.join(kinds)}"
        )
    return dict(document)


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"{name} is no number of JSON")


def _whole(digits: str) -> int:
    value = int(digits) if len(digits) < 21 else MAX_WHOLE
    if abs(value) >= MAX_WHOLE:
        raise ValueError(f"a whole number has {len(digits.lstrip('-'))} digits, expected less than 2^63")
    return value


def _check_depth(content: bytes) -> None:
    """Refuse nesting that no document has, before anything is called once a level."""
    level = 0
    for start in range(0, len(content), _PIECE):
        marks = (
            np.frombuffer(content[start : start + _PIECE], dtype=np.uint8) | 0x20
        )  # braces are brackets, too
        steps = (marks == ord("{")).astype(np.int8) - (marks == ord("}"))
        depth = level + np.cumsum(steps[steps != 0])  # also of those in texts, where no document has any
        if depth.size:
            if depth.max() > MAX_DEPTH:
                raise ValueError(f"lists are nested deeper than {MAX_DEPTH}")
            level = int(depth[-1])


def _shown(value: object) -> str:
    text = str(value) if isinstance(value, Exception) else repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _damaged(path: str | PathLike[str], error: BaseException) -> FileFormatError:
    return FileFormatError(f"{path}: damaged: {type(error).__name__}: {_shown(error)}")


# --------------------------------------------------------------------------- documents


class Document(ABC):
    """What can be written to a file of its own, and read again."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return its arguments as plain values."""

    @classmethod
    @abstractmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make it from the output of `to_dict`; other keys are ignored."""

    def save(self, path: str | PathLike[str]) -> None:
        """Save to a JSON file, atomically; `load` restores every number exactly.

        Parameters
        ----------
        path : path-like
            An existing file is replaced but keeps its mode and owner.  Devices and pipes work; ``-`` is
            standard output.

        Raises
        ------
        ParameterError
            If it holds functions (a law made by `FuzzyMarkovLaw.from_density`, an ``fx``), which a file
            cannot.
        """
        write_document(path, type(self).__name__, self.to_dict())

    @classmethod
    def load(cls, path: str | PathLike[str], *, max_bytes: int | None = None) -> Self:
        """Load a model or filter from a file written by `save`; a filter resumes in its saved state.

        Parameters
        ----------
        path : path-like
        max_bytes : int, optional
            Largest admissible file, in bytes; by default the environment variable FUZZYKF_MAX_BYTES, or else
            32 MiB.

        Returns
        -------
        object of this class

        Raises
        ------
        FileFormatError
            If the file is damaged, too large, not from fuzzykf, of another version, or holds another class.
        """
        loaded: Self = _load(path, {cls.__name__: cls}, max_bytes)
        return loaded


def _load(path: str | PathLike[str], classes: Mapping[str, Any], max_bytes: int | None) -> Any:
    """Read a document of one of these classes, by their kinds."""
    document = read_document(path, tuple(classes), max_bytes)
    make = classes[document["kind"]]
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused where it stands
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
    """Save a model to a JSON file; the same as ``model.save(path)``.

    Parameters
    ----------
    model : CGOFMSModel, CGOMSModel, CGLSSM or SwitchingStateSpace
    path : path-like
        ``-`` is standard output.

    Raises
    ------
    ParameterError
        If the model holds functions, which a file cannot.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from fuzzykf import SwitchingStateSpace
    >>> from fuzzykf.io import load_model, save_model
    >>> model = SwitchingStateSpace([[0.9, 0.1], [0.1, 0.9]], F=0.5, H=1.0, Q=0.1, R=0.1)
    >>> with TemporaryDirectory() as folder:
    ...     save_model(model, f"{folder}/model.json")
    ...     loaded = load_model(f"{folder}/model.json")
    >>> loaded.dim_x, loaded.n_classes
    (1, 2)
    """
    if type(model).__name__ not in MODELS:
        raise ParameterError(f"model: got {type(model).__name__}, expected {either(MODELS)}")
    model.save(path)


def load_model(path: str | PathLike[str], cls: type[M] | None = None, *, max_bytes: int | None = None) -> M:
    """Load a model of any class from a JSON file.

    Parameters
    ----------
    path : path-like
    cls : type, optional
        Class that the model must have; by default any.
    max_bytes : int, optional
        Largest admissible file, in bytes; by default 32 MiB.

    Returns
    -------
    CGOFMSModel, CGOMSModel or CGLSSM

    Raises
    ------
    FileFormatError
        If the file is damaged, too large, not from fuzzykf, of another version, or holds another class.

    See Also
    --------
    save_model : With an example.
    """
    model: M = _load(path, _expected(cls, MODELS, FILTERS), max_bytes)
    return model


def save_filter(filter_: Any, path: str | PathLike[str]) -> None:
    """Save a filter, with its model and state, to a JSON file.

    Parameters
    ----------
    filter_ : OFSRFilter, CGOMSMFilter, SwitchingKalmanFilter, FilterPool or FuzzyRelationEstimator
    path : path-like
        ``-`` is standard output.

    Raises
    ------
    ParameterError
        If the filter holds functions, which a file cannot.

    See Also
    --------
    save_model : The same for a model, with an example.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from fuzzykf import FuzzyRelationEstimator
    >>> from fuzzykf.io import load_filter, save_filter
    >>> est = FuzzyRelationEstimator(dim_x=1, dim_z=1, H=1.0)
    >>> x = est.step(2.0)
    >>> with TemporaryDirectory() as folder:
    ...     save_filter(est, f"{folder}/filter.json")
    ...     loaded = load_filter(f"{folder}/filter.json")
    >>> bool(loaded.x == x)
    True
    """
    if type(filter_).__name__ not in FILTERS:
        raise ParameterError(f"filter_: got {type(filter_).__name__}, expected {either(FILTERS)}")
    filter_.save(path)


def load_filter(path: str | PathLike[str], cls: type[M] | None = None, *, max_bytes: int | None = None) -> M:
    """Load a filter of any class from a JSON file, in the state in which it was saved.

    Parameters
    ----------
    path : path-like
    cls : type, optional
        Class that the filter must have; by default any.
    max_bytes : int, optional
        Largest admissible file, in bytes; by default 32 MiB.

    Returns
    -------
    filter
        Of the class that was saved.

    Raises
    ------
    FileFormatError
        If the file is damaged, too large, not from fuzzykf, of another version, or holds another class.

    See Also
    --------
    save_filter : With an example.
    """
    loaded: M = _load(path, _expected(cls, FILTERS, MODELS), max_bytes)
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
    array = np.array(values)
    if array.dtype == object and array.ndim == 1:  # None among numbers is NaN
        array = np.array([np.nan if value is None else number(value) for value in values])
    if array.dtype.kind not in "fi" and array.size:
        raise FileFormatError(f"expected numbers, got {array.dtype}")
    if array.ndim != ndim:
        raise FileFormatError(f"expected an array of {ndim} dimensions, got {array.ndim}")
    return array.astype(np.float64)


def number(value: Any) -> float:
    """Return a number of a document; a truth value is none, and a text neither."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FileFormatError(f"expected a number, got {value!r}")
    return float(value)


def whole(name: str, value: Any, least: int = 0) -> int:
    """Return a whole number of a document."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise FileFormatError(f"{name}: got {value!r}, expected a whole number of at least {least}")
    return value


def flag(name: str, value: Any) -> bool:
    """Return a truth value of a document; a number is none."""
    if not isinstance(value, bool):
        raise FileFormatError(f"{name}: got {value!r}, expected true or false")
    return value
