"""Who imports whom in lanes/, in whatever folders its modules lie: no cycles, and a few doors that stay shut."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import lanes

# All that the renderer may know of the package that it tests: pictures, the camera, and how files are written.
OPEN_TO_SCENES = {"files", "threads", "images", "camera", "camerafile", "videowriter", "videofile", "telemetry"}


class Package:
    """The imports of all modules of a package, by dotted names; read from the source, nothing is imported."""

    def __init__(self, root: Path) -> None:
        self.name = root.name
        files = {_module_name(root, path): path for path in sorted(root.rglob("*.py"))}
        self.anywhere = {name: {*_imports(path, name)} for name, path in files.items()}
        self.at_start = {name: {*_imports(path, name, into_functions=False)} for name, path in files.items()}

    def own(self, imported: str) -> str | None:
        """The module of this package that is imported, without the name that is taken out of it."""
        while imported not in self.anywhere:
            imported, _, taken = imported.rpartition(".")
            if not taken:
                return None
        return imported

    def cycle(self) -> list[str]:
        """Modules that import each other in a ring, for types alone too; imports inside functions do not count."""
        graph = {name: {self.own(i) for i in imports} - {name, None} for name, imports in self.at_start.items()}
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            return error.args[1]
        return []

    def importers_of(self, target: str) -> set[str]:
        """Modules that import `target` or a name of it, anywhere."""
        return {
            name for name, imports in self.anywhere.items() if any(f"{i}.".startswith(f"{target}.") for i in imports)
        }

    def outside_imports(self, part: str, allowed: set[str]) -> set[tuple[str, str]]:
        """Imports by the sub-package `part` of other modules whose last name is not in `allowed`."""
        inside = f"{self.name}.{part}."
        return {
            (name, own)
            for name, imports in self.anywhere.items()
            for own in map(self.own, imports)
            if own and f"{name}.".startswith(inside) and not f"{own}.".startswith(inside)
            if own.rpartition(".")[2] not in allowed
        }


def _module_name(root: Path, path: Path) -> str:
    parts = path.relative_to(root.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imports(path: Path, module: str, *, into_functions: bool = True) -> Iterator[str]:
    nodes: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = module.split(".")[: -node.level + (path.stem == "__init__") or None] if node.level else []
            yield from (".".join([*above, *filter(None, [node.module]), alias.name]) for alias in node.names)
        elif into_functions or not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            nodes += ast.iter_child_nodes(node)


LANES = Package(Path(lanes.__file__).parent)


def test_no_module_imports_itself_in_a_ring():
    assert LANES.cycle() == []


def test_figures_are_drawn_in_one_place():
    assert {name.rpartition(".")[2] for name in LANES.importers_of("matplotlib.pyplot")} == {"plots"}


def test_the_command_line_is_imported_by_nothing():
    assert LANES.importers_of("lanes.__main__") == set()


def test_the_renderer_knows_nothing_of_what_it_tests():
    assert LANES.outside_imports("scenes", OPEN_TO_SCENES) == set()
    # None of this would be seen if the walk missed the renderer or the package's own names.
    assert LANES.outside_imports("scenes", set()) != set()


@pytest.mark.parametrize(
    ("files", "seen"),
    [
        ({"a.py": "import toy.b", "b.py": "from toy.a import x"}, True),
        ({"a.py": "from toy import b", "b.py": "from .sub.c import x", "sub/c.py": "from .. import a"}, True),
        ({"a.py": "if TYPE_CHECKING:\n    from toy.b import x", "b.py": "from toy.a import x"}, True),
        ({"a.py": "def f():\n    from toy.b import x", "b.py": "from toy.a import x"}, False),
        ({"a.py": "from toy import b", "b.py": "import numpy.a"}, False),
    ],
    ids=["plain", "relative", "types", "function", "none"],
)
def test_rings_are_seen_in_every_way_to_import(tmp_path, files, seen):
    assert bool(package(tmp_path, files).cycle()) == seen


@pytest.mark.parametrize(
    "line", ["import other.thing as t", "from other import thing", "def f():\n    from other.thing import x"]
)
def test_imports_are_seen_in_every_way(tmp_path, line):
    toy = package(tmp_path, {"sub/a.py": line, "b.py": "from other import things"})
    assert toy.importers_of("other.thing") == {"toy.sub.a"}


def test_outside_imports_are_known_by_their_last_name(tmp_path):
    files = {"part/a.py": "from toy.part import b\nfrom toy.x import good, bad", "part/b.py": ""}
    toy = package(tmp_path, files | {"x/good.py": "import toy.x.bad", "x/bad.py": ""})
    assert toy.outside_imports("part", {"good"}) == {("toy.part.a", "toy.x.bad")}


def package(folder: Path, files: dict[str, str]) -> Package:
    for name in ["__init__.py", *files]:
        path = folder / "toy" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(files.get(name, ""))
    return Package(folder / "toy")
