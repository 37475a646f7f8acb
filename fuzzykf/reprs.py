"""How objects show themselves: short, without an address, and never with an error.

`reprs` decorates a class whose attributes say what it is; `shown` guards a ``__repr__`` that is
written by hand; `text_table` and `html_table` are for what has rows.
"""

from __future__ import annotations

import dataclasses
import html
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from fuzzykf.texts import printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

__all__ = ["call_text", "fitted", "html_table", "reprs", "shown", "shown_html", "text_table", "value_text"]

T = TypeVar("T")

#: No repr has more lines, or longer ones.
LINES, WIDTH = 30, 100

#: Longest text of one value among others, most numbers of an array that are shown, and most entries.
LONGEST, NUMBERS, ENTRIES = 60, 9, 4

#: Whole numbers of more bits are not written out: Python itself refuses those of thousands of digits.
BITS = 200


def cut(text: str, most: int) -> str:
    """Return text on one line, of no more than so many characters, that says nothing to a terminal.

    Examples
    --------
    >>> cut("a name without end", 10)
    'a name ...'
    """
    text = printable(text[: most + 1])
    return text if len(text) <= most else f"{text[: most - 3]}..."


def value_text(value: Any, most: int = LONGEST) -> str:
    """Return one value as a repr shows it among others: as it is if short, else what it is.

    Examples
    --------
    >>> import numpy as np
    >>> value_text(np.eye(2)), value_text(np.zeros((300, 1))), value_text(len)
    ('[[1., 0.], [0., 1.]]', 'array (300, 1)', 'len')
    """
    try:
        return cut(_value_text(value, most), most)
    except Exception:  # an object of somebody else may do anything; what holds it is shown all the same
        return type(value).__name__


def _value_text(value: Any, most: int) -> str:
    if isinstance(value, np.generic):
        value = value.item() if value.dtype.kind in "biuf" else str(value)
    if value is None or isinstance(value, bool):
        return repr(value)
    if isinstance(value, int):
        return repr(int(value)) if value.bit_length() <= BITS else f"an integer of {value.bit_length()} bits"
    if isinstance(value, float):
        return f"{value:.8g}" if value % 1.0 or abs(value) >= 1e8 else repr(float(value))
    if isinstance(value, str):
        return repr(cut(str(value), most - 2))
    if isinstance(value, np.ndarray):
        return _array_text(value, most)
    if isinstance(value, (tuple, list, set, frozenset, dict)):
        return _entries_text(value, most)
    if callable(value) and isinstance(getattr(value, "__name__", None), str):  # functions and classes
        return str(getattr(value, "__qualname__", value.__name__)).rpartition("<locals>.")[2]
    if isinstance(getattr(value, "shape", None), tuple):
        return f"{type(value).__name__} {value.shape}"
    if type(value).__module__.partition(".")[0] == "fuzzykf":
        text = repr(value)
        return text if len(text) <= most and "\n" not in text else f"{type(value).__name__}(...)"
    return type(value).__name__  # whose own repr may be long, or an address


def _array_text(value: np.ndarray, most: int) -> str:
    if value.dtype.kind in "biufc" and value.size <= NUMBERS:
        text = np.array2string(np.asarray(value), separator=", ", max_line_width=10 * WIDTH)
        text = " ".join(text.split()).replace("[ ", "[").replace(" ,", ",").replace(" ]", "]")
        if len(text) <= most:
            return text
    return f"array {value.shape}"


def _entries_text(value: Any, most: int) -> str:
    kind = type(value).__name__
    if len(value) > ENTRIES or isinstance(value, (set, frozenset)):
        return f"{kind} of {len(value)}"
    flat = value.values() if isinstance(value, dict) else value
    if any(isinstance(entry, (tuple, list, set, frozenset, dict)) for entry in flat):  # may hold itself
        return f"{kind} of {len(value)}"
    if isinstance(value, dict):
        text = "{" + ", ".join(f"{value_text(k)}: {value_text(v)}" for k, v in value.items()) + "}"
    else:
        inner = ", ".join(map(value_text, value))
        text = f"[{inner}]" if isinstance(value, list) else f"({inner}{',' * (len(value) == 1)})"
    return text if len(text) <= most else f"{kind} of {len(value)}"


def call_text(shown_object: object, *names: str, **values: Any) -> str:
    """Return ``Class(name=value, ...)``, of the attributes that there are and of further values.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> call_text(SimpleNamespace(a=1.0, b=None), "a", "b", "c")
    'SimpleNamespace(a=1.0, b=None)'
    """
    kind = type(shown_object).__name__
    found = {}
    for name in names:
        try:
            found[name] = getattr(shown_object, name)
        except Exception:  # not built to the end: what there is, is shown
            continue
    found |= values
    if names and not found:
        return not_built(kind)
    return fitted(f"{kind}({', '.join(f'{name}={value_text(value)}' for name, value in found.items())})")


def not_built(kind: str) -> str:
    """Return what stands for an object whose constructor failed, or has yet to run.

    Examples
    --------
    >>> not_built("KalmanFilter")
    '<KalmanFilter that is not built>'
    """
    return f"<{kind} that is not built>"


def fitted(text: str) -> str:
    r"""Return text of no more than `LINES` lines, each of no more than four times `WIDTH`.

    Examples
    --------
    >>> len(fitted("line\n" * 1000).splitlines())
    30
    """
    lines = text.rstrip("\n").split("\n", 50 * LINES)
    if len(lines) > LINES:
        lines = [*lines[: LINES - 1], f"... and {len(lines) - LINES + 1} lines more"]
    return "\n".join(cut(line, 4 * WIDTH) for line in lines)


def shown(make: Callable[[Any], str]) -> Callable[[Any], str]:
    """Decorate a ``__repr__``: what fails shows an object that is not built; what is long is cut.

    A debugger, a log or a traceback shows objects in any state; there a repr that raises hides the
    very error that is looked for.
    """

    @wraps(make)
    def guarded(self: Any) -> str:
        try:
            return fitted(make(self))
        except Exception:  # see above
            return not_built(type(self).__name__)

    return guarded


def shown_html(make: Callable[[Any], str]) -> Callable[[Any], str]:
    """Decorate a ``_repr_html_``: what fails shows an object that is not built."""

    @wraps(make)
    def guarded(self: Any) -> str:
        try:
            return make(self)
        except Exception:  # as above
            return html.escape(not_built(type(self).__name__))

    return guarded


def reprs(*names: str) -> Callable[[type[T]], type[T]]:
    """Decorate a class: its repr is ``Class(name=value, ...)`` of these attributes.

    Parameters
    ----------
    *names : str
        Attributes, which nothing has to be computed for.  By default the fields of a dataclass or a
        named tuple that their repr has.

    Examples
    --------
    >>> import numpy as np
    >>> from typing import NamedTuple
    >>> @reprs()
    ... class Series(NamedTuple):
    ...     x: object
    ...     n: int
    >>> Series(np.zeros((5000, 2)), 3)
    Series(x=array (5000, 2), n=3)
    """

    def decorate(cls: type[T]) -> type[T]:
        found = names or getattr(cls, "_fields", None)
        if found is None:
            found = tuple(one.name for one in dataclasses.fields(cls) if one.repr)  # type: ignore[arg-type]

        def __repr__(self: object) -> str:
            return call_text(self, *found)

        __repr__.__qualname__ = f"{cls.__qualname__}.__repr__"
        cls.__repr__ = __repr__  # type: ignore[method-assign]
        return cls

    return decorate


# --------------------------------------------------------------------------- tables


def text_table(header: Sequence[str], rows: Iterable[Sequence[str]], indent: str = "  ") -> list[str]:
    r"""Return the lines of a table: the first column to the left, numbers to the right.

    Examples
    --------
    >>> print("\n".join(text_table(("name", "RMSE"), [("kalman", "1.5"), ("imm", "12")])))
      name    RMSE
      kalman   1.5
      imm       12
    """
    cells = [[cut(cell, 40) for cell in row] for row in (header, *rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        (
            indent
            + "  ".join(
                cell.rjust(width) if k else cell.ljust(width)
                for k, (cell, width) in enumerate(zip(row, widths, strict=True))
            )
        ).rstrip()
        for row in cells
    ]


def html_table(
    title: str, header: Sequence[str], rows: Iterable[Sequence[str]], notes: Iterable[str] = ()
) -> str:
    """Return a small table for a notebook; all text is escaped.

    Examples
    --------
    >>> "<b>" in html_table("<b>", ("name",), [("x",)])
    False
    """

    def escaped(text: str) -> str:
        return html.escape(printable(text))

    lines = ["<table>", f"<caption>{escaped(title)}</caption>"]
    if header:
        lines.append(f"<tr>{''.join(f'<th>{escaped(name)}</th>' for name in header)}</tr>")
    lines += [f"<tr>{''.join(f'<td>{escaped(cell)}</td>' for cell in row)}</tr>" for row in rows]
    lines.append("</table>")
    lines += [f"<p>{escaped(note)}</p>" for note in notes]
    return "\n".join(lines)
