"""Figures of the source tree: files, lines, folders, imports, dataclasses, and frames down to the first factorisation.

``python benchmarks/structure.py [PACKAGE_FOLDER]`` counts any Python package, so that peers can stand beside cmsreduce.
``--frames`` also runs two small reductions, one from the command line's entry point and one from Python, each in an
interpreter of its own, and counts the frames on the stack when the first sparse matrix is factorised: from the module
that is run to the constructor of the factor, click's included.
"""

from __future__ import annotations

import ast
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

# Prints the functions on the stack, outermost first, when the first factor is made, and ends.
HOOK = """
import sys
from cmsreduce.linalg.sparse import pardiso, superlu

def watched(kind):
    def constructor(self, *arguments, **options):
        frame, names = sys._getframe(1), [kind.__name__]
        while frame is not None:
            names.append(f"{frame.f_globals.get('__name__')}.{frame.f_code.co_name}")
            frame = frame.f_back
        print("\\n".join(reversed(names)))
        sys.stdout.flush()
        raise SystemExit
    kind.__init__ = constructor

watched(pardiso.Pardiso)
watched(superlu.SuperLU)
"""
COMMAND = """
from cmsreduce.cli import main
main(["run", "pipelines/hub_beams.yaml", "--out", OUT, "--quiet"])
"""
PYTHON = """
import cmsreduce as cms
sample = "sample_models/hub_beams/right"
body = cms.read_body("right", stiffness=(f"{sample}.op4", "KFF"), mass=(f"{sample}.op4", "MFF"),
                     geometry=f"{sample}.bdf", interfaces={"hinge": 101})
cms.CraigBampton(cutoff_hz=20).reduce(body)
"""


def sources(package: Path) -> list[Path]:
    """Python files of a package, those of its tests left out."""
    return sorted(
        path for path in package.rglob("*.py") if not {"tests", "test"} & set(path.relative_to(package).parts)
    )


def docstrings(tree: ast.Module) -> Iterator[ast.stmt]:
    """Statements that are docstrings, attribute docstrings included."""
    for node in ast.walk(tree):
        for child in ast.iter_child_nodes(node):
            if (
                isinstance(child, ast.Expr)
                and isinstance(child.value, ast.Constant)
                and isinstance(child.value.value, str)
            ):
                yield child


def import_lines(tree: ast.Module) -> int:
    """Lines that import statements take."""
    found = (node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom))
    return sum((node.end_lineno or node.lineno) - node.lineno + 1 for node in found)


def code_lines(text: str, tree: ast.Module) -> int:
    """Lines that are neither blank, nor comments, nor docstrings."""
    skipped = {
        number for each in docstrings(tree) for number in range(each.lineno, (each.end_lineno or each.lineno) + 1)
    }
    lines = enumerate(text.splitlines(), 1)
    return sum(
        1 for number, line in lines if number not in skipped and line.strip() and not line.strip().startswith("#")
    )


def dataclasses(tree: ast.Module) -> Iterator[bool]:
    """For each dataclass, True if it has a method."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and any("dataclass" in ast.unparse(each) for each in node.decorator_list):
            yield any(isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef) for each in node.body)


def private_functions(trees: list[ast.Module]) -> tuple[int, int]:
    """Private functions and methods, and those of them that their file names once beside the definition."""
    private = once = 0
    for tree in trees:
        named: Counter[str] = Counter()
        for node in ast.walk(tree):
            if isinstance(node, ast.Name):
                named[node.id] += 1
            if isinstance(node, ast.Attribute):
                named[node.attr] += 1
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("_") and not node.name.startswith("__"):
                private, once = private + 1, once + (named[node.name] == 1)
    return private, once


def figures(package: Path) -> dict[str, str]:
    """The rows of the table for one package."""
    paths = sources(package)
    texts = [path.read_text(encoding="utf-8") for path in paths]
    trees = [ast.parse(text) for text in texts]
    lines = sum(len(text.splitlines()) for text in texts)
    folders = Counter(path.parent for path in paths)
    code = sum(code_lines(text, tree) for text, tree in zip(texts, trees, strict=True))
    imports = sum(map(import_lines, trees))
    methods = [has for tree in trees for has in dataclasses(tree)]
    functions, once = private_functions(trees)
    fullest, most = max(folders.items(), key=lambda item: item[1])
    return {
        "files": f"{len(paths)}",
        "lines": f"{lines}",
        "executable lines a file": f"{(code - imports) / len(paths):.0f}",
        "files a folder, mean": f"{len(paths) / len(folders):.1f}",
        "files a folder, most": f"{most} ({fullest.relative_to(package.parent)})",
        "import lines, % of code": f"{100 * imports / code:.1f}",
        "dataclasses (without a method)": f"{len(methods)} ({methods.count(False)})",
        "private functions (with one caller)": f"{functions} ({once})",
    }


def frames(program: str) -> list[str]:
    """Functions on the stack of a program when it makes its first factor, outermost first."""
    with tempfile.TemporaryDirectory() as folder:
        text = f"{HOOK}\nOUT = {folder!r}\n{program}"
        done = subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.split()


def main() -> None:
    """Print the table."""
    given = [each for each in sys.argv[1:] if not each.startswith("--")]
    package = Path(given[0]) if given else ROOT / "cmsreduce"
    for name, value in figures(package).items():
        print(f"{name:<38} {value}")
    if "--frames" in sys.argv:
        for name, program in (("command line", COMMAND), ("Python", PYTHON)):
            found = frames(program)
            print(f"\n{name + ': frames to the first factor':<38} {len(found)}")
            for number, function in enumerate(found, 1):
                print(f"{number:>4} {function}")


if __name__ == "__main__":
    main()
