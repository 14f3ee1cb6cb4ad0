"""Fetch the stills of the benchmark from the repositories that show them.

Of each repository only the files that are named are fetched, at one commit. Frames are
cut out of its videos, and every image is compared with the one that was labelled. What
is there already is kept, so an interrupted run continues where it stopped. The folder
then holds the stills, their labels, and a file `licences/OWNER_NAME` if the repository
has a licence. The images stay the property of their owners: measure with them, and do
not hand them on.
"""

from __future__ import annotations

import argparse
import os
import subprocess
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmark.real_roads.manifest import (
    CLOSE,
    EXACT,
    HERE,
    OFFICIAL_LABELS,
    OTHER,
    VERSION,
    Source,
    read_manifest,
)
from benchmark.real_roads.published import describe_effect
from benchmark.real_roads.sets import LABELS
from lanes.console import progress_line
from lanes.describe import format_table
from lanes.errors import LaneError
from lanes.files import (
    read_json_lines,
    translate_write_errors,
    write_atomically,
    write_json_lines,
)
from lanes.labels import read_labels
from lanes.video.images import read_image, write_image
from lanes.video.reader import decode_packet, open_video, read_packets

EXAMPLES = """\
  {program} found_roads
  {program} found_roads --mirror /media/usb/repositories"""
GITHUB = "https://github.com"
# A transfer below 1 kB/s for a minute is given up.
_GIT = (
    "git",
    "--literal-pathspecs",
    *("-c", "core.autocrlf=false"),
    *("-c", "http.lowSpeedLimit=1000"),
    *("-c", "http.lowSpeedTime=60"),
)
_LICENCE_STEMS = ("licence", "license", "copying")
NOT_STATED = "not stated"
_REASON_LENGTH = 150
TERMS = (
    "The images stay the property of their owners, under the licences that the "
    "repositories state (in licences/). No right to hand them on was given to us or "
    "to you: measure with them, and publish numbers only."
)


class FetchError(LaneError):
    """A repository or a file of it cannot be had."""


@dataclass(eq=False)
class Fetched:
    """What was had from a repository.

    `found` says of each still, by its name, whether it is EXACT or CLOSE; `missing` why
    it is not there.
    """

    repo: str
    found: dict[str, str] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    licence: str = "not known"


def fetch_stills(
    folder: Path,
    sources: Sequence[Source],
    mirror: str = GITHUB,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> list[Fetched]:
    """Fetch the stills that are not in the folder; returns what is there by repository.

    `mirror` is an address or a folder that has the repositories as OWNER/NAME. One that
    lacks the commit gives its newest one: the images are compared anyway.
    """
    of_repo: dict[tuple[str, str], list[Source]] = {}
    for source in sources:
        of_repo.setdefault((source.repo, source.commit), []).append(source)

    results = []
    done = 0
    for (repo, _), wanted in of_repo.items():
        fetched = Fetched(repo)
        _look_up(folder, wanted, fetched)
        if len(fetched.found) < len(wanted):
            _fetch_repository(folder, wanted, mirror, fetched)
        if fetched.found:
            fetched.licence = _first_line(_licence_file(folder, repo))
        results.append(fetched)
        done += len(wanted)
        if progress:
            progress(done, len(sources))
    return results


def _look_up(folder: Path, wanted: Sequence[Source], fetched: Fetched) -> None:
    """Note which of the stills, with their clips, are in the folder."""
    for source in wanted:
        file = folder / source.file
        if not file.is_file() or (source.clip and not (folder / source.clip).is_file()):
            continue
        with suppress(LaneError):  # a damaged still is fetched again
            likeness = source.compare(read_image(file))
            if likeness != OTHER:
                fetched.found[source.file] = likeness


def _fetch_repository(
    folder: Path, wanted: Sequence[Source], mirror: str, fetched: Fetched
) -> None:
    """Fetch the stills that are not found, and note which are and why others are not.

    They leave no trace of the repository.
    """
    missing = [source for source in wanted if source.file not in fetched.found]
    with TemporaryDirectory(prefix=".fetching-", dir=folder) as temporary:
        clone = Path(temporary)
        try:
            _fetch_commit(clone, missing[0], mirror)
            _keep_licence(clone, _licence_file(folder, fetched.repo))
        except FetchError as error:
            fetched.missing |= {source.file: str(error) for source in missing}
            return
        for path in dict.fromkeys(source.path for source in missing):
            of_path = [source for source in missing if source.path == path]
            try:
                _git(clone, "checkout", "--quiet", "FETCH_HEAD", "--", path)
                _keep(clone / path, of_path, folder, fetched)
            except (LaneError, OSError) as error:
                reason = str(error).replace(f"{clone}{os.sep}", "")
                fetched.missing |= {source.file: reason for source in of_path}


def _fetch_commit(clone: Path, source: Source, mirror: str) -> None:
    """Fetch commit and trees; the content of files follows when it is checked out."""
    base = f"file://{Path(mirror).resolve()}" if Path(mirror).is_dir() else mirror
    _git(clone, "init", "--quiet")
    _git(clone, "remote", "add", "origin", f"{base}/{source.repo}")
    _git(clone, "config", "remote.origin.promisor", "true")
    _git(clone, "config", "remote.origin.partialclonefilter", "blob:none")
    words = ("fetch", "--quiet", "--depth=1", "--filter=blob:none", "origin")
    try:
        _git(clone, *words, source.commit)
    except FetchError:
        if mirror == GITHUB:
            raise
        _git(clone, *words, "HEAD")  # of a mirror with another history


def _git(clone: Path, *words: str) -> str:
    """Run git; FetchError has the first line of what it says."""
    # A repository that has vanished must not ask for a password.
    environment = os.environ | {"GIT_TERMINAL_PROMPT": "0", "LC_ALL": "C"}
    command = [*_GIT, "-C", str(clone), *words]
    try:
        done = subprocess.run(
            command,
            env=environment,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
        )
    except FileNotFoundError as error:
        raise FetchError("git is not installed") from error
    if done.returncode:
        first, *_ = done.stderr.strip().splitlines() or ["git failed"]
        raise FetchError(first.removeprefix("fatal: ").removeprefix("error: "))
    return done.stdout


def _keep(
    file: Path, sources: Sequence[Source], folder: Path, fetched: Fetched
) -> None:
    """Keep a still, or a video and its frames, that are those that were labelled."""
    images = {source.file: read_image(file) for source in sources if not source.clip}
    if sources[0].clip:
        images = _cut_frames(file, sources)
        _copy(file, folder / sources[0].clip)
    for source in sources:
        if source.file not in images:
            fetched.missing[source.file] = f"{source.path} has no frame {source.frame}"
            continue
        likeness = source.compare(images[source.file])
        if likeness == OTHER:
            fetched.missing[source.file] = f"{source.path} shows another image"
            continue
        if source.clip:
            write_image(folder / source.file, images[source.file])
        else:
            _copy(file, folder / source.file)
        fetched.found[source.file] = likeness


def _cut_frames(video: Path, sources: Sequence[Source]) -> dict[str, np.ndarray]:
    """RGB images of the frames by the names of the stills, without those beyond the
    end.

    They are as stored: not turned, and not enlarged to square pixels.
    """
    name_of = {source.frame: source.file for source in sources}
    images: dict[str, np.ndarray] = {}
    number = 0
    with open_video(video) as container:
        for packet in read_packets(container, container.streams.video[0]):
            for frame in decode_packet(packet):
                if number in name_of:
                    images[name_of[number]] = frame.to_ndarray(format="rgb24")
                number += 1
            if len(images) == len(name_of):
                break
    return images


def _copy(file: Path, target: Path) -> None:
    write_atomically(target, file.read_bytes())


def _licence_file(folder: Path, repo: str) -> Path:
    return folder / "licences" / repo.replace("/", "_")


def _keep_licence(clone: Path, target: Path) -> None:
    """Copy the licence file of a repository, if it has one."""
    for name in _git(clone, "ls-tree", "--name-only", "FETCH_HEAD").splitlines():
        if name.lower().startswith(_LICENCE_STEMS):
            text = _git(clone, "show", f"FETCH_HEAD:{name}")
            write_atomically(target, text.encode())
            return


def _first_line(file: Path) -> str:
    """The first words of a licence file; NOT_STATED without one."""
    if not file.is_file():
        return NOT_STATED
    lines = [line.strip() for line in file.read_text(errors="replace").splitlines()]
    return next(filter(None, lines), NOT_STATED)[:40]


def describe_fetched(results: Sequence[Fetched]) -> str:
    """A table with a line for each repository, and the reasons of what is missing."""
    rows = {}
    reasons: dict[str, int] = {}
    for one in results:
        likenesses = list(one.found.values())
        stills = len(one.found) + len(one.missing)
        counts = [stills, likenesses.count(EXACT), likenesses.count(CLOSE)]
        rows[one.repo] = [*map(str, counts), str(len(one.missing)), one.licence]
        for reason in one.missing.values():
            words = f"{one.repo}: {reason:.{_REASON_LENGTH}}"
            reasons[words] = reasons.get(words, 0) + 1
    table = format_table(("stills", EXACT, CLOSE, "missing", "licence"), rows)
    lines = [f"{count} missing, {words}" for words, count in reasons.items()]
    return "\n".join([table, *lines])


def require_own_folder(folder: Path) -> None:
    """Create the folder; ValueError if it has labels of other stills."""
    with translate_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    file = folder / LABELS
    if not file.is_file():
        return
    ours = {label.name for label in read_labels(HERE / LABELS)}
    for label in read_labels(file):
        if label.name not in ours:
            raise ValueError(
                f"{file}: is of other stills ({label.name}) and would be overwritten; "
                "name another folder."
            )


def write_labels(folder: Path, present: set[str]) -> Path:
    """Write the labels of the stills that are there."""
    entries = [entry for _, entry in read_json_lines(HERE / LABELS, "label")]
    kept = [entry for entry in entries if entry["raw_file"] in present]
    return write_json_lines(folder / LABELS, kept)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this command."""
    parser.add_argument(
        "folder", type=Path, metavar="FOLDER", help="where the stills are written"
    )
    parser.add_argument(
        "--mirror",
        default=GITHUB,
        metavar="BASE",
        help="address or folder that has the repositories as OWNER/NAME (default: "
        "%(default)s)",
    )
    parser.add_argument(
        "--official",
        action="store_true",
        help="also stills with official labels only, which are not published here",
    )


def run(options: argparse.Namespace) -> int:
    """Fetch, say what is missing, and write the labels of what is there.

    The status is 1 if no still is there.
    """
    sources = read_manifest()
    if not options.official:
        sources = [one for one in sources if one.labels != OFFICIAL_LABELS]
    folder = options.folder
    require_own_folder(folder)
    results = fetch_stills(
        folder, sources, options.mirror, progress=progress_line("stills")
    )
    print(describe_fetched(results))

    present = {file for one in results for file in one.found}
    if not present:
        print("no still could be fetched: check the network, and run this again")
        return 1
    labels = write_labels(folder, present)
    print(f"\n{TERMS}\n")
    print(f"Found Roads {VERSION}: {len(present)} of {len(sources)} stills, {labels}")
    print(describe_effect(present))
    return 0
