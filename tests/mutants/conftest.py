"""The tool is no test: pytest finds nothing here."""

collect_ignore_glob = ["*.py"]
