"""How many lines of code there are, docstrings and comments not counted.

python tests/architecture/lines_of_code.py [FOLDER]
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from pathlib import Path

ROOT = Path(__file__).parents[2]
SILENT = (
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
)


def lines_of_code(path: Path) -> int:
    """Lines of a file that hold code."""
    source = path.read_text(encoding="utf-8")
    silent: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                silent.update(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    code: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in SILENT:
            code.update(range(token.start[0], token.end[0] + 1))
    return len(code - silent)


def main() -> None:
    """Print the sum by folder, and the longest files."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "fuzzykf"
    counts = {path: lines_of_code(path) for path in sorted(folder.rglob("*.py"))}
    parts: dict[str, int] = {}
    for path, count in counts.items():
        part = path.relative_to(folder).parts[0]
        parts[part] = parts.get(part, 0) + count
    for part, count in sorted(parts.items(), key=lambda item: -item[1]):
        print(f"{count:7,} {part}")
    print(f"{sum(counts.values()):7,} in all; the longest files:")
    for path in sorted(counts, key=lambda path: -counts[path])[:10]:
        print(f"{counts[path]:7,} {path.relative_to(folder)}")


if __name__ == "__main__":
    main()
