"""Check with mypy what users write: ``python tests/typing``.

It takes half a minute where mypy has no cache, so that it goes with the types (``nox -s types``) and not
with the tests.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from mypy import api

HERE = Path(__file__).parent


def complaints(name: str) -> dict[int, str]:
    """What mypy, strictly, says of each line of a file."""
    found, trouble, _ = api.run(["--strict", "--no-error-summary", "--hide-error-context", str(HERE / name)])
    if trouble:
        raise SystemExit(trouble)
    lines: dict[int, str] = {}
    for line in found.splitlines():
        match = re.match(rf".*{re.escape(name)}:(\d+): error: (.*)", line)
        if match:
            lines[int(match[1])] = match[2]
        elif ": error:" in line:
            raise SystemExit(line)
    return lines


def main() -> int:
    """Print what is wrong; 0 if nothing is."""
    wrong = [f"accepted.py:{number}: {text}" for number, text in complaints("accepted.py").items()]
    refused, said = complaints("refused.py"), (HERE / "refused.py").read_text(encoding="utf-8").splitlines()
    expected = {number for number, line in enumerate(said, 1) if line.endswith("# refused")}
    assert expected
    wrong += [f"refused.py:{number}: accepted" for number in sorted(expected - refused.keys())]
    wrong += [f"refused.py:{number}: {refused[number]}" for number in sorted(refused.keys() - expected)]
    print("\n".join(wrong) or f"as expected: {len(expected)} lines refused")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
