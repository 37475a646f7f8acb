"""Errors that can be mended are reported, not traced; a folder is checked before any work."""

from __future__ import annotations

import os
import warnings

import pytest
import typer

from fuzzykf.cli import output
from fuzzykf.errors import HindsightWarning, ParameterError


def test_a_file_in_the_place_of_the_folder_is_refused_before_any_work(tmp_path) -> None:
    (tmp_path / "taken").write_text("")
    for folder in (tmp_path / "taken", tmp_path / "taken" / "below"):
        with pytest.raises(NotADirectoryError, match="expected a folder, found a file"):
            output.check_folder(folder)
    output.check_folder(tmp_path / "new" / "one")
    assert not (tmp_path / "new").exists()


def test_a_folder_that_is_not_writable_is_refused_before_any_work(tmp_path, monkeypatch) -> None:
    asked = []
    monkeypatch.setattr(output.os, "access", lambda path, mode: asked.append((path, mode)))
    with pytest.raises(PermissionError, match="the folder is not writable"):
        output.check_folder(tmp_path / "new")
    assert asked == [(tmp_path, os.W_OK)]


def test_errors_that_can_be_mended_end_with_a_message_and_exit_code_1(capsys) -> None:
    with pytest.raises(typer.Exit) as exit_, output.report_errors():
        raise ParameterError("column '[bold]' is not there")
    assert exit_.value.exit_code == 1
    # Brackets are text, not rich's markup.
    assert capsys.readouterr().err == "Error: column '[bold]' is not there\n"


def test_an_error_of_the_program_itself_is_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError), output.report_errors():
        _ = 1 / 0


@pytest.mark.filterwarnings("always")
def test_warnings_of_fuzzykf_are_notes_on_one_line_and_once_each(capsys) -> None:
    def warn() -> None:
        for _ in range(2):
            warnings.warn("later observations\nmove the states", HindsightWarning, stacklevel=1)
        warnings.warn_explicit("of no class of fuzzykf", UserWarning, output.__file__, 1)
        warnings.warn("of others", RuntimeWarning, stacklevel=1)

    with pytest.warns(RuntimeWarning, match="of others"):
        output.report_errors()(warn)()
    told = capsys.readouterr()
    assert told.err == "Note: later observations move the states.\nNote: of no class of fuzzykf.\n"
    assert told.out == ""


@pytest.mark.filterwarnings("always")
def test_what_was_to_be_noted_is_told_before_an_error(capsys) -> None:
    def fail() -> None:
        warnings.warn("lost", HindsightWarning, stacklevel=1)
        raise ParameterError("wrong")

    with pytest.raises(typer.Exit):
        output.report_errors()(fail)()
    assert capsys.readouterr().err == "Note: lost.\nError: wrong\n"


def test_names_say_nothing_to_the_terminal(capsys) -> None:
    with pytest.raises(typer.Exit), output.report_errors():
        raise ParameterError("a\x1b[2Jb has no column c\x07")
    assert capsys.readouterr().err == "Error: a\\x1b[2Jb has no column c\\x07\n"
    output.say(output.Console(), "Read a\x1b[2Jb")
    assert capsys.readouterr().out == "Read a\\x1b[2Jb\n"


def test_a_reader_who_leaves_is_no_error_to_report(capsys) -> None:
    with pytest.raises(BrokenPipeError), output.report_errors():
        raise BrokenPipeError(32, "Broken pipe")
    assert capsys.readouterr().err == ""


def test_files_are_checked_before_any_work(tmp_path) -> None:
    there = tmp_path / "there.csv"
    there.write_text("a\n1\n")
    output.check_file(there)
    output.check_file(tmp_path / "new.csv", there)
    with pytest.raises(ParameterError, match=r"-o: .*is also read from"):
        output.check_file(there, there, option="-o")
    for path, error, message in (
        (tmp_path, IsADirectoryError, "expected a file, found a folder"),
        (tmp_path / "absent" / "a", FileNotFoundError, "there is no such folder"),
        (there / "a", FileNotFoundError, "there is no such folder"),
    ):
        with pytest.raises(error, match=message):
            output.check_file(path)
    there.chmod(0o444)
    with pytest.raises(PermissionError, match="0444"):
        output.check_file(there)
