"""Found Roads: stills are fetched from repositories, which are local ones here."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from benchmark.real_roads.__main__ import main
from benchmark.real_roads.fetch import (
    NOT_STATED,
    Fetched,
    describe_fetched,
    fetch_stills,
)
from benchmark.real_roads.manifest import (
    CLOSE,
    EXACT,
    OTHER,
    Source,
    look_hash,
    pixels_hash,
    read_manifest,
)
from lanes.video.images import read_image, write_image
from tests.support.clips import write_clip
from tests.support.painted_drive import BENDS
from tests.support.project import REAL_DATA, ROOT

REPO = "someone/Road lanes"
NO_COMMIT = "0" * 40


def git(folder: Path, *words: str) -> str:
    command = ["git", "-C", str(folder), *words]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def commit(repository: Path) -> str:
    """Commit all files of a repository that serves partial clones."""
    git(repository, "init", "--quiet")
    git(repository, "config", "uploadpack.allowFilter", "true")
    git(repository, "add", "--all")
    author = ("-c", "user.name=a", "-c", "user.email=a@example.org")
    git(repository, *author, "commit", "--quiet", "-m", "road")
    return git(repository, "rev-parse", "HEAD")


def source_of(image: np.ndarray, file: str, path: str, **more: object) -> Source:
    """The source of an image in REPO."""
    height, width = image.shape[:2]
    return Source(
        file=file,
        repo=REPO,
        path=path,
        width=width,
        height=height,
        labels="by hand",
        pixels=pixels_hash(image),
        look=look_hash(image),
        **{"commit": NO_COMMIT, **more},
    )


def decoded(video: Path, number: int) -> np.ndarray:
    with av.open(str(video)) as container:
        frames = list(container.decode(video=0))
    return frames[number].to_ndarray(format="rgb24")


@dataclass
class Mirror:
    """A folder with REPO, and the sources of a still and of two frames in it."""

    folder: Path
    still: Source
    frames: list[Source]

    @property
    def sources(self) -> list[Source]:
        return [self.still, *self.frames]

    def fetch(self, folder: Path, *sources: Source) -> Fetched:
        wanted = sources or self.sources
        (fetched,) = fetch_stills(folder, wanted, str(self.folder))
        return fetched


@pytest.fixture(scope="module")
def mirror(tmp_path_factory) -> Mirror:
    folder = tmp_path_factory.mktemp("mirror")
    repository = folder / REPO
    (repository / "a folder").mkdir(parents=True)
    still = repository / "a folder" / "still [1].jpg"
    write_image(still, BENDS.frame(0.0))
    video = repository / "drive.mp4"
    write_clip(video, [BENDS.frame(number / 5) for number in range(6)])
    (repository / "LICENSE").write_text("\nMIT License\n\nCopyright (c) someone\n")
    unrelated = repository / "unrelated.txt"
    unrelated.write_text("of no importance\n" * 99)
    hash_of = commit(repository)

    of_still = source_of(
        read_image(still), "road/still.jpg", "a folder/still [1].jpg", commit=hash_of
    )
    of_frames = []
    for number in (1, 4):
        source = source_of(
            decoded(video, number),
            f"road/{number}.png",
            "drive.mp4",
            commit=hash_of,
            frame=number,
            clip="road/clip.mp4",
        )
        of_frames.append(source)

    # whoever asks for a file that is not named gets an error
    blob = git(repository, "rev-parse", "HEAD:unrelated.txt")
    (repository / ".git" / "objects" / blob[:2] / blob[2:]).unlink()
    return Mirror(folder, of_still, of_frames)


def test_a_still_is_the_file_of_the_repository(mirror, tmp_path):
    fetched = mirror.fetch(tmp_path, mirror.still)
    assert fetched.found == {"road/still.jpg": EXACT}
    original = mirror.folder / REPO / mirror.still.path
    assert (tmp_path / "road" / "still.jpg").read_bytes() == original.read_bytes()


def test_frames_are_cut_out_of_the_video_by_their_numbers(mirror, tmp_path):
    fetched = mirror.fetch(tmp_path, *mirror.frames)
    assert fetched.found == {"road/1.png": EXACT, "road/4.png": EXACT}
    video = mirror.folder / REPO / "drive.mp4"
    image = read_image(tmp_path / "road" / "4.png")
    np.testing.assert_array_equal(image, decoded(video, 4))


def test_the_video_is_kept_for_tracking(mirror, tmp_path):
    mirror.fetch(tmp_path)
    video = mirror.folder / REPO / "drive.mp4"
    assert (tmp_path / "road" / "clip.mp4").read_bytes() == video.read_bytes()


def test_nothing_else_is_left_in_the_folder(mirror, tmp_path):
    mirror.fetch(tmp_path)
    names = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    stills = {"still.jpg", "1.png", "4.png"}
    assert names == {*stills, "clip.mp4", "someone_Road lanes"}


def test_what_is_there_is_not_fetched_again(mirror, tmp_path):
    mirror.fetch(tmp_path)
    (fetched,) = fetch_stills(tmp_path, mirror.sources, str(tmp_path / "no mirror"))
    assert set(fetched.found.values()) == {EXACT}
    assert not fetched.missing


@pytest.mark.parametrize(
    "damage", [Path.unlink, lambda path: path.write_bytes(b"\xff")]
)
def test_a_lost_or_damaged_still_is_fetched_again(mirror, tmp_path, damage):
    mirror.fetch(tmp_path)
    damage(tmp_path / "road" / "still.jpg")
    assert mirror.fetch(tmp_path).found["road/still.jpg"] == EXACT


def test_a_mirror_without_the_commit_gives_its_newest_one(mirror, tmp_path):
    source = replace(mirror.still, commit=NO_COMMIT)
    assert mirror.fetch(tmp_path, source).found == {"road/still.jpg": EXACT}


def test_a_repository_that_has_vanished_does_not_stop_the_others(mirror, tmp_path):
    gone = replace(mirror.still, repo="gone/away", file="gone/1.jpg")
    results = fetch_stills(tmp_path, [gone, mirror.still], str(mirror.folder))
    assert [len(one.found) for one in results] == [0, 1]
    assert "gone/away" in results[0].missing["gone/1.jpg"]


def test_a_file_that_has_vanished_does_not_stop_the_others(mirror, tmp_path):
    gone = replace(mirror.still, path="gone.jpg", file="road/gone.jpg")
    fetched = mirror.fetch(tmp_path, gone, mirror.still)
    assert fetched.found == {"road/still.jpg": EXACT}
    assert "gone.jpg" in fetched.missing["road/gone.jpg"]


def test_a_frame_beyond_the_end_is_named(mirror, tmp_path):
    beyond = replace(mirror.frames[0], frame=99)
    fetched = mirror.fetch(tmp_path, beyond)
    assert fetched.missing == {"road/1.png": "drive.mp4 has no frame 99"}


def test_a_video_that_is_cut_off_has_the_frames_before(tmp_path):
    repository = tmp_path / "mirror" / REPO
    repository.mkdir(parents=True)
    # a transport stream needs no index at its end
    frames = [BENDS.frame(number / 5) for number in range(6)]
    whole = write_clip(tmp_path / "whole.ts", frames)
    early = source_of(decoded(whole, 1), "road/1.png", "drive.ts", frame=1, clip="a.ts")
    late = source_of(decoded(whole, 5), "road/5.png", "drive.ts", frame=5, clip="a.ts")
    video = whole.read_bytes()
    (repository / "drive.ts").write_bytes(video[: len(video) // 2])
    commit(repository)
    (fetched,) = fetch_stills(tmp_path, [early, late], str(tmp_path / "mirror"))
    assert fetched.found == {"road/1.png": EXACT}
    assert fetched.missing == {"road/5.png": "drive.ts has no frame 5"}


def test_another_image_is_not_kept(mirror, tmp_path):
    other = source_of(np.full((360, 640, 3), 9, np.uint8), "road/0.jpg", "")
    fetched = mirror.fetch(
        tmp_path, replace(mirror.still, pixels=other.pixels, look=other.look)
    )
    assert list(fetched.missing) == ["road/still.jpg"]
    assert "another image" in fetched.missing["road/still.jpg"]
    assert not (tmp_path / "road" / "still.jpg").exists()


@pytest.fixture
def image() -> np.ndarray:
    return read_image(ROOT / "test_images" / "straight_lines1.jpg")


def compare(image: np.ndarray, other: np.ndarray) -> str:
    return source_of(image, "a", "a").compare(other)


def test_an_image_is_itself(image):
    assert compare(image, image.copy()) == EXACT


def test_an_image_with_another_pixel_is_close(image):
    other = image.copy()
    other[7, 9, 1] ^= 1
    assert compare(image, other) == CLOSE


def test_an_image_of_another_decoder_is_close(image):
    """That takes the colours as those of high definition."""
    frame = av.VideoFrame.from_ndarray(image).reformat(format="yuv420p")
    taken = {"src_colorspace": "ITU709", "dst_colorspace": "ITU709"}
    other = frame.reformat(format="rgb24", **taken).to_ndarray()
    assert np.abs(other.astype(int) - image).mean() > 0.5
    assert compare(image, other) == CLOSE


@pytest.mark.parametrize("name", ["test1.jpg", "straight_lines2.jpg"])
def test_an_image_of_another_place_is_another(image, name):
    assert compare(image, read_image(ROOT / "test_images" / name)) == OTHER


def test_a_mirrored_image_is_another(image):
    assert compare(image, np.ascontiguousarray(image[:, ::-1])) == OTHER


def test_an_image_of_another_size_is_another(image):
    assert compare(image, cv2.resize(image, (320, 180))) == OTHER


def test_the_table_has_the_licence_that_a_repository_states(mirror, tmp_path):
    fetched = mirror.fetch(tmp_path)
    assert fetched.licence == "MIT License"
    cells = describe_fetched([fetched]).splitlines()[1].split()
    assert cells[-6:] == ["3", "3", "0", "0", "MIT", "License"]


def test_a_repository_without_a_licence_states_none(mirror, tmp_path):
    repository = tmp_path / "mirror" / REPO
    repository.mkdir(parents=True)
    write_image(repository / "still.png", BENDS.frame(0.0))
    source = source_of(
        BENDS.frame(0.0), "road/0.png", "still.png", commit=commit(repository)
    )
    (fetched,) = fetch_stills(tmp_path, [source], str(tmp_path / "mirror"))
    assert fetched.licence == NOT_STATED


def test_the_reasons_of_what_is_missing_are_counted():
    missing = Fetched("gone/away", missing={"a": "not found", "b": "not found"})
    *_, row, reason = describe_fetched([missing]).splitlines()
    assert row.split()[1:] == ["2", "0", "0", "2", "not", "known"]
    assert reason == "2 missing, gone/away: not found"


def test_without_any_still_the_command_fails(tmp_path, capsys):
    folder = tmp_path / "stills"
    assert main(["fetch", str(folder), "--mirror", str(tmp_path)]) == 1
    assert "no still could be fetched" in capsys.readouterr().out
    assert not (folder / "labels.jsonl").exists()


def test_labels_of_other_stills_are_not_overwritten(tmp_path, capsys):
    labels = tmp_path / "labels.jsonl"
    labels.write_text('{"raw_file": "mine.jpg", "h_samples": [1], "lanes": [[2]]}\n')
    assert main(["fetch", str(tmp_path), "--mirror", str(tmp_path)]) == 2
    assert "mine.jpg" in capsys.readouterr().err
    assert "mine.jpg" in labels.read_text()


WORLD = REAL_DATA / "world"


@pytest.mark.skipif(not WORLD.is_dir(), reason="the stills of the world are not here")
def test_two_sets_of_the_benchmark_are_fetched_and_the_effect_is_said(tmp_path, capsys):
    """Of a mirror with two of the repositories: a clip, and stills."""
    mirror = tmp_path / "mirror"
    chosen = ("muchlisin1412/AutonomousVehicle", "M1K1B/ETS2LaneFollower")
    for source in read_manifest():
        if source.repo in chosen:
            file = mirror / source.repo / source.path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes((WORLD / (source.clip or source.file)).read_bytes())
    for repo in chosen:
        commit(mirror / repo)

    folder = tmp_path / "stills"
    assert main(["fetch", str(folder), "--mirror", str(mirror)]) == 0
    out = capsys.readouterr().out
    assert "10 of 164 stills" in out
    assert "published result of the engine on the stills here" in out
    assert len((folder / "labels.jsonl").read_text().splitlines()) == 10
