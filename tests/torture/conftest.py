"""The harness is run by ``nox -s torture``; pytest collects nothing here."""

collect_ignore_glob = ["*.py"]
