"""The package: its metadata against its pins and imports, and an installation without
the clone.
"""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import tarfile
import time
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
    required = map(Requirement, lines)
    return {canonicalize_name(one.name): one for one in required}


def pins(name: str) -> dict[str, Version]:
    """The versions that a requirements file pins, without its hashes and comments."""
    text = (ROOT / name).read_text(encoding="utf-8")
    found = re.findall(r"^([\w.-]+)(?:\[\w+\])?==([\w.+!]+)", text, re.MULTILINE)
    return {canonicalize_name(package): Version(version) for package, version in found}


PINNED = pins("requirements.txt")


def lowest(lines: list[str]) -> dict[str, Version]:
    """The lower ends of ranges, which may be pins."""
    lowest = {}
    for name, required in by_name(lines).items():
        for limit in required.specifier:
            if limit.operator in (">=", "=="):
                lowest[name] = Version(limit.version)
    return lowest


@pytest.mark.parametrize("name", by_name(PROJECT["dependencies"]))
def test_the_pin_is_the_first_minor_release_of_the_declared_range(name):
    lines = PROJECT["dependencies"]
    assert PINNED[name] in by_name(lines)[name].specifier
    assert PINNED[name].release[:2] == lowest(lines)[name].release[:2]


def test_measuring_uses_the_pinned_pytest():
    """Packages for measuring are imported beside the others."""
    assert lowest(EXTRAS["measuring"])["pytest"] == PINNED["pytest"]


def test_the_lock_has_what_is_pinned():
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
    packages = set()
    for name in modules - sys.stdlib_module_names - {"lanes"}:
        owner, *_ = owners.get(name, [name])
        packages.add(canonicalize_name(owner))
    return packages


def test_the_dependencies_are_what_lanes_imports():
    # distributed (Dask) is of the extra cluster, onnx and onnxruntime of network, the
    # others of ros. ipywidgets comes with Jupyter, moviepy with the course.
    optional = {"distributed", "ipywidgets", "mcap", "mcap-protobuf-support", "moviepy"}
    optional |= {"onnx", "onnxruntime", "rosbags"}
    assert imported_packages() - optional == by_name(PROJECT["dependencies"]).keys()


@pytest.fixture(scope="module")
def sources(tmp_path_factory) -> Path:
    """A copy of the files that the package is built from.

    So nothing is written into the clone.
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
    script = (
        "from flit_core.buildapi import build_sdist; "
        f"print(build_sdist({str(folder)!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=sources,
        check=True,
        capture_output=True,
        text=True,
    )
    return folder / done.stdout.strip()


@pytest.fixture(scope="module")
def packed(sdist) -> set[str]:
    """The names of the files of the sdist."""
    with tarfile.open(sdist) as archive:
        return {name.partition("/")[2] for name in archive.getnames()}


def test_the_sdist_holds_nothing_but_the_package(packed):
    assert {name.partition("/")[0] for name in packed} == {*SOURCES, "PKG-INFO"}


def test_the_sdist_holds_all_files_of_the_package(packed):
    files = set()
    for path in (ROOT / "lanes").rglob("*"):
        if path.is_file() and path.suffix != ".pyc":
            files.add(path.relative_to(ROOT).as_posix())
    assert {name for name in packed if name.startswith("lanes/")} == files


@pytest.fixture(scope="module")
def installed(sdist, tmp_path_factory) -> Path:
    """The folder of the commands of an environment with a wheel of the sdist.

    The environment borrows the dependencies.
    """
    environment = tmp_path_factory.mktemp("environment") / "environment"
    venv.create(environment, symlinks=os.name != "nt")
    where = sysconfig.get_paths("venv", {"base": environment})
    commands = Path(where["scripts"])
    borrowed = Path(where["purelib"]) / "dependencies.pth"
    borrowed.write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    install = [commands / "python", "-m", "pip", "install", "--quiet", sdist]
    options = ["--no-deps", "--no-index", "--no-build-isolation"]
    subprocess.run([*install, *options], cwd=environment, check=True)
    return commands


def environment_without_clone() -> dict[str, str]:
    """One in which Python cannot import the clone."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def run_in(folder: Path, *command: object) -> str:
    """What a command prints in a folder from which Python cannot import the clone."""
    done = subprocess.run(
        list(map(str, command)),
        cwd=folder,
        env=environment_without_clone(),
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    """A video in a folder of its own."""
    frames = map(BENDS.frame, np.arange(FRAMES) / FPS)
    return write_clip(tmp_path_factory.mktemp("drive") / "drive.mp4", frames)


def test_the_installed_package_has_types(installed):
    assert list(installed.parent.rglob("lanes/py.typed"))


@pytest.mark.slow
def test_the_installed_command_says_its_version(installed, tmp_path):
    printed = run_in(tmp_path, installed / "lanes", "--version")
    assert printed == f"lanes {lanes.__version__}\n"


@pytest.mark.slow
def test_the_installed_command_annotates_a_video(installed, drive, tmp_path):
    run_in(tmp_path, installed / "lanes", "annotate", "--hfov", "60", drive)
    written = sorted(path.name for path in tmp_path.rglob("*.*"))
    assert written == ["drive.csv", "drive.html", "drive.mp4"]
    assert inspect_video(tmp_path / "annotated" / "drive.mp4").frames == FRAMES


@pytest.mark.slow
def test_the_installed_command_does_not_mind_a_closed_pipe(installed, tmp_path):
    """As in `lanes --help | head -0`."""
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [installed / "lanes", "--help"],
        cwd=tmp_path,
        env=environment_without_clone(),
        stdout=write,
        stderr=subprocess.PIPE,
    )
    os.close(write)
    assert done.returncode == 0
    assert done.stderr == b""


@pytest.mark.slow
def test_the_installed_command_leaves_no_file_after_sigterm(installed, tmp_path):
    video = ROOT / "test_videos" / "project_video.mp4"
    child = subprocess.Popen(
        [installed / "lanes", "annotate", "--hfov", "60", video],
        cwd=tmp_path,
        env=environment_without_clone(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    with child:
        # until it writes
        while child.poll() is None and not list(tmp_path.rglob("*.*")):
            time.sleep(0.02)
        child.terminate()
        _, err = child.communicate(timeout=120)
    assert child.returncode == 128 + signal.SIGTERM
    assert b"Traceback" not in err
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.slow
def test_the_lines_of_the_readme_print_lanes_with_confidences(
    installed, drive, tmp_path
):
    """The first frames may have no lane yet."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    [code] = re.findall(r"```python\n(import lanes\n.*?)```", readme, re.DOTALL)
    code = code.replace("(1280, 720)", repr(BENDS.camera.size))
    printed = run_in(drive.parent, installed / "python", "-c", code)
    rows = [line.split() for line in printed.splitlines()]
    assert len(rows) >= FRAMES - 2
    for _, _, confidence in rows:
        assert 0 <= float(confidence) <= 1


@pytest.mark.slow
def test_the_public_names_of_the_installed_package_have_examples_that_run(
    installed, tmp_path
):
    code = (
        "import doctest, lanes; print(lanes.__file__, *sorted(lanes.__all__), "
        "*doctest.testmod(lanes)[:2])"
    )
    printed = run_in(tmp_path, installed / "python", "-c", code)
    file, *names, failed, attempted = printed.split()
    assert Path(file).is_relative_to(installed.parent)
    assert names == sorted(lanes.__all__)
    assert failed == "0"
    assert int(attempted) >= 5
