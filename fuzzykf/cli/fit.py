"""``fuzzykf fit``: learn a switching model from a file, with a hidden switch."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from fuzzykf.cli.columns import Rows, read_rows
from fuzzykf.cli.inputs import AskedInputs
from fuzzykf.cli.law import law_of_words
from fuzzykf.cli.learn import (
    Form,
    Kind,
    Objective,
    judge_filter,
    learn_pairwise,
    learn_state_space,
    told_rows,
)
from fuzzykf.cli.output import (
    check_file,
    console_beside,
    progress_bar,
    report_errors,
    say,
    say_written,
    whole_option,
)
from fuzzykf.cli.reading import Decimal, Reading, Sep, Time, TimeFormat
from fuzzykf.cli.stuck import notes_of_rows
from fuzzykf.cli.window import (
    Blocks,
    Clock,
    FeaturesOption,
    Harmonics,
    Hinges,
    Inputs,
    Order,
    Products,
    Window,
    lines_of_inputs,
)
from fuzzykf.errors import ParameterError
from fuzzykf.estimation import LikelihoodFit
from fuzzykf.steps import find_steps
from fuzzykf.switching.laws.registry import learned_laws
from fuzzykf.texts import counted, listed

if TYPE_CHECKING:
    from rich.console import Console

    from fuzzykf.results import FitResult

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: fuzzykf fit meters.csv --state demand --obs temperature --train 0.7 -o model.json"

#: What stands between a column and its unit.
EQUALS = "="


if TYPE_CHECKING:

    class Law(StrEnum):
        """Family of the law of a fuzzy switch."""

else:
    Law = StrEnum("Law", {name.upper(): name for name in learned_laws()})


def command(
    data: Annotated[
        Path,
        typer.Argument(
            metavar="DATA.csv",
            help="CSV file with column names in the first line. Rows are in time order, at equal "
            "steps; empty cells are missing values.",
        ),
    ],
    state: Annotated[
        list[str] | None,
        typer.Option(
            "--state", metavar="COL", help="Column of the state; may be repeated.", show_default=False
        ),
    ] = None,
    obs: Annotated[
        list[str] | None,
        typer.Option(
            "--obs", metavar="COL", help="Column of the observation; may be repeated.", show_default=False
        ),
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option(
            "--unit",
            metavar="COL=UNIT",
            help="Unit of a state or observation column, stored in the model; may be repeated.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="FILE", help="File for the model (JSON); - is standard output."
        ),
    ] = Path("model.json"),
    kind: Annotated[
        Kind,
        typer.Option(
            "--model",
            help="pairwise: model of state and observation with an exact filter. ssm: state-space "
            "model with one state equation and a sensor per class; each observation corrects the "
            "state. States may be missing in part.",
        ),
    ] = Kind.PAIRWISE,
    law: Annotated[
        Law | None,
        typer.Option(
            help="Law of a fuzzy switch between two classes. Default: fmc1, or fade with --model ssm.",
            show_default=False,
        ),
    ] = None,
    fades: Annotated[
        str | None,
        typer.Option(
            "--fades",
            metavar="A-B,...",
            help="Fades between any number of classes: 0-1,1-2,2-0 is a ring of three. If the fades "
            "do not determine it, classes are numbered by the mean of the first observation.",
            show_default=False,
        ),
    ] = None,
    jumps: Annotated[
        str | None,
        typer.Option(
            "--jumps", metavar="A-B,...", help="Jumps, in addition to --fades or --edges.", show_default=False
        ),
    ] = None,
    edges: Annotated[
        str | None,
        typer.Option(
            "--edges",
            metavar="A-B,...",
            help="Pairs of classes between which the switch moves gradually in both directions (law graph).",
            show_default=False,
        ),
    ] = None,
    stay: Annotated[
        float | None,
        typer.Option(
            metavar="STEPS",
            help="Initial mean number of steps at a class, for fades. Default: 50.",
            show_default=False,
        ),
    ] = None,
    length: Annotated[
        float | None,
        typer.Option(
            metavar="STEPS",
            help="Initial mean number of steps of a fade. Default: 10.",
            show_default=False,
        ),
    ] = None,
    regimes: Annotated[
        int | None,
        whole_option(
            1,
            metavar="K",
            help="Learn K hard regimes instead of a fuzzy switch.",
            show_default=False,
        ),
    ] = None,
    switches: Annotated[
        int | None,
        whole_option(1, metavar="K", help="Another name of --regimes.", show_default=False),
    ] = None,
    form: Annotated[
        Form,
        typer.Option(
            help="Form of the Gaussian part. covariance: that of the paper, for one state and one "
            "observation. auto: learn both, keep the one with the smaller BIC."
        ),
    ] = Form.AUTO,
    objective: Annotated[
        Objective,
        typer.Option(
            help="Objective. joint: likelihood of state and observation. filter: log score of the "
            "state under the filter, with the last fifth of the states for validation; the joint fit "
            "is kept unless the filter fit is better there."
        ),
    ] = Objective.JOINT,
    state_feedback: Annotated[
        bool,
        typer.Option(
            "--state-feedback/--no-state-feedback",
            help="Whether the state may depend on the previous state. Without, the filter cannot "
            "drift, and single measured states are enough.",
        ),
    ] = True,
    inputs: Inputs = None,
    clock: Clock = False,
    harmonics: Harmonics = None,
    order: Order = 1,
    blocks: Blocks = None,
    hinges: Hinges = 0,
    products: Products = False,
    features: FeaturesOption = None,
    nodes: Annotated[
        int | None,
        whole_option(
            0,
            help="Number of nodes between two classes. Default: 5, or as many as fades have room "
            "for. A learned fade is not shorter.",
            show_default=False,
        ),
    ] = None,
    train: Annotated[
        float,
        typer.Option(
            metavar="FRACTION",
            help="Share of the rows used for training; the others test the filter.",
        ),
    ] = 1.0,
    starts: Annotated[
        int, whole_option(1, help="Number of initial guesses of the switch; beyond 4 they are random.")
    ] = 4,
    seed: Annotated[int, whole_option(0, help="Seed of the random starts.")] = 0,
    max_iter: Annotated[int, whole_option(1, help="Largest number of iterations.")] = 500,
    tolerance: Annotated[
        float, typer.Option(help="Stop when an iteration gains less than this in log-likelihood per row.")
    ] = 1e-6,
    time: Time = None,
    time_format: TimeFormat = None,
    sep: Sep = None,
    decimal: Decimal = None,
) -> None:
    """Learn a switching model from rows with measured state, and write it to a file.

    The switch is hidden and learned with the parameters, by maximum likelihood. Prints the quality of fit,
    and warns about what the data do not support. The model stores column names and time step.
    """
    with report_errors():
        units = _units(unit or [], [*(state or []), *(obs or [])])
        columns = {"--state": state or [], "--obs": obs or []}
        told = AskedInputs(inputs or [], clock, harmonics)
        window = Window(order, blocks, hinges, products, features)
        told.check()
        further = window.options(has_inputs=bool(told), objective=objective.value)
        rows = read_rows(data, columns, None, Reading(time, time_format, sep, decimal), inputs=told)
        if regimes is not None and switches is not None and regimes != switches:
            raise ParameterError(
                f"--regimes, --switches: got {regimes} and {switches}, two names of the number of regimes; "
                "give one of them"
            )
        start = law_of_words(None if law is None else law.value, fades, jumps, edges, stay, length)
        if (law is not None or start != "fmc1") and (regimes is not None or switches is not None):
            given = "--fades and --edges are" if law is None else f"--law {law.value} is a law"
            asked = f"--switches {switches}" if regimes is None else f"--regimes {regimes}"
            raise ParameterError(
                f"{given} of a fuzzy switch, {asked} asks for hard regimes; give one of them"
            )
        if not 0.0 < train <= 1.0:
            raise ParameterError(
                f"--train: got {train:g}, expected a share of the rows, above 0 and at most 1"
            )
        if kind == Kind.SSM and form != Form.AUTO:
            raise ParameterError(f"--form: got {form.value}, which goes with --model pairwise alone")
        if kind == Kind.SSM and (objective != Objective.JOINT or not state_feedback):
            given = f"--objective: got {objective.value}" if state_feedback else "--no-state-feedback: given"
            raise ParameterError(f"{given}, which goes with --model pairwise alone")
        if kind == Kind.SSM and (told or window):
            raise ParameterError(
                "--inputs, --clock, --order, --blocks, --hinges, --products, --features: given, but they go "
                "with --model pairwise alone"
            )
        check_file(output, data)
        n_train = round(train * len(rows))
        options: dict[str, Any] = {
            "form": form.value,
            "n_starts": starts,
            "max_iter": max_iter,
            "tolerance": tolerance,
            "rng": np.random.default_rng(seed),
        }
        with progress_bar(None) as progress:
            progress("learning")
            hard = switches if regimes is None else regimes
            fit: FitResult[Any]
            if kind == Kind.SSM:
                begin = None if law is None and start == "fmc1" else start
                fit = learn_state_space(rows, n_train, begin, hard, nodes, options)
            else:
                options |= {"objective": objective.value, "state_feedback": state_feedback} | further
                fit = _learn(rows, n_train, start, hard, nodes, options)
            progress("testing")
            tested = judge_filter(rows, n_train, fit, nodes, kind)
        step = None if rows.times is None else find_steps(rows.times).step
        model = fit.model.labelled(states=state, observations=obs, units=units, step=step)
        model.save(output)
    console = console_beside(output)
    _print(console, rows, n_train, replace(fit, model=model), tested)
    say_written(console, output)


def _learn(rows: Rows, *arguments: Any) -> FitResult[Any]:
    """Learn a pairwise model; errors name options of the command line."""
    try:
        return learn_pairwise(rows, *arguments)
    except ParameterError as error:
        raise ParameterError(str(error).replace("state_feedback=False", "--no-state-feedback")) from error


def _units(given: list[str], columns: list[str]) -> dict[str, str]:
    """Return units by column."""
    found: dict[str, str] = {}
    for word in given:
        column, equals, name = word.rpartition(EQUALS)
        if not equals or not name:
            raise ParameterError(f"--unit: got {word!r}, expected COL=UNIT, such as demand=GW")
        if column not in columns:
            raise ParameterError(
                f"--unit: got one of {column!r}, expected a column of --state or --obs: {listed(columns)}"
            )
        if column in found:
            raise ParameterError(f"--unit: got {found[column]!r} and {name!r} for {column!r}, expected one")
        found[column] = name
    return found


def _print(
    console: Console,
    rows: Rows,
    n_train: int,
    fit: FitResult[Any],
    tested: tuple[str, tuple[str, ...]],
) -> None:
    model = fit.model
    labels = model.labels
    state, obs = (map(labels.with_unit, names) for names in (labels.states, labels.observations))
    iterations = counted(len(fit.trace) - 1, "iteration")
    lines = [
        f"Learned {', '.join(state)} from {', '.join(obs)}, on {told_rows(rows, n_train, fit)}.",
        f"Model: {model.describe_switch()}; {model.form.kind} form, {fit.n_parameters} parameters.",
        f"{'Converged' if fit.converged else 'Stopped'} after {iterations}.",
        f"log-likelihood {fit.log_likelihood:.2f} ({fit.log_likelihood / fit.n_observations:.4f} per row), "
        f"AIC {fit.aic:.1f}, BIC {fit.bic:.1f}, p_hard {model.p_hard:.4g}.",
    ]
    if fit.training is not None:
        training = fit.training
        lines.append(
            f"Kept the {training.kept} fit: log score {training.score_filter:.4g} for the filter fit and "
            f"{training.score_joint:.4g} for the joint fit on {training.n_kept_back:,} validation states "
            f"(standard error of the difference {training.standard_error:.2g})."
        )
    lines += lines_of_inputs(fit)
    numbers = model.named_parameters() if hasattr(model, "named_parameters") else {}
    numbers = {name: value for name, value in numbers.items() if name != "p_hard"}
    if numbers:
        lines.append(f"Law: {', '.join(f'{name} {value:.4g}' for name, value in numbers.items())}.")
    if isinstance(fit, LikelihoodFit):
        errors = fit.standard_errors
        told = (f"{name} {value:.4g} ({errors[name]:.2g})" for name, value in fit.estimates.items())
        lines.append(f"Estimates, with standard errors: {', '.join(told)}.")
    result, notes = tested
    if result:
        lines.append(result)
    lines += [f"Note: {note}." for note in (*rows.notes, *notes_of_rows(rows, labels), *notes)]
    for line in lines:
        say(console, line)
