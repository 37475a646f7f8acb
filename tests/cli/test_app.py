"""The program as a whole: help, version, and what it says without its extra."""

from __future__ import annotations

import re
import subprocess
import sys
from functools import cache

import pytest
from typer.testing import CliRunner

import fuzzykf
from fuzzykf.__main__ import main
from fuzzykf.cli.app import app


def test_without_arguments_it_shows_its_commands() -> None:
    result = CliRunner().invoke(app, [])
    assert result.exit_code != 0
    assert "compare" in result.output


def test_it_tells_its_version() -> None:
    result = CliRunner().invoke(app, ["--version"])
    assert (result.exit_code, result.output) == (0, f"fuzzykf {fuzzykf.__version__}\n")


@pytest.mark.parametrize("name", [command.name for command in app.registered_commands])
def test_the_help_of_every_command_shows_an_example(name) -> None:
    result = CliRunner().invoke(app, [name, "--help"])
    assert result.exit_code == 0
    assert f"Example: fuzzykf {name}" in result.output


def test_an_unknown_command_is_an_error() -> None:
    result = CliRunner().invoke(app, ["improve"])
    assert result.exit_code == 2
    assert "No such command 'improve'" in " ".join(result.output.split())


def test_the_module_runs_as_the_program_does() -> None:
    run = subprocess.run(
        [sys.executable, "-m", "fuzzykf", "--version"], capture_output=True, text=True, check=True
    )
    assert run.stdout == f"fuzzykf {fuzzykf.__version__}\n"


@pytest.mark.parametrize("missing", ["typer", "rich"])
def test_without_the_extra_it_says_which_one_brings_the_command_line(missing) -> None:
    code = f"import sys; sys.modules[{missing!r}] = None; from fuzzykf.__main__ import main; main()"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode != 0
    assert run.stderr.strip() == f"The command line needs {missing}: pip install 'fuzzykf[cli]'"


#: What is typed before the tab key, and what is offered.
TYPED = [
    ("fuzzykf s", {"smooth", "simulate"}),
    ("fuzzykf fit DATA --l", {"--law", "--length"}),
    ("fuzzykf fit DATA --law f", {"fmc1", "fmc2", "free", "fade"}),
    ("fuzzykf improve --l", set()),
]

#: How each shell hands over what is typed, and the form in which it reads what is offered.
SHELLS = {
    "bash": (lambda typed: {"COMP_WORDS": typed, "COMP_CWORD": str(typed.count(" "))}, r"^(.+)$"),
    "zsh": (lambda typed: {"_TYPER_COMPLETE_ARGS": typed}, r'(?:\(|^)"(.+?)"(?=:|$|\))'),
    "fish": (
        lambda typed: {"_TYPER_COMPLETE_ARGS": typed, "_TYPER_COMPLETE_FISH_ACTION": "get-args"},
        r"^([^\t\n]+)",
    ),
    "powershell": (
        lambda typed: {
            "_TYPER_COMPLETE_ARGS": typed,
            "_TYPER_COMPLETE_WORD_TO_COMPLETE": typed.rpartition(" ")[2],
        },
        r"^(.+?)(?=:::|$)",
    ),
}


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize(("typed", "offered"), TYPED)
def test_a_shell_completes_commands_options_and_choices(shell, typed, offered, monkeypatch, capsys) -> None:
    told, form = SHELLS[shell]
    env = {"COLUMNS": "80", "_FUZZYKF_COMPLETE": f"complete_{shell}", **told(typed)}
    for name, value in env.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "argv", ["fuzzykf"])
    with pytest.raises(SystemExit):
        main()
    assert set(re.findall(form, capsys.readouterr().out, re.MULTILINE)) == offered


#: Whole numbers with a least one: command, option, that number.
LEAST = [
    ("compare", "--seed", 0),
    ("compare", "--nodes", 0),
    ("fit DATA", "--regimes", 1),
    ("fit DATA", "--switches", 1),
    ("fit DATA", "--nodes", 0),
    ("fit DATA", "--starts", 1),
    ("fit DATA", "--seed", 0),
    ("fit DATA", "--max-iter", 1),
    ("fit DATA", "--harmonics", 0),
    ("fit DATA", "--order", 1),
    ("fit DATA", "--hinges", 0),
    ("filter MODEL DATA", "--nodes", 0),
    ("smooth MODEL DATA", "--nodes", 0),
    ("forecast MODEL DATA", "--nodes", 0),
    ("simulate MODEL", "-n", 1),
    ("simulate MODEL", "--seed", 0),
    ("reproduce", "--runs", 2),
    ("reproduce", "--seed", 0),
]


@cache
def help_of(command):
    return CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "200"}).output


@pytest.mark.parametrize(("command", "option", "least"), LEAST)
def test_a_number_that_is_too_small_is_refused_with_what_came(command, option, least) -> None:
    words = [*command.split(), option, str(least - 1)]
    result = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert result.exit_code == 2, result.output
    assert f"'{option}': got {least - 1}, expected a whole number of at least {least}" in result.output
    assert f"[x>={least}]" in help_of(command.split()[0])
