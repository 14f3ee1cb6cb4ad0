"""Security of the sources (no pickle, eval or shell; files only) and of the lock file
(all pinned by hash).
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from importlib import metadata

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support.project import ROOT

SOURCES = {
    path.relative_to(ROOT).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
    for path in (ROOT / "helpers.py", *sorted((ROOT / "lanes").rglob("*.py")))
}
# Modules and calls that turn bytes into objects or text into code, or that start a
# shell.
IMPORTS = {
    "pickle",
    "cPickle",
    "_pickle",
    "dill",
    "cloudpickle",
    "joblib",
    "marshal",
    "shelve",
    "code",
    "codeop",
}
IMPORTS |= {
    "subprocess",
    "pty",
    "socket",
    "http",
    "urllib.request",
    "requests",
    "httpx",
    "ctypes",
}
CALLS = {
    "eval",
    "exec",
    "compile",
    "__import__",
    "os.system",
    "os.popen",
    "os.execv",
    "os.spawnv",
    "pd.read_pickle",
}
CALLS |= {
    "yaml.unsafe_load",
    "yaml.full_load",
    "yaml.load_all",
    "np.fromfile",
    "cv2.imread",
    "cv2.imwrite",
}
CALLS |= {"cv2.FileStorage", "shutil.unpack_archive", "tempfile.mktemp"}
# The only modules that may open a video, a camera, or a file for writing.
OPENERS = {
    "av.open": {"lanes/video/reader.py", "lanes/video/writer.py"},
    "yaml.load": {"lanes/files.py"},
    "yaml.safe_load": set(),
    "np.load": set(),
    # helpers.py stands alone; it opens existing files only, no address and no camera
    "cv2.VideoCapture": {"helpers.py"},
    "os.open": set(),
    "open": set(),
}
LOCK = ROOT / "requirements.lock"


def calls(tree: ast.AST) -> Iterator[tuple[str, ast.Call]]:
    """The calls in a source, by their dotted names as written."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


def imports(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def faults(tree: ast.AST, name: str) -> set[str]:
    """Forbidden imports and calls in a source."""
    found = {i for i in imports(tree) if i in IMPORTS or i.partition(".")[0] in IMPORTS}
    for called, node in calls(tree):
        keywords = {
            keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords
        }
        if called in CALLS or name not in OPENERS.get(called, {name}):
            found.add(called)
        if (
            keywords.get("allow_pickle", "False") != "False"
            or keywords.get("shell", "False") != "False"
        ):
            found.add(f"{called}({keywords})")
        # input videos are opened in one module, others are opened for writing
        mode = [ast.unparse(argument) for argument in node.args[1:]]
        if called == "av.open" and name != "lanes/video/reader.py" and mode != ["'w'"]:
            found.add(f"av.open({mode})")
    return found


def test_nothing_dangerous_is_in_the_sources():
    assert {
        name: found for name, tree in SOURCES.items() if (found := faults(tree, name))
    } == {}


@pytest.mark.parametrize(
    "line",
    [
        "import pickle",
        "from pickle import loads",
        "from urllib import request",
        "eval('1')",
        "os.system('ls')",
    ]
    + [
        "np.load(f, allow_pickle=True)",
        "run('ls', shell=True)",
        "open('x', 'w')",
        "av.open(name)",
        "yaml.load(f)",
    ],
)
def test_forbidden_code_is_noticed(line):
    assert faults(ast.parse(line), "lanes/x.py")


def test_the_only_yaml_loader_is_a_subclass_of_the_safe_one():
    tree = SOURCES["lanes/files.py"]
    loaders = {
        ast.unparse(node.args[1])
        for called, node in calls(tree)
        if called == "yaml.load"
    }
    classes = {
        node.name: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)
    }
    assert [
        ast.unparse(base) for loader in loaders for base in classes[loader].bases
    ] == ["yaml.SafeLoader"]


@pytest.fixture(scope="module")
def locked() -> dict[str, tuple[str, list[str]]]:
    """Version and hashes of each package in the lock file."""
    found = {}
    for line in LOCK.read_text().replace("\\\n", " ").splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            pin, *hashes = line.split("--hash=sha256:")
            name, version = re.fullmatch(
                r"([\w.-]+)(?:\[[\w,]+\])?==([\w.+!]+)( ; .*)?\s*", pin
            ).group(1, 2)
            found[canonicalize_name(name)] = (
                version,
                [digits.strip() for digits in hashes],
            )
    return found


def test_the_lock_pins_every_package_with_hashes_and_names_no_host(locked):
    assert not re.search(
        r"https?://|--(extra-)?index|--find-links|file:|@ ", LOCK.read_text()
    )
    assert len(locked) > 120
    for name, (_, hashes) in locked.items():
        assert hashes, name
        assert all(re.fullmatch(r"[0-9a-f]{64}", digits) for digits in hashes), name


def test_the_lock_has_each_requirement_of_its_installed_packages(locked):
    for name in locked:
        try:
            requires = metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue
        for requirement in map(Requirement, requires):
            if not requirement.marker or requirement.marker.evaluate({"extra": ""}):
                assert canonicalize_name(requirement.name) in locked, (
                    f"{name} requires {requirement}; run `make lock`"
                )
