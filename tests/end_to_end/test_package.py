"""The package: its metadata against its pins and imports, and an installation without
the clone.
"""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

import lanes
from lanes.video.reader import inspect_video
from tests.support.clips import FPS, write_clip
from tests.support.painted_drive import BENDS
from tests.support.project import ROOT

SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = SETTINGS["project"]
EXTRAS = PROJECT["optional-dependencies"]
SOURCES = ("lanes", "pyproject.toml", "README.md", "LICENSE")
FRAMES = 12


def by_name(lines: list[str]) -> dict[str, Requirement]:
    return {
        canonicalize_name(required.name): required
        for required in map(Requirement, lines)
    }


def pins(name: str) -> dict[str, Version]:
    """The versions that a requirements file pins; its hashes and comments
    are left out.
    """
    found = re.findall(
        r"^([\w.-]+)(?:\[\w+\])?==([\w.+!]+)",
        (ROOT / name).read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    return {canonicalize_name(package): Version(version) for package, version in found}


PINNED = pins("requirements.txt")


def lowest(lines: list[str]) -> dict[str, Version]:
    """The lower ends of ranges, which may be pins."""
    limits = [
        (name, limit)
        for name, required in by_name(lines).items()
        for limit in required.specifier
    ]
    return {
        name: Version(limit.version)
        for name, limit in limits
        if limit.operator in (">=", "==")
    }


def test_what_is_pinned_and_locked_is_in_the_declared_ranges():
    """Tests run with the first minor release of each range.

    Packages for measuring are imported beside the others.
    """
    required = by_name(PROJECT["dependencies"])
    assert all(PINNED[name] in one.specifier for name, one in required.items())
    first = {
        name: version.release[:2]
        for name, version in lowest(PROJECT["dependencies"]).items()
    }
    assert first == {name: PINNED[name].release[:2] for name in required}
    assert lowest(EXTRAS["measuring"])["pytest"] == PINNED["pytest"]
    locked = pins("requirements.lock")
    wanted = PINNED | lowest(EXTRAS["cluster"]) | lowest(EXTRAS["book"])
    assert wanted == {name: locked.get(name) for name in wanted}, "run `make lock`"


def imported_packages() -> set[str]:
    """The distributions whose modules the sources of lanes/ import, at any place."""
    modules = set()
    for path in (ROOT / "lanes").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                modules |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                modules.add(node.module.partition(".")[0])
    owners = packages_distributions()
    return {
        canonicalize_name(owners.get(name, [name])[0])
        for name in modules - sys.stdlib_module_names - {"lanes"}
    }


def test_the_dependencies_are_what_lanes_imports():
    # distributed (Dask) is of the extra cluster, onnx and onnxruntime of network, the
    # others of ros. ipywidgets comes with Jupyter, moviepy with the course.
    optional = {"distributed", "ipywidgets", "mcap", "mcap-protobuf-support", "moviepy"}
    optional |= {"onnx", "onnxruntime", "rosbags"}
    assert imported_packages() - optional == by_name(PROJECT["dependencies"]).keys()


@pytest.fixture(scope="module")
def sources(tmp_path_factory) -> Path:
    """A copy of the files that the package is built from, so that nothing is written
    into the clone.
    """
    if not all(map(importlib.util.find_spec, ("flit_core", "pip"))):
        pytest.skip(
            "flit_core or pip is not installed: pip install -r requirements.txt"
        )
    folder = tmp_path_factory.mktemp("sources")
    for name in SOURCES:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    return folder


@pytest.fixture(scope="module")
def sdist(sources, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sdist")
    script = f"from flit_core.buildapi import build_sdist; print(build_sdist({str(folder)!r}))"
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=sources,
        check=True,
        capture_output=True,
        text=True,
    )
    return folder / done.stdout.strip()


def test_the_sdist_holds_the_package_and_nothing_else(sdist):
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {name.partition("/")[0] for name in names} == {*SOURCES, "PKG-INFO"}
    here = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "lanes").rglob("*")
        if path.is_file()
    }
    assert {name for name in names if name.startswith("lanes/")} == {
        name for name in here if not name.endswith(".pyc")
    }


@pytest.fixture(scope="module")
def installed(sdist, tmp_path_factory) -> Path:
    """The folder of the commands of an environment with a wheel of the sdist, which
    borrows the dependencies.
    """
    environment = tmp_path_factory.mktemp("environment") / "environment"
    venv.create(environment, symlinks=os.name != "nt")
    where = sysconfig.get_paths("venv", {"base": environment})
    modules = Path(where["purelib"])
    commands = Path(where["scripts"])
    (modules / "dependencies.pth").write_text(
        sysconfig.get_path("purelib"), encoding="utf-8"
    )
    options = ["--quiet", "--no-deps", "--no-index", "--no-build-isolation"]
    subprocess.run(
        [commands / "python", "-m", "pip", "install", *options, sdist],
        cwd=environment,
        check=True,
    )
    return commands


def run_in(folder: Path, *command: object) -> str:
    """What a command prints in a folder from which Python cannot import the clone."""
    environment = {
        name: value for name, value in os.environ.items() if name != "PYTHONPATH"
    }
    words = list(map(str, command))
    return subprocess.run(
        words, cwd=folder, env=environment, check=True, capture_output=True, text=True
    ).stdout


@pytest.mark.slow
def test_the_installed_package_works_from_an_empty_folder(installed, tmp_path):
    """Its command annotates a video; its public names have examples that run; the lines
    of the README print a lane.
    """
    assert list(
        installed.parent.rglob("lanes/py.typed")
    )  # type checkers read the types of the package
    drive = write_clip(
        tmp_path / "drive.mp4", map(BENDS.frame, np.arange(FRAMES) / FPS)
    )
    empty = tmp_path / "empty"
    empty.mkdir()
    assert (
        run_in(empty, installed / "lanes", "--version")
        == f"lanes {lanes.__version__}\n"
    )
    run_in(empty, installed / "lanes", "annotate", "--hfov", "60", drive)
    assert sorted(path.name for path in empty.rglob("*.*")) == [
        "drive.csv",
        "drive.html",
        "drive.mp4",
    ]
    assert inspect_video(empty / "annotated" / "drive.mp4").frames == FRAMES
    [code] = re.findall(
        r"```python\n(import lanes\n.*?)```",
        (ROOT / "README.md").read_text(encoding="utf-8"),
        re.S,
    )
    code = code.replace("(1280, 720)", repr(BENDS.camera.size))
    code += "\nimport doctest; print(lanes.__file__, *sorted(lanes.__all__), *doctest.testmod(lanes)[:2])"
    printed = run_in(tmp_path, installed / "python", "-c", code).splitlines()
    *rows, (file, *names, failed, attempted) = map(str.split, printed)
    assert len(rows) >= FRAMES - 2  # the first frames may have no lane yet
    assert all(0 <= float(confidence) <= 1 for _, _, confidence in rows)
    assert Path(file).is_relative_to(installed.parent)
    assert names == sorted(lanes.__all__)
    assert failed == "0"
    assert int(attempted) >= 5
