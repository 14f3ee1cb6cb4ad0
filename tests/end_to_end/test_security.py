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

SOURCES = {}
for _path in (ROOT / "helpers.py", *sorted((ROOT / "lanes").rglob("*.py"))):
    _tree = ast.parse(_path.read_text(encoding="utf-8"))
    SOURCES[_path.relative_to(ROOT).as_posix()] = _tree
# Modules and calls that turn bytes into objects or text into code, or that start a
# shell.
IMPORTS = {
    "_pickle",
    "cPickle",
    "cloudpickle",
    "code",
    "codeop",
    "ctypes",
    "dill",
    "http",
    "httpx",
    "joblib",
    "marshal",
    "pickle",
    "pty",
    "requests",
    "shelve",
    "socket",
    "subprocess",
    "urllib.request",
}
CALLS = {
    "__import__",
    "compile",
    "cv2.FileStorage",
    "cv2.imread",
    "cv2.imwrite",
    "eval",
    "exec",
    "np.fromfile",
    "os.execv",
    "os.popen",
    "os.spawnv",
    "os.system",
    "pd.read_pickle",
    "shutil.unpack_archive",
    "tempfile.mktemp",
    "yaml.full_load",
    "yaml.load_all",
    "yaml.unsafe_load",
}
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
            for alias in node.names:
                yield f"{node.module}.{alias.name}"


def faults(tree: ast.AST, name: str) -> list[str]:
    """Forbidden imports and calls in a source."""
    found = []
    for module in imports(tree):
        package, _, _ = module.partition(".")
        if {module, package} & IMPORTS:
            found.append(module)
    for called, node in calls(tree):
        is_elsewhere = called in OPENERS and name not in OPENERS[called]
        if called in CALLS or is_elsewhere or is_unsafe(node, called, name):
            found.append(ast.unparse(node))
    return found


def is_unsafe(node: ast.Call, called: str, name: str) -> bool:
    """Whether the arguments of a call are: pickles, a shell, a video to read."""
    for keyword in node.keywords:
        is_off = ast.unparse(keyword.value) == "False"
        if keyword.arg in ("allow_pickle", "shell") and not is_off:
            return True
    # input videos are opened in one module, others are opened for writing
    mode = [ast.unparse(argument) for argument in node.args[1:]]
    is_reader = name == "lanes/video/reader.py"
    return called == "av.open" and not is_reader and mode != ["'w'"]


@pytest.mark.parametrize("name", SOURCES)
def test_nothing_dangerous_is_in_the_sources(name):
    assert faults(SOURCES[name], name) == []


@pytest.mark.parametrize(
    "line",
    [
        "import pickle",
        "from pickle import loads",
        "from urllib import request",
        "eval('1')",
        "os.system('ls')",
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
    loaders = set()
    for called, node in calls(tree):
        if called == "yaml.load":
            loaders.add(ast.unparse(node.args[1]))
    [loader] = loaders
    nodes = ast.walk(tree)
    classes = {node.name: node for node in nodes if isinstance(node, ast.ClassDef)}
    [base] = classes[loader].bases
    assert ast.unparse(base) == "yaml.SafeLoader"


@pytest.fixture(scope="module")
def locked() -> dict[str, tuple[str, list[str]]]:
    """Version and hashes of each package in the lock file."""
    found = {}
    for line in LOCK.read_text().replace("\\\n", " ").splitlines():
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        pin, *hashes = line.split("--hash=sha256:")
        pattern = r"([\w.-]+)(?:\[[\w,]+\])?==([\w.+!]+)( ; .*)?\s*"
        name, version = re.fullmatch(pattern, pin).group(1, 2)
        found[canonicalize_name(name)] = version, [digits.strip() for digits in hashes]
    return found


def test_the_lock_names_no_host():
    pattern = r"https?://|--(extra-)?index|--find-links|file:|@ "
    assert not re.search(pattern, LOCK.read_text())


def test_the_lock_has_all_packages(locked):
    assert len(locked) > 120


def test_the_lock_pins_every_package_with_hashes(locked):
    for name, (_, hashes) in locked.items():
        assert hashes, name
        for digits in hashes:
            assert re.fullmatch(r"[0-9a-f]{64}", digits), name


def test_the_lock_has_each_requirement_of_its_installed_packages(locked):
    for name in locked:
        try:
            requires = metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue
        for required in map(Requirement, requires):
            if not required.marker or required.marker.evaluate({"extra": ""}):
                missing = f"{name} requires {required}; run `make lock`"
                assert canonicalize_name(required.name) in locked, missing
