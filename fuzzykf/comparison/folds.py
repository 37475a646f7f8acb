"""Folds: what is learned on, what is held out, and how candidates go through them, side by side."""

from __future__ import annotations

import os
import pickle
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.comparison.evaluation import Fold, HeldOut, restore
from fuzzykf.errors import FuzzykfError, MissingDependencyError, ParameterError
from fuzzykf.gaussian import as_count

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import Candidate, LearningPart
    from fuzzykf.comparison.clock import Clock

__all__ = ["Round", "cut_folds", "go_through"]

#: Where libraries of linear algebra read how many threads they may have.
THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


@dataclass(frozen=True, kw_only=True, eq=False)
class Round:
    """What happens in one fold.

    Attributes
    ----------
    name : str
        Of the fold, for progress and errors; may be empty.
    part : LearningPart
        What is learned on.
    truth, zs : ndarray, shapes (n, m) and (n, q)
        States and observations that are held out, NaN where missing.
    clock : Clock or None
        Their hours and days.
    inputs : ndarray, shape (n, k), or None
        What else is known of them.
    """

    name: str
    part: LearningPart
    truth: FloatArray
    zs: FloatArray
    clock: Clock | None = None
    inputs: FloatArray | None = None


def cut_folds(n: int, start: int, n_folds: int, window: str = "expanding") -> tuple[Fold, ...]:
    """Cut the rows from ``start`` on into folds.

    Parameters
    ----------
    n, start : int
        Rows, and those that the first fold learns on.
    n_folds : int
    window : {"expanding", "sliding"}
        Learn on all rows before a fold, or on as many of the latest as the first fold has.

    Examples
    --------
    >>> [(fold.begin, fold.split, fold.end) for fold in cut_folds(300, 200, 2)]
    [(0, 200, 250), (0, 250, 300)]
    """
    if as_count("n_folds", n_folds, 1) > n - start:
        raise ParameterError(
            f"n_folds: got {n_folds}, expected at most {n - start}, the rows that are held out"
        )
    bounds = np.linspace(start, n, n_folds + 1).round().astype(int).tolist()
    return tuple(
        Fold(begin=0 if window == "expanding" else split - start, split=split, end=end)
        for split, end in pairwise(bounds)
    )


def go_through(
    rounds: Sequence[Round],
    methods: Sequence[Candidate],
    tell: Callable[[str], None],
    *,
    n_jobs: int = 1,
    titles: bool = False,
) -> list[HeldOut]:
    """Let all candidates learn and restore in all folds; failures are kept.

    Parameters
    ----------
    rounds : sequence of Round
    methods : sequence of Candidate
    tell : callable
        Is told each piece of work before it begins.
    n_jobs : int
        Processes between which the folds are shared; results do not depend on it.
    titles : bool
        Tell titles of methods, not names.

    Raises
    ------
    ParameterError
        If a component of the state is missing in all rows to learn on, or a method cannot be sent to
        another process.
    MissingDependencyError
        If a method needs a package that is not installed.
    """
    for one in rounds:
        if not np.isfinite(one.part.x).any(axis=0).all():
            raise ParameterError(f"x: a component is missing in all {len(one.part)} rows to learn on")
    n_jobs = min(as_count("n_jobs", n_jobs, 1), len(rounds))
    if n_jobs == 1:
        return [_hold_out(one, methods, tell, titles) for one in rounds]
    try:
        pickle.dumps(methods)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ParameterError(
            f"n_jobs: got {n_jobs}, expected 1: a candidate cannot be sent to another process ({error}); "
            "functions at the top of a module can"
        ) from error
    # Not forked: threads of linear algebra and of scikit-learn do not survive that.
    context = get_context("spawn")
    told = context.SimpleQueue()
    with ProcessPoolExecutor(n_jobs, context, _listen, (told,)) as pool:
        with _one_thread_each():  # the processes begin here
            # The last folds learn on most rows and take longest: they begin first.
            futures = [pool.submit(_work, one, methods, titles) for one in reversed(rounds)]
        for future in futures:
            future.add_done_callback(lambda _: told.put(None))
        running = len(futures)
        while running:
            name = told.get()
            if name is None:
                running -= 1
            else:
                tell(name)
        return [future.result() for future in reversed(futures)]


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes that begin have one thread for linear algebra, unless somebody said how many.

    Several processes with as many threads as there are processors wait for one another most of the time.
    """
    missing = [name for name in THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(missing, "1"))
    try:
        yield
    finally:
        for name in missing:
            del os.environ[name]


#: In a process of a pool: what tells the one that waits for it of progress.
_TELL: list[Callable[[str], None]] = []


def _listen(queue: Any) -> None:
    _TELL[:] = [queue.put]


def _work(one: Round, methods: Sequence[Candidate], titles: bool) -> HeldOut:
    return _hold_out(one, methods, _TELL[0], titles)


def _hold_out(one: Round, methods: Sequence[Candidate], tell: Callable[[str], None], titles: bool) -> HeldOut:
    prefix = f"{one.name}: " if one.name else ""
    part = replace(one.part, progress=partial(_tell, tell, prefix), _learned={})
    result = HeldOut(truth=one.truth, zs=one.zs, centre=np.nanmean(part.x, axis=0))
    for method in methods:
        part.progress(method.title if titles else method.name)
        try:
            result.found[method.name] = restore(method, part, one.zs, one.clock, one.inputs)
        except MissingDependencyError:
            raise  # says nothing of the data, and what to do
        except FuzzykfError as error:
            result.failures[method.name] = str(error)
    return result


def _tell(tell: Callable[[str], None], prefix: str, name: str) -> None:
    tell(prefix + name)
