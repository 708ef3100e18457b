"""Which part of the package imports which: the matrix in docs/architecture.md.

    python docs/import_matrix.py [src/ematwin]

Rows import columns; the number says how many modules of the row do so. Parts stand in their order,
lowest last: a mark below the diagonal is an import upwards. Imports inside functions count; those
for type checkers do not.
"""

import ast
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

ORDER = (
    "cli", "bench", "testing", "benchmarking", "report", "exploring", "plots", "monitoring",
    "estimation", "models", "models.bldc", "models.ball_screw", "models.linear_axis", "models.pmsm",
    "recordings", "optimizers", "numerics",
    "files", "quantities", "validation", "showing", "errors",
)  # fmt: skip


def parts_of(package: Path, order: Sequence[str]) -> dict[str, dict[str, set[str]]]:
    """Part to part that it imports to the modules that do so."""
    found: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for path in sorted(package.rglob("*.py")):
        module = ".".join(path.relative_to(package).with_suffix("").parts)
        own = _part(module, order)
        for target in _imports(ast.parse(path.read_text(encoding="utf-8"))):
            other = _part(target, order)
            if own and other and own != other:
                found[own][other].add(module)
    return found


def matrix(package: Path, order: Sequence[str] = ORDER) -> str:
    """The matrix as text."""
    found = parts_of(package, order)
    width = max(map(len, order))
    lines = [" " * (width + 4) + "".join(f"{n + 1:>4}" for n in range(len(order)))]
    for n, row in enumerate(order):
        cells = "".join(
            "   \\" if row == column else f"{len(found[row][column]) or '.':>4}" for column in order
        )
        lines.append(f"{n + 1:>2}  {row:<{width}}{cells}")
    return "\n".join(lines)


def _part(module: str, order: Sequence[str]) -> str | None:
    """The most particular part that a module belongs to."""
    names = [name for name in order if module == name or module.startswith(f"{name}.")]
    return max(names, key=len) if names else None


def _imports(tree: ast.AST) -> Iterator[str]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ematwin."):
            base = str(node.module).removeprefix("ematwin.")
            yield from (f"{base}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.startswith("ematwin."):
                    yield alias.name.removeprefix("ematwin.")
        else:
            yield from _imports(node)


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "src/ematwin"
    names = sys.argv[2].split(",") if len(sys.argv) > 2 else ORDER
    print(matrix(folder, names))
