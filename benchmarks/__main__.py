"""List the benchmarks, or run one by name: `python -m benchmarks null_test`."""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path

FOLDER = Path(__file__).parent


def benchmarks() -> dict[str, str]:
    """Name -> first docstring line of every benchmark that can be run, without importing them."""
    found = {}
    for path in sorted(FOLDER.glob("*.py")):
        text = path.read_text()
        if not path.stem.startswith("_") and '__name__ == "__main__"' in text:
            found[path.stem] = (ast.get_docstring(ast.parse(text)) or "").split("\n")[0]
    return found


def main(arguments: list[str]) -> int:
    """Run the benchmark named by the first argument, with the other arguments; without a name, list all benchmarks."""
    found = benchmarks()
    if not arguments:
        print("\n".join(f"{name:<16} {text}" for name, text in found.items()))
        return 0
    if arguments[0] not in found:
        known = ", ".join(found)
        print(f"error: there is no benchmark '{arguments[0]}'; there are {known}.", file=sys.stderr)
        return 2
    sys.argv = [str(FOLDER / f"{arguments[0]}.py"), *arguments[1:]]
    runpy.run_module(f"benchmarks.{arguments[0]}", run_name="__main__", alter_sys=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
