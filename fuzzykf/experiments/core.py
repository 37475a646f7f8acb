"""What an experiment is, and how it is run, kept and written.

An experiment is cut into pieces, such as the columns of a table.  Each piece has
parameters, a random number generator of its own, and gives arrays with one entry per
run.  A piece that is done is kept in the output folder, under a digest of everything it
depends on, so that an interrupted run goes on where it was.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

import fuzzykf
from fuzzykf.errors import MissingDependencyError, ParameterError
from fuzzykf.experiments.verdicts import LEVEL, judge
from fuzzykf.files import write_bytes, write_text
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from fuzzykf.experiments.verdicts import Finding, Row

    Samples: TypeAlias = dict[str, NDArray[Any]]

__all__ = ["Experiment", "Outcome", "new_figure", "perform", "write"]

#: Folder, inside the output folder, of the pieces that are done.
PIECES = "pieces"


@reprs()
@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Reproduction of a table or figure of a paper.

    Attributes
    ----------
    name : str
        Name on the command line.
    paper : str
        Year of the paper.
    reproduces : str
        The table or figure.
    runs, quick_runs : int
        Number of independent runs, by default and with ``--quick``.
    pieces : mapping of str to dict
        Parameters of each piece of work, by name.
    run : callable
        ``run(rng, runs, **parameters)`` does one piece.
    assess : callable
        Maps the arrays of all pieces to findings.
    draw : callable
        Plots the findings.
    load : callable, optional
        ``load(folder)`` reads data that are not part of the package, or raises `FileNotFoundError`; they are
        passed to ``run`` as ``data``.
    """

    name: str
    paper: str
    reproduces: str
    runs: int
    quick_runs: int
    pieces: Mapping[str, Mapping[str, Any]]
    run: Callable[..., Samples]
    assess: Callable[[Mapping[str, Samples]], list[Finding]]
    draw: Callable[[Mapping[str, Samples]], Figure]
    load: Callable[[Path | None], Samples] | None = None


@reprs()
@dataclass(frozen=True)
class Outcome:
    """Results of an experiment.

    Attributes
    ----------
    experiment : Experiment
    runs, seed : int
        Number of runs and seed.
    samples : dict
        Arrays of each piece, by name.
    rows : list of Row
        The findings with their verdicts.
    """

    experiment: Experiment
    runs: int
    seed: int
    samples: Mapping[str, Samples] = field(repr=False)
    rows: Sequence[Row]

    @property
    def counts(self) -> dict[str, int]:
        """Number of rows with each verdict."""
        verdicts = [row.verdict for row in self.rows]
        return {verdict: verdicts.count(verdict) for verdict in dict.fromkeys(verdicts)}


def perform(
    experiment: Experiment,
    *,
    runs: int | None = None,
    seed: int = 0,
    folder: Path | None = None,
    data: Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> Outcome:
    """Run an experiment, or continue an interrupted one.

    Parameters
    ----------
    experiment : Experiment
    runs : int, optional
        Independent runs per piece, at least 2; by default those of the experiment.
    seed : int
        Seed of the random numbers.  Those of a piece do not depend on other pieces.
    folder : path, optional
        Directory in which finished pieces are stored and found.
    data : path, optional
        Directory of data that are not part of the package.
    progress : callable, optional
        Called with the name of each piece before it starts.

    Returns
    -------
    Outcome

    Raises
    ------
    ParameterError
        If ``runs`` is less than 2 or ``seed`` negative.
    FileNotFoundError
        If the experiment needs data that are missing.

    Examples
    --------
    >>> from fuzzykf.experiments import EXPERIMENTS, perform
    >>> outcome = perform(EXPERIMENTS["hard-fraction"], runs=2)
    >>> outcome.runs, len(outcome.rows) > 0
    (2, True)
    """
    runs = experiment.runs if runs is None else runs
    if runs < 2:
        raise ParameterError(f"runs: got {runs}, expected at least 2, to tell how much they scatter")
    if seed < 0:
        raise ParameterError(f"seed: got {seed}, expected a number of at least 0")
    given: dict[str, Samples] = {} if experiment.load is None else {"data": experiment.load(data)}
    samples: dict[str, Samples] = {}
    for name, parameters in experiment.pieces.items():
        if progress is not None:
            progress(f"{experiment.name}: {name}")
        key = _digest(experiment.name, name, parameters, runs, seed, **given)
        kept = None if folder is None else folder / PIECES / f"{experiment.name}-{key}.npz"
        done = None if kept is None else _load(kept)
        if done is None:
            done = experiment.run(np.random.default_rng([seed, int(key, 16)]), runs, **parameters, **given)
            if kept is not None:
                _keep(kept, done)
        samples[name] = done
    return Outcome(experiment, runs, seed, samples, judge(experiment.assess(samples)))


def _digest(
    experiment: str,
    piece: str,
    parameters: Mapping[str, Any],
    runs: int,
    seed: int,
    data: Samples | None = None,
) -> str:
    content = [experiment, piece, parameters, runs, seed]
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode())
    for name, values in sorted((data or {}).items()):
        digest.update(name.encode() + values.tobytes())
    return digest.hexdigest()[:16]


@cache
def _source() -> str:
    """Return a digest of the package: what other code has computed is not taken for its own."""
    root = Path(fuzzykf.__file__).parent
    digest = hashlib.sha256(np.__version__.encode())
    for path in sorted(root.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _load(path: Path) -> Samples | None:
    """Read a piece that is done; None if there is none, or it was made by other code."""
    if not path.exists():
        return None
    with np.load(path, allow_pickle=False) as archive:
        arrays = dict(archive)
    return arrays if arrays.pop("source").item() == _source() else None


def _keep(path: Path, samples: Samples) -> None:
    content = io.BytesIO()
    arrays: Any = {"source": np.array(_source())} | samples
    np.savez_compressed(content, **arrays)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, content.getvalue())


# --------------------------------------------------------------------------- files


def write(outcome: Outcome, folder: Path) -> list[Path]:
    """Write table (CSV), record (JSON) and figure (PNG) of an outcome.

    Parameters
    ----------
    outcome : Outcome
    folder : path
        Directory; created if necessary.

    Returns
    -------
    list of path
    """
    experiment = outcome.experiment
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{experiment.name}.{ending}" for ending in ("csv", "json", "png")]
    figure = experiment.draw(outcome.samples)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    write_text(files[0], _as_csv(outcome))
    write_text(files[1], json.dumps(_as_document(outcome), indent=1, allow_nan=False) + "\n")
    write_bytes(files[2], picture.getvalue())
    return files


def _as_csv(outcome: Outcome) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    numbers = ["printed", "ours", "standard_error", "lower", "upper", "p_value"]
    writer.writerow(["quantity", *numbers, "test", "verdict", "note"])
    for row in outcome.rows:
        values = (row.printed, row.ours, row.standard_error, *(row.interval or (None, None)), row.p_value)
        shown = ["" if number is None else f"{number:.6g}" for number in values]
        writer.writerow([row.quantity, *shown, row.test, row.verdict, row.note])
    return stream.getvalue()


def _as_document(outcome: Outcome) -> dict[str, Any]:
    experiment = outcome.experiment
    return {
        "experiment": experiment.name,
        "paper": experiment.paper,
        "reproduces": experiment.reproduces,
        "fuzzykf": fuzzykf.__version__,
        "numpy": np.__version__,
        "seed": outcome.seed,
        "runs": outcome.runs,
        "level": LEVEL,
        "parameters": {name: dict(parameters) for name, parameters in experiment.pieces.items()},
        "verdicts": outcome.counts,
        "rows": [vars(row) | {"note": row.note} for row in outcome.rows],
    }


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure that is not registered with pyplot.

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError("pictures need matplotlib: pip install 'fuzzykf[cli]'") from error
    return Figure(figsize=(width, height), layout="constrained")
