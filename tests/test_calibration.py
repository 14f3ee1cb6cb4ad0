"""Calibration: against the known lens, with every kind of unfit board among the good
ones; report and command.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmark.evaluation import PROJECT_ROOT
from lanes.camera.calibration import (
    BoardDetections,
    calibrate,
    calibrate_boards,
    calibrate_detections,
    describe_calibration,
    find_boards,
)
from lanes.camera.chessboard import Board
from lanes.camera.model import Camera, load_camera, save_camera
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR
from lanes.errors import CameraError, VideoError
from lanes.video.images import read_image, write_image
from lanes.video.sources import find_sources
from lanes.video.writer import VideoWriter
from simulator.chessboards import BOARD_VIEWS, true_corners
from simulator.scenes.freeway import DASHCAM
from tests.support import robot_logs as logs
from tests.support.command_line import run
from tests.support.project import REAL_DATA, names
from tests.support.shapes import intrinsics
from tests.video.sample_videos import set_rotation

SIZE = (1280, 720)
RENDERED = PROJECT_ROOT / "camera_cal"

Boards = dict[str, Board]


def true_board(number: int, noise_px: float = 0.05) -> Board:
    """The corners of rendered board `number` where they truly are, give or take a
    finder's noise.
    """
    noise = np.random.default_rng(number).normal(0, noise_px, (54, 2))
    corners = true_corners(BOARD_VIEWS[number - 1]) + noise
    return Board(corners.astype(np.float32), 9, 6, SIZE)


def true_boards(*numbers: int, noise_px: float = 0.05) -> Boards:
    return {f"board{n}.jpg": true_board(n, noise_px) for n in numbers}


@pytest.fixture
def boards() -> Boards:
    return true_boards(2, 3, 6, 8, 9, 10, 12, 13, 17, 19)


def focal_px(camera: Camera) -> float:
    return camera.matrix[0, 0]


def assert_is_the_dashcam(camera: Camera) -> None:
    np.testing.assert_allclose(
        np.diag(camera.matrix), np.diag(DASHCAM.matrix), rtol=0.002
    )
    np.testing.assert_allclose(camera.matrix[:2, 2], DASHCAM.matrix[:2, 2], atol=2)


# A normal lens.


@pytest.mark.slow
def test_rendered_boards_give_the_lens_they_were_taken_with():
    """All are used, also those that the image border cuts off."""
    camera = calibrate(RENDERED)

    assert_is_the_dashcam(camera)
    assert camera.size == SIZE
    v, u = np.mgrid[0:719:9j, 0:1279:15j].reshape(2, -1)
    pixels = np.column_stack([u, v])
    angle_rad = np.linalg.norm(camera.rays(pixels) - DASHCAM.rays(pixels), axis=1)
    assert np.degrees(angle_rad).max() < 0.05
    assert camera.report.rejected == {}
    assert camera.report.rms_px < 0.1
    used = list(camera.report.board_rms_px)
    assert used == [f"calibration{n}.jpg" for n in range(1, 21)]


@pytest.fixture
def two_threads():
    threads = cv2.getNumThreads()
    cv2.setNumThreads(2)
    yield
    cv2.setNumThreads(threads)


class TestTwoRuns:
    def test_give_the_same_bits(self, boards, two_threads):
        first = calibrate_boards(boards)
        second = calibrate_boards(boards)
        assert first.matrix.tobytes() == second.matrix.tobytes()
        assert first.distortion.tobytes() == second.distortion.tobytes()

    def test_restore_the_threads_of_opencv(self, boards, two_threads):
        calibrate_boards(boards)
        assert cv2.getNumThreads() == 2


def test_errors_are_those_of_the_corners(boards):
    """Noise of 0.05 px in each coordinate leaves an error of 0.05 * sqrt(2) px."""
    report = calibrate_boards(boards).report

    assert list(report.board_rms_px) == list(boards)
    assert report.rejected == {}
    assert report.rms_px == pytest.approx(0.05 * np.sqrt(2), rel=0.1)
    of_boards = np.array(list(report.board_rms_px.values()))
    assert np.sqrt((of_boards**2).mean()) == pytest.approx(report.rms_px)


def test_bad_boards_do_not_excuse_each_other():
    """Three of seven are bad: the mean error of all boards is nearly half as large as
    theirs, the median is not.
    """
    bad = true_boards(3, 9, 12, noise_px=2.0)

    camera = calibrate_boards(true_boards(2, 3, 6, 8, 9, 12, 17) | bad)

    assert set(camera.report.rejected) == set(bad)
    assert_is_the_dashcam(camera)


def test_of_three_boards_none_is_an_outlier():
    """It cannot be decided which one is wrong."""
    boards = true_boards(2, 9) | true_boards(12, noise_px=0.6)

    report = calibrate_boards(boards).report

    assert report.rejected == {}
    errors_px = list(report.board_rms_px.values())
    assert max(errors_px) > 2.5 * np.median(errors_px)


# Two focal lengths.


def zoomed(boards: Boards, names: list[str], scale: float) -> Boards:
    """The boards, some of them taken with a zoom, which enlarges the image about its
    centre.
    """
    centre = (np.array(SIZE) - 1) / 2
    changed = dict(boards)
    for name in names:
        corners = scale * (boards[name].corners_px - centre) + centre
        changed[name] = replace(boards[name], corners_px=corners.astype(np.float32))
    return changed


def groups_in(message: str) -> dict[float, set[str]]:
    """The names of the images by the focal length in a message, pixels."""
    lines = re.findall(r"^  (\d+) px: (.+)$", message, re.MULTILINE)
    return {float(focal_px): set(names.split(", ")) for focal_px, names in lines}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("which", "scale"),
    [
        (slice(1, None, 2), 0.85),
        (slice(1, None, 2), 0.5),
        (slice(5), 0.9),
        (slice(3), 1.2),
    ],
)
def test_boards_of_two_focal_lengths_are_refused_with_the_files_of_each(
    boards, which, scale
):
    names = list(boards)[which]
    others = set(boards) - set(names)

    with pytest.raises(CameraError, match="the boards have two focal lengths") as found:
        calibrate_boards(zoomed(boards, names, scale))

    (short_px, short), (long_px, long) = groups_in(str(found.value)).items()
    smaller = min(scale, 1.0) * focal_px(DASHCAM)
    larger = max(scale, 1.0) * focal_px(DASHCAM)
    smaller_names = set(names) if scale < 1 else others
    # a frontal board has any focal length
    assert len(short ^ smaller_names) <= 1
    assert short | long == set(boards)
    assert short_px == pytest.approx(smaller, rel=0.01)
    assert long_px == pytest.approx(larger, rel=0.01)


def test_a_bad_board_does_not_hide_two_focal_lengths(boards):
    names = list(boards)[::2]
    with_bad = zoomed(boards, names, 0.85) | true_boards(4, noise_px=3.0)
    with pytest.raises(CameraError, match="two focal lengths"):
        calibrate_boards(with_bad)


def test_boards_of_which_one_was_zoomed_give_the_lens_of_the_others(boards):
    """A frontal board has any focal length, and would be the second of its group."""
    del boards["board6.jpg"]
    camera = calibrate_boards(zoomed(boards, ["board9.jpg"], 0.85))
    assert list(camera.report.rejected) == ["board9.jpg"]
    assert_is_the_dashcam(camera)


def test_a_focus_that_changes_the_focal_length_a_little_is_accepted(boards):
    camera = calibrate_boards(zoomed(boards, list(boards)[::2], 1.02))
    assert focal_px(camera) == pytest.approx(1.01 * focal_px(DASHCAM), rel=0.01)


@pytest.fixture(scope="module")
def real_boards() -> Boards:
    if not (REAL_DATA / "camera_cal").is_dir():
        pytest.skip("Udacity's boards are not there")
    files = find_sources([str(REAL_DATA / "camera_cal")]).files
    return find_boards(files).boards


@pytest.mark.slow
@pytest.mark.parametrize("count", [5, 7, 10, 15, 20])
def test_real_boards_on_paper_have_one_focal_length(real_boards, count):
    """Paper on a wall bends: each board alone has its own focal length."""
    rng = np.random.default_rng(count)
    names = rng.choice(list(real_boards), count, replace=False)
    camera = calibrate_boards({name: real_boards[name] for name in names})
    assert len(camera.report.board_rms_px) >= count - 2


@pytest.mark.slow
def test_real_boards_of_two_focal_lengths_are_refused(real_boards):
    names = list(real_boards)[1::2]

    with pytest.raises(CameraError, match="two focal lengths") as found:
        calibrate_boards(zoomed(real_boards, names, 0.85))

    (short_px, short), (long_px, _) = groups_in(str(found.value)).items()
    assert (short_px, long_px) == pytest.approx((987, 1162), rel=0.01)
    assert len(short ^ set(names)) <= 2


# Wide lenses.


def wide_boards(fov_deg: float) -> tuple[Camera, Boards]:
    """A fisheye lens, and fourteen boards all over its image, with a finder's noise."""
    rng = np.random.default_rng(1)
    wide_px = 640 / np.radians(fov_deg / 2)
    matrix = intrinsics(wide_px, wide_px, 650, 350)
    camera = Camera(*SIZE, matrix, np.array([0.02, -0.01, 0.003, -0.001]))
    points = true_board(1).object_points - [4, 2.5, 0]
    boards = {}
    while len(boards) < 14:
        direction = camera.rays(rng.uniform(0.1, 0.9, (1, 2)) * SIZE)
        turn = rng.uniform(-0.7, 0.7, 3)
        distance = rng.uniform(6, 16)
        shift = distance * direction / np.linalg.norm(direction)
        corners, _ = cv2.fisheye.projectPoints(
            points[None], turn, shift, matrix, camera.distortion
        )
        inside = (corners > 5) & (corners < np.subtract(SIZE, 6))
        if inside.all():
            noisy = corners[0] + rng.normal(0, 0.2, (54, 2))
            board = Board(noisy.astype(np.float32), 9, 6, SIZE)
            boards[f"{len(boards)}.jpg"] = board
    return camera, boards


@pytest.mark.parametrize(
    ("fov_deg", "is_fisheye"), [(60, False), (100, False), (140, True)]
)
def test_wide_lenses_get_the_model_that_fits(fov_deg, is_fisheye):
    true, boards = wide_boards(fov_deg)

    camera = calibrate_boards(boards)

    assert focal_px(camera) == pytest.approx(focal_px(true), rel=0.005)
    assert camera.is_fisheye == is_fisheye
    assert camera.report.rejected == {}
    assert camera.report.rms_px < 0.4


def test_the_field_of_view_of_a_wide_lens_is_found():
    true, boards = wide_boards(140)
    assert calibrate_boards(boards).hfov_deg == pytest.approx(true.hfov_deg, abs=1)


@pytest.fixture
def partly_doubtful() -> tuple[Camera, Boards]:
    """A fisheye lens, and boards of which every second is doubtful, and one is none."""
    camera, boards = wide_boards(175)
    for name in list(boards)[::2]:
        boards[name] = replace(boards[name], doubtful=True)
    # one row of corners is skipped, and the last one repeated nine pixels lower
    board = boards["4.jpg"]
    grid = board.corners_px.reshape(6, 9, 2)
    skipped = grid[[0, 1, 2, 4, 5, 5]]
    skipped[-1] += (0, 9)
    boards["wrong.jpg"] = replace(board, corners_px=skipped.reshape(-1, 2))
    return camera, boards


def test_doubtful_boards_are_used_if_a_fisheye_lens_explains_them(partly_doubtful):
    true, boards = partly_doubtful

    camera = calibrate_boards(boards)

    assert camera.is_fisheye
    assert focal_px(camera) == pytest.approx(focal_px(true), rel=0.005)
    assert list(camera.report.rejected) == ["wrong.jpg"]
    assert "it is no board" in camera.report.rejected["wrong.jpg"]


def test_doubtful_boards_are_used_if_the_others_are_too_few(partly_doubtful):
    """Two sure boards alone do not determine a lens."""
    _, boards = partly_doubtful
    for name in ("5.jpg", "7.jpg", "9.jpg", "11.jpg", "13.jpg"):
        del boards[name]

    camera = calibrate_boards(boards)

    assert len(camera.report.board_rms_px) == 9


# Boards that determine no lens, or hardly.


def crumpled() -> Boards:
    """Each board bends in another way."""
    rng = np.random.default_rng(0)
    _, boards = wide_boards(100)
    for name, board in boards.items():
        bent = board.corners_px + rng.normal(0, 4, (54, 2))
        boards[name] = replace(board, corners_px=bent.astype(np.float32))
    return boards


def without_tilt() -> Boards:
    board = true_board(6)
    grid = board.object_points[:, :2] * 30
    boards = {}
    for n in range(4):
        moved = grid + np.float32([100 + 300 * n, 200])
        boards[f"{n}.jpg"] = replace(board, corners_px=moved)
    return boards


def repeated() -> Boards:
    return {f"{n}.jpg": true_board(6, noise_px=0.05 + 0.01 * n) for n in range(4)}


def noisy() -> Boards:
    return true_boards(1, 6, 17, noise_px=0.8)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (repeated, r"1 different view\(s\)"),
        (without_tilt, "tilted"),
        (
            crumpled,
            r"neither a normal nor a fisheye lens "
            r"\(error \d\.\d\d px, at most 3\.2\)",
        ),
        (noisy, r"do not determine the focal length \(\d+ \+- \d+ px\)"),
    ],
)
def test_boards_that_determine_no_lens_are_refused(make, words):
    with pytest.raises(CameraError, match=words):
        calibrate_boards(make())


def detected(boards: Boards, **unused: str) -> BoardDetections:
    tile = np.full((225, 400, 3), 128, np.uint8)
    tiles = dict.fromkeys([*boards, *unused], tile)
    return BoardDetections(tiles, (9, 6), boards, unused)


# Two of them are hardly tilted.
THREE = true_boards(1, 6, 17, noise_px=0.25)


@pytest.fixture(scope="module")
def camera() -> Camera:
    return calibrate_boards(THREE)


class TestThreeBoards:
    def test_leave_an_uncertain_focal_length(self, camera):
        share = camera.report.focal_std_share
        assert 0.02 < share < 0.04
        ratio = focal_px(camera) / focal_px(DASHCAM)
        assert abs(ratio - 1) < 3 * share

    def test_leave_its_uncertainty_in_the_file(self, camera, tmp_path):
        loaded = load_camera(save_camera(camera, tmp_path / "camera.yaml"))
        share = camera.report.focal_std_share
        assert loaded.report.focal_std_share == pytest.approx(share, abs=1e-4)

    def test_cause_a_warning(self, camera):
        text = describe_calibration(detected(THREE), camera)
        share = camera.report.focal_std_share
        assert f"warning: the focal length is uncertain by {share:.1%}" in text

    def test_cause_none_with_less_noise(self):
        boards = true_boards(1, 6, 17)
        text = describe_calibration(detected(boards), calibrate_boards(boards))
        assert "warning" not in text


# The report.


@pytest.fixture(scope="module")
def described() -> tuple[Camera, str]:
    """A camera, and the text about it and about the use of unlike images."""
    boards = true_boards(2, 3, 6, 8, 9, 10, 12, 13, 17, 19)
    # its error is not that of all
    boards["board2.jpg"] = true_board(2, noise_px=0.1)
    # seen in part
    grid = boards["board17.jpg"].corners_px.reshape(6, 9, 2)
    part = grid[1:, 3:].reshape(-1, 2)
    boards["board17.jpg"] = Board(part, 6, 5, SIZE)
    # cut a pixel later
    boards["board8.jpg"] = replace(boards["board8.jpg"], size=(1281, 721))
    boards["board10.jpg"] = replace(boards["board10.jpg"], size=(640, 480))
    # bent
    boards["board9.jpg"].corners_px[::7] += 6
    detections = detected(boards, wall="no chessboard")
    camera = calibrate_detections(detections, "here")
    return camera, describe_calibration(detections, camera)


@pytest.mark.parametrize(
    ("name", "use"),
    [
        ("board17.jpg", r"0\.\d\d  used, 6x5 corners of the board$"),
        ("board8.jpg", r"0\.\d\d  used, image of 1281x721$"),
        ("board10.jpg", "-  image is 640x480 pixels, the others 1280x720"),
        ("board9.jpg", r"-  error \d\.\d\d px, more than 2.5 times"),
        ("wall", "-  no chessboard$"),
    ],
)
def test_the_use_of_each_image_is_described(described, name, use):
    _, text = described
    assert re.search(rf"^{name} +{use}", text, re.MULTILINE)


def test_an_image_is_described_with_its_error(described):
    camera, text = described
    error_px = camera.report.board_rms_px["board2.jpg"]
    assert re.search(rf"^board2.jpg +{error_px:.2f}  used$", text, re.MULTILINE)


@pytest.mark.parametrize(
    "words", ["8 of 11 images used, error 0.0", "focal length 115"]
)
def test_the_calibration_is_described(described, words):
    _, text = described
    assert words in text


# The commands.


@pytest.mark.slow
def test_a_video_of_a_board_is_used(tmp_path):
    """Its frames that differ most; a phone films it turned."""
    shown = [2, 2, 2, 9, 12, 12, 12, 13, 6, 6]
    with VideoWriter(tmp_path / "upright.mp4", fps=25) as writer:
        for number in shown:
            writer.write(read_image(RENDERED / f"calibration{number}.jpg"))
    set_rotation(tmp_path / "upright.mp4", tmp_path / "turned.mp4", 90)

    camera = calibrate(tmp_path / "turned.mp4")

    assert_is_the_dashcam(camera)
    used = []
    for name in camera.report.board_rms_px:
        (time_s,) = re.fullmatch(r"turned\.mp4 at (.*) s", name).groups()
        used.append(shown[round(25 * float(time_s))])
    assert used == [2, 9, 12, 13, 6]


@pytest.fixture(scope="module", params=["boards.mcap", "boards"])
def log_of_two(request, tmp_path_factory) -> Path:
    """A robot log with boards before one camera and a wall before another; a file, or
    the folder of a recording.
    """
    shown = [read_image(RENDERED / f"calibration{n}.jpg") for n in (2, 9, 12, 13, 6)]
    wall = np.full((36, 64, 3), 128, np.uint8)
    stamps_ns = logs.stamps_at(np.arange(5) / 2)
    topics = {
        "/front/image_raw": logs.stamp_images(shown, stamps_ns, ".png"),
        "/rear/image_raw": logs.stamp_images([wall] * 5, stamps_ns),
    }
    path = tmp_path_factory.mktemp("log") / request.param
    return logs.write_messages(path, topics)


@pytest.mark.slow
class TestALogOfTwoCameras:
    def test_is_calibrated_with_the_topic(self, log_of_two, tmp_path):
        options = ("--topic", "/front/image_raw", "-o", tmp_path / "lens.yaml")
        status, _, err = run("calibrate", log_of_two, *options)
        assert status == 0, err
        assert_is_the_dashcam(load_camera(tmp_path / "lens.yaml"))

    def test_needs_a_topic_that_the_command_has(self, log_of_two):
        status, _, err = run("calibrate", log_of_two)
        _, text, _ = run("calibrate", "--help")
        assert status == 2
        assert "/front/image_raw, /rear/image_raw; choose one of them with --top" in err
        assert "--topic NAME" in text

    def test_gives_the_boards_of_other_commands_by_the_topic(self, log_of_two, folder):
        """Of stills, which have no topics; the wall shows no board."""
        options = ("--boards", log_of_two, "--topic", "/rear/image_raw")
        status, _, err = run("pose", *options, folder / "a.png")
        assert status == 2
        assert "no chessboard of 9x6 inner corners was found" in err


def test_a_topic_of_images_is_refused(folder):
    with pytest.raises(VideoError, match="is no robot log and has no topics"):
        calibrate(folder / "a.png", topic="/front")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Five boards, two walls, a board of another shape, and a damaged file."""
    folder = tmp_path_factory.mktemp("boards")
    for name, number in {"a": 2, "b": 9, "c": 12, "d": 13, "e": 6}.items():
        board = read_image(RENDERED / f"calibration{number}.jpg")
        write_image(folder / f"{name}.png", board)
    wall = np.full((360, 640, 3), 128, np.uint8)
    write_image(folder / "wall.png", wall)
    write_image(folder / "more" / "wall.png", wall)
    write_image(folder / "square.png", cv2.resize(board, (640, 480)))
    (folder / "broken.jpg").write_bytes(b"\xff\xd8 cut off")
    return folder


@pytest.fixture(scope="module")
def out(folder) -> str:
    outputs = ("--sheet", "out/sheet.png", "-o", "out/lens.yaml")
    status, out, err = run("calibrate", ".", "more", *outputs, cwd=folder)
    assert status == 0, err
    return out


class TestAFolderOfBoards:
    def test_gives_a_camera_file(self, folder, out):
        camera = load_camera(folder / "out" / "lens.yaml")
        assert focal_px(camera) == pytest.approx(focal_px(DASHCAM), rel=0.01)

    @pytest.mark.parametrize(
        ("name", "use"),
        [
            ("a.png", "  used\n"),
            ("wall.png", "-  no chessboard of 9x6 inner corners, nor a part of one\n"),
            (
                "more/wall.png",
                "-  no chessboard of 9x6 inner corners, nor a part of one\n",
            ),
            ("square.png", "pixels, the others 1280x720; take all with one setting"),
            ("broken.jpg", "broken.jpg: cannot be decoded as an image"),
        ],
    )
    def test_gives_a_table_of_the_images(self, out, name, use):
        assert re.search(rf"^{name} .*{use}", out, re.MULTILINE)

    @pytest.mark.parametrize(
        "words",
        [
            "5 of 9 images used, error 0.",
            "no corners in these regions of the image: upper left, upper right, left, "
            "lower left, bottom, lower r",
        ],
    )
    def test_gives_a_summary(self, out, words):
        assert words in out

    def test_gives_the_names_of_the_outputs(self, out):
        assert out.endswith("wrote out/lens.yaml\nwrote out/sheet.png\n")

    def test_gives_a_sheet_with_a_frame_for_each_image(self, folder, out):
        sheet = read_image(folder / "out" / "sheet.png")
        assert sheet.shape == (2 * (225 + 44 + 12), 5 * (400 + 12), 3)
        frames = [LANE_COLOUR, LANE_COLOUR, LEFT_COLOUR, LANE_COLOUR, LANE_COLOUR]
        np.testing.assert_array_equal(sheet[3, 3 :: 400 + 12], frames)


@pytest.fixture(scope="module")
def refused(folder) -> tuple[int, str, str]:
    images = ("a.png", "b.png", "wall.png")
    outputs = ("--sheet", "refused/sheet.png", "-o", "refused/lens.yaml")
    return run("calibrate", *images, *outputs, cwd=folder)


class TestARefusedCalibration:
    def test_says_why(self, refused):
        status, _, err = refused
        assert status == 2
        assert "at least 3, better 15" in err

    def test_writes_only_the_sheet(self, folder, refused):
        _, out, _ = refused
        assert out == "wrote refused/sheet.png\n"
        assert names(folder / "refused") == {"sheet.png"}

    def test_gives_a_sheet_that_shows_where_a_board_was_found(self, folder, refused):
        sheet = read_image(folder / "refused" / "sheet.png")
        a, b, wall = sheet[3, 3 :: 400 + 12].tolist()
        assert a == b
        assert b != wall
