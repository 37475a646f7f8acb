"""Which modules of fuzzykf import one another in circles, and which circles leave a package.

    python tests/architecture/import_circles.py

Counts every import: at module level, inside functions, and for types alone.  Only the façades, listed under
``ignore_imports`` in pyproject.toml, do not count: methods that lead from an object to what is built upon it.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def facades() -> set[tuple[str, str]]:
    """Pairs (importer, imported) that may point upwards."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    lines = [line for contract in settings["contracts"] for line in contract.get("ignore_imports", [])]
    return {(a, b) for a, b in (line.split(" -> ") for line in lines)}


def modules(package: Path) -> dict[str, Path]:
    """Files by the names of their modules."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = list(path.relative_to(package.parent).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(name: str, path: Path, known: dict[str, Path]) -> dict[str, list[ast.ImportFrom | ast.Import]]:
    """Modules of ``known`` that one of them imports, and where."""
    found: dict[str, list[ast.ImportFrom | ast.Import]] = {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        targets = []
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            targets = [f"{node.module}.{alias.name}" for alias in node.names]
            targets = [target if target in known else node.module for target in targets]
        for target in targets:
            if target in known and target != name:
                found.setdefault(target, []).append(node)  # type: ignore[arg-type]
    return found


def graph(package: Path, without: set[tuple[str, str]]) -> dict[str, set[str]]:
    """Which module imports which."""
    known = modules(package)
    return {
        name: {target for target in imports(name, path, known) if (name, target) not in without}
        for name, path in known.items()
    }


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Sets of modules that reach one another (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(v: str) -> None:
        index[v] = low[v] = len(index)
        stack.append(v)
        for w in sorted(edges[v]):
            if w not in index:
                visit(w)
                low[v] = min(low[v], low[w])
            elif w in stack:
                low[v] = min(low[v], index[w])
        if low[v] == index[v]:
            component = []
            while not component or component[-1] != v:
                component.append(stack.pop())
            if len(component) > 1:
                found.append(sorted(component))

    for v in sorted(edges):
        if v not in index:
            visit(v)
    return found


def package_of(module: str, known: dict[str, Path]) -> str:
    """The folder in which a module stands; that of a package itself is the package."""
    return module if known[module].name == "__init__.py" else module.rpartition(".")[0]


def main() -> int:
    """Print what was found; 1 if a circle crosses a package."""
    sys.setrecursionlimit(10_000)
    known = modules(ROOT / "fuzzykf")
    found = circles(graph(ROOT / "fuzzykf", facades()))
    crossing = [one for one in found if len({package_of(m, known) for m in one}) > 1]
    for circle in found:
        print("crosses a package" if circle in crossing else "inside a package", *circle, sep="\n  ")
    print(
        f"{len(known)} modules, {len(found)} circles of imports, {len(crossing)} of which cross a package "
        f"({len(facades())} façades left out)"
    )
    return 1 if crossing else 0


if __name__ == "__main__":
    sys.exit(main())
