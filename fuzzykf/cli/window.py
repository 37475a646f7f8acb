"""What ``fuzzykf fit`` is asked for beside the latest observation: inputs, and features of the window."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fuzzykf.cli.inputs import HARMONICS
from fuzzykf.cli.output import whole_option
from fuzzykf.errors import ParameterError

if TYPE_CHECKING:
    from fuzzykf.results import FitResult

__all__ = [
    "Blocks",
    "Clock",
    "Features",
    "FeaturesOption",
    "Harmonics",
    "Hinges",
    "Inputs",
    "Order",
    "Products",
    "Window",
    "lines_of_inputs",
]


class Features(StrEnum):
    """How the map of the window is found."""

    AUTO = "auto"


Inputs = Annotated[
    list[str] | None,
    typer.Option(
        "--inputs",
        metavar="COL,...",
        help="Columns of known inputs; no cell may be empty. May be repeated.",
        show_default=False,
    ),
]
Clock = Annotated[
    bool,
    typer.Option(
        "--clock",
        help="Use hour and working day (column workday, else Monday to Friday) as inputs. The other "
        "commands compute them from the times, without an option.",
    ),
]
Harmonics = Annotated[
    int | None,
    whole_option(
        0,
        help=f"Number of daily harmonics, with --clock. Default: {HARMONICS}. 0: working days only.",
        show_default=False,
    ),
]
Order = Annotated[
    int,
    whole_option(1, metavar="L", help="Number of lagged observations in the equations."),
]
Blocks = Annotated[
    str | None,
    typer.Option(
        "--blocks",
        metavar="N,...",
        help="Lengths of blocks of older observations, whose means are used: 3,6,12.",
        show_default=False,
    ),
]
Hinges = Annotated[
    int,
    whole_option(
        0,
        help="Number of knots, at quantiles of the observation, of a piecewise-linear dependence "
        "on it; 0: none.",
    ),
]
Products = Annotated[bool, typer.Option("--products", help="Add the products of inputs and observation.")]
FeaturesOption = Annotated[
    Features | None,
    typer.Option(
        "--features",
        help="auto: try none, lags, hinges, both, and both with products; keep the best log score on "
        "validation rows. Needs --objective filter.",
        show_default=False,
    ),
]


@dataclass(frozen=True)
class Window:
    """Features of the window of observations, as they are asked for."""

    order: int = 1
    blocks: str | None = None
    hinges: int = 0
    products: bool = False
    features: Features | None = None

    def __bool__(self) -> bool:
        """Whether anything is asked for."""
        return self != Window()

    def options(self, *, has_inputs: bool, objective: str) -> dict[str, Any]:
        """Return what `CGOFMSModel.fit` is told.

        Raises
        ------
        ParameterError
            Names the option.
        """
        from fuzzykf import WindowFeatures

        others = {"--blocks": self.blocks, "--hinges": self.hinges, "--products": self.products}
        if self.features is not None:
            asked = [option for option, value in others.items() if value]
            if asked:
                raise ParameterError(f"--features: got auto beside {asked[0]}; give one of them")
            if objective != "filter":
                raise ParameterError(
                    "--features: got auto with --objective joint, whose likelihood rises with every feature; "
                    "expected --objective filter"
                )
            return {"order": self.order, "features": "auto"}
        if self.products and not has_inputs:
            raise ParameterError("--products: given without inputs; expected --inputs or --clock with it")
        if not any(others.values()):
            return {"order": self.order}
        features = WindowFeatures(
            order=self.order, blocks=self._lengths(), hinges=self.hinges, products=self.products
        )
        return {"features": features}

    def _lengths(self) -> tuple[int, ...]:
        words = [] if self.blocks is None else [word.strip() for word in self.blocks.split(",")]
        for word in words:
            if not (word.isascii() and word.isdigit() and int(word) > 0):
                raise ParameterError(
                    f"--blocks: got {word!r}, expected whole numbers above 0, such as 3,6,12"
                )
        return tuple(map(int, words))


def lines_of_inputs(fit: FitResult[Any]) -> list[str]:
    """Say which inputs and features a model was learned with, and how others scored."""
    form = fit.model.form
    facts = dict(form.facts()) if hasattr(form, "facts") else {}
    lines = [f"Inputs: {facts['inputs']}."] if "inputs" in facts else []
    lines += [f"Features: {_without_name(facts['features'])}."] if "features" in facts else []
    if fit.score_of_features:
        told = (f"{_without_name(one)} {score:.4g}" for one, score in fit.score_of_features.items())
        lines.append(f"Log score on validation states, by features: {'; '.join(told)}.")
    return lines


def _without_name(features: str) -> str:
    """Return what a map has, in few words.

    Examples
    --------
    >>> (
    ...     _without_name("WindowFeatures(order=3, hinges=2)"),
    ...     _without_name("WindowFeatures()"),
    ... )
    ('order=3, hinges=2', 'none')
    """
    return features.removeprefix("WindowFeatures(").removesuffix(")") or "none"
