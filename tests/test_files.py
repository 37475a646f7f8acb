"""Files are written whole or not at all, in place of what they were; reading ends at a limit."""

from __future__ import annotations

import gzip
import os
import stat
import subprocess
import sys
import threading
import time

import pytest

from fuzzykf import files
from fuzzykf.errors import FileFormatError, ParameterError

ROOT = hasattr(os, "geteuid") and os.geteuid() == 0
posix = pytest.mark.skipif(sys.platform == "win32", reason="modes, links and devices of POSIX")


def parts(folder):
    return [path.name for path in folder.iterdir() if path.name.endswith(files.PART)]


# --------------------------------------------------------------------------- what stands there


@posix
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o755, 0o660])
def test_a_file_that_is_replaced_keeps_its_mode(tmp_path, mode):
    path = tmp_path / "a"
    path.write_bytes(b"old")
    path.chmod(mode)
    files.write_bytes(path, b"new")
    assert (path.read_bytes(), stat.S_IMODE(path.stat().st_mode)) == (b"new", mode)


@pytest.mark.skipif(not ROOT, reason="only root gives files away")
@pytest.mark.parametrize("mode", [0o644, 0o4755])
def test_a_file_that_is_replaced_keeps_its_owner(tmp_path, mode):
    path = tmp_path / "a"
    path.write_bytes(b"old")
    os.chown(path, 1234, 4321)
    path.chmod(mode)
    files.write_bytes(path, b"new")
    found = path.stat()
    assert (found.st_uid, found.st_gid, stat.S_IMODE(found.st_mode)) == (1234, 4321, mode)


@posix
def test_an_owner_that_cannot_be_kept_takes_his_privileges_along(tmp_path, monkeypatch):
    path = tmp_path / "a"
    path.write_bytes(b"old")
    path.chmod(0o4755)

    def refuse(*args):
        raise PermissionError(1, "not permitted")

    monkeypatch.setattr(os, "chown", refuse)
    real = files._owners
    monkeypatch.setattr(files, "_owners", lambda p: (-5, -5) if p.name.endswith(files.PART) else real(p))
    files.write_bytes(path, b"new")
    assert stat.S_IMODE(path.stat().st_mode) == 0o755


@posix
def test_a_link_goes_on_pointing_to_the_file(tmp_path):
    target, link, chain = tmp_path / "below" / "a", tmp_path / "link", tmp_path / "chain"
    target.parent.mkdir()
    link.symlink_to("below/a")  # nothing there yet
    chain.symlink_to(link)
    for content in (b"first", b"second"):
        files.write_bytes(chain, content)
        assert link.is_symlink()
        assert chain.is_symlink()
        assert target.read_bytes() == content
    assert sorted(p.name for p in tmp_path.iterdir()) == ["below", "chain", "link"]


@posix
def test_a_device_is_written_to(tmp_path):
    link = tmp_path / "null"
    link.symlink_to("/dev/null")
    files.write_bytes(link, b"gone")
    assert link.is_symlink()
    assert link.is_char_device()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
def test_a_full_device_says_so_and_stays(tmp_path):
    link = tmp_path / "full"
    link.symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left") as raised:
        files.write_bytes(link, b"too much")
    assert raised.value.filename == str(link)
    assert link.is_char_device()


@posix
def test_a_pipe_is_written_to(tmp_path):
    pipe, read = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    content = bytes(range(256)) * 4096  # more than a pipe holds
    files.write_bytes(pipe, content)
    reader.join()
    assert read == [content]
    assert pipe.is_fifo()


@posix
def test_a_read_only_file_is_refused_by_name(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"old")
    path.chmod(0o444)
    with pytest.raises(PermissionError, match=r"its permissions \(mode 0444\) do not let it be written") as e:
        files.write_bytes(path, b"new")
    assert e.value.filename == str(path)
    assert path.read_bytes() == b"old"
    assert not parts(tmp_path)


def test_folders_are_refused_by_name(tmp_path):
    for path, error, message in (
        (tmp_path, IsADirectoryError, "expected a file, found a folder"),
        (tmp_path / "absent" / "a", FileNotFoundError, "there is no such folder"),
    ):
        with pytest.raises(error, match=message):
            files.write_text(path, "new")


def test_a_dash_is_standard_output(tmp_path):
    code = "from fuzzykf import files; print('before'); files.write_text({!r}, 'été\\n'); print('after')"
    for name in ("-", "/dev/stdout") if sys.platform != "win32" else ("-",):
        done = subprocess.run([sys.executable, "-c", code.format(name)], capture_output=True, cwd=tmp_path)
        assert done.stdout.decode().split() == ["before", "été", "after"], done.stderr
    with open(tmp_path / "out", "wb") as out:  # a file to which output was sent is not replaced
        subprocess.run([sys.executable, "-c", code.format(str(tmp_path / "out"))], stdout=out, check=True)
    assert (tmp_path / "out").read_text("utf-8").split() == ["before", "été", "after"]
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_dash_goes_to_whatever_stands_for_standard_output(capsys):
    files.write_text("-", "text")
    assert capsys.readouterr().out == "text"


# --------------------------------------------------------------------------- writers that were killed


def test_what_killed_writers_left_is_removed_by_the_next(tmp_path):
    path = tmp_path / "model.json"
    code = (
        "import os, signal, sys; from fuzzykf import files\n"
        "os.fsync = lambda handle: os.kill(os.getpid(), signal.SIGKILL)\n"
        "files.write_bytes(sys.argv[1], b'half')"
    )
    for _ in range(2):  # the second removes what the first has left
        subprocess.run([sys.executable, "-c", code, str(path)], check=False)
        assert len(parts(tmp_path)) == 1
    others = {".model.json.part", ".model.json.old.part", ".model.jsonabcdefgh.part", "model.json.part"}
    for name in others:
        (tmp_path / name).write_text("of somebody else")
    files.write_bytes(path, b"whole")
    assert {p.name for p in tmp_path.iterdir()} == others | {"model.json"}
    assert path.read_bytes() == b"whole"


@posix
def test_what_a_living_writer_has_begun_is_left_alone(tmp_path):
    path = tmp_path / "a"
    with files._part_of(path) as (_, part):
        files.write_bytes(path, b"other")
        assert part.exists()
    part.unlink()


def test_many_writers_of_one_file_leave_one_of_theirs(tmp_path):
    path = tmp_path / "a"
    errors = []

    def write(k):
        try:
            for _ in range(20):
                files.write_bytes(path, bytes([k]) * 10_000)
        except OSError as error:
            errors.append(error)

    writers = [threading.Thread(target=write, args=(k,)) for k in range(4)]
    for one in writers:
        one.start()
    for one in writers:
        one.join()
    assert not errors
    content = path.read_bytes()
    assert (len(content), len(set(content))) == (10_000, 1)
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_long_names_can_be_written(tmp_path):
    path = tmp_path / ("x" * 255)
    files.write_bytes(path, b"new")
    assert path.read_bytes() == b"new"


# --------------------------------------------------------------------------- limits


def test_what_is_larger_than_the_limit_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "a"
    path.write_bytes(b"x" * 1001)
    with pytest.raises(FileFormatError, match=r"holds more than 1,000 bytes.*max_bytes.*FUZZYKF_MAX_BYTES"):
        files.read_bytes(path, None, 1000)
    assert len(files.read_bytes(path, 1001, 1000)) == 1001
    monkeypatch.setenv(files.LIMIT_VARIABLE, "1001")
    assert len(files.read_bytes(path, None, 1000)) == 1001
    with pytest.raises(FileFormatError):
        files.read_bytes(path, 1000, 10**6)  # what is said in the call counts


@pytest.mark.parametrize("limit", [0, -1, 2.5, True, "7"])
def test_a_limit_is_a_whole_number(tmp_path, limit, monkeypatch):
    with pytest.raises(ParameterError, match=r"max_bytes: got .*, expected a whole number of at least 1"):
        files.read_bytes(tmp_path / "a", limit, 1000)
    if limit not in (True, "7"):
        monkeypatch.setenv(files.LIMIT_VARIABLE, str(limit))
        with pytest.raises(ParameterError, match="FUZZYKF_MAX_BYTES: got"):
            files.read_bytes(tmp_path / "a", None, 1000)


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no endless device")
def test_an_endless_device_ends(tmp_path):
    start = time.perf_counter()
    with pytest.raises(FileFormatError, match="/dev/zero: holds more than"):
        files.read_bytes("/dev/zero", None, 1 << 25)
    assert time.perf_counter() - start < 1.0


def test_what_unpacks_to_more_than_the_limit_is_refused(tmp_path):
    path = tmp_path / "a.gz"
    path.write_bytes(gzip.compress(b"\0" * (1 << 26), 9))
    assert path.stat().st_size < 1 << 20
    start = time.perf_counter()
    with pytest.raises(FileFormatError, match="holds more than"):
        files.read_bytes(path, None, 1 << 24, unpack=True)
    assert time.perf_counter() - start < 1.0
    path.write_bytes(gzip.compress(b"") * 5000)  # or to nothing, again and again
    with pytest.raises(FileFormatError, match="holds more than"):
        files.read_bytes(path, None, 1 << 16, unpack=True)


def test_what_is_packed_comes_back(tmp_path):
    path = tmp_path / "a.gz"
    content = bytes(range(256)) * 10_000
    path.write_bytes(gzip.compress(content[:100]) + gzip.compress(content[100:]) + b"\0" * 100)
    assert files.read_bytes(path, None, 1 << 24, unpack=True) == content
    path.write_bytes(gzip.compress(content)[:-9])
    with pytest.raises(EOFError):
        files.read_bytes(path, None, 1 << 24, unpack=True)
