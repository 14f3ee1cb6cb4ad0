"""Hand labels of the ego lane's two lines, marked in a local web page (`python -m lanes label`).

From the inside out: a line through clicked points; the labels on disk (`labels.jsonl`, TuSimple JSON lines), and marks
that are not labels yet; the server of the page. It answers this machine only, and its address holds a random token.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from threading import Thread
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler

from lanes.detect.birdseye import lightness, yellowness
from lanes.drive import DriveSettings, detect_stills
from lanes.errors import LaneError
from lanes.files import locked, read_json_lines, translate_write_errors, write_json_lines
from lanes.labels import NO_POINT, as_detection
from lanes.video.images import read_image, write_image
from lanes.video.sources import Sources, sample_images

# A line through points: a smooth curve, snapped to the paint near it, in the raw image. On a flat road its curvature is
# a random walk along the road (a smoothing spline: G. Wahba, Journal of the Royal Statistical Society B 40, 1978); the
# errors of points and paint say how near it comes to them.

# In pixels of an image 720 px high: reach of the snap at 0.4 of the height and above, and at the bottom; widest paint.
SNAP_PX, WIDEST_PX = (6.0, 16.0), 37
# Standard deviations across the line of clicked points and of paint, in pixels of an image 720 px high.
POINT_PX, PAINT_PX = 2.0, 0.7
# A usual camera: focal length, and the horizon above the highest point, in image heights; its own height in metres.
FOCAL, TO_HORIZON, CAMERA_M = 1.5, 0.04, 1.4
# Standard deviations of the curvature at the car, 1/m, and of its change over a metre, 1/m^1.5. With a third of the
# latter the RMS error is 2.2 px instead of 1.6 in a painted hairpin of 25 m radius. With three times as much it is
# 0.54 px instead of 0.40 in a bend of 200 m.
CURVATURE, CURVATURE_CHANGE = 0.05, 0.001
MIN_CONTRAST, MIN_RATIO = 8.0, 4.0  # of paint with both its sides: grey levels, and times the noise


def label_rows(height: int) -> np.ndarray:
    """The labelled rows (R,) int of an image, at 720 px those of TuSimple: 160, 170, ... 710."""
    return np.arange(16 * (step := max(round(height / 72), 1)), height, step)


def fit_line(image: np.ndarray, points: ArrayLike) -> np.ndarray:
    """Columns (R,) at `label_rows` of a line through `points` (N, 2), column and row, in an RGB image; -2 without."""
    labelled, (u, v) = label_rows(len(image)), np.array(points, float).reshape(-1, 2).T
    half = (labelled[1] - labelled[0]) / 2
    if len(v) < 2 or np.ptp(v) < 2 * half:  # within one row step
        return np.full(len(labelled), NO_POINT)
    rows = half * np.arange(np.floor(v.min() / half), np.ceil(v.max() / half) + 1)
    columns = _smooth(rows, u, v, np.full(len(v), POINT_PX), len(image))
    for _ in range(3):  # a curve on the paint of some rows comes near that of the next ones
        paint = find_paint(image, rows, columns)
        seen = np.isfinite(paint)
        beside = np.abs(v[:, None] - rows[seen]).min(axis=1, initial=np.inf) >= half  # points without paint
        at, errors_px = np.append(v[beside], rows[seen]), np.repeat([POINT_PX, PAINT_PX], [beside.sum(), seen.sum()])
        errors_px *= np.interp(at, rows, np.hypot(1, np.gradient(columns, rows)))  # along the row
        columns = _smooth(rows, np.append(u[beside], paint[seen]), at, errors_px, len(image))
    at = np.interp(labelled, rows, columns, left=NO_POINT, right=NO_POINT).round(1)
    return np.where((at >= 0) & (at <= image.shape[1] - 1), at, NO_POINT)


def find_paint(image: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns (R,) near `columns` (R,), at `rows` (R,), of paint, brighter or yellower than both sides; NaN without."""
    scale, ratios = len(image) / 720, []
    reach_px = scale * np.interp(rows, [0.4 * len(image), len(image)], SNAP_PX)[:, None]
    reach_px *= np.hypot(1, np.gradient(columns, rows)).clip(max=3)[:, None]  # across the line, not along the row
    widths = range(3, max(round(WIDEST_PX * scale), 3) + 1, 2 * max(round(scale), 1))
    shifts, margin = np.arange(-int(reach_px.max()), int(reach_px.max()) + 1), 2 * widths[-1]
    x = (columns[:, None] + np.arange(shifts[0] - margin, shifts[-1] + margin + 1)).astype(np.float32)
    strips = cv2.remap(image, x, np.tile(rows[:, None], x.shape[1]).astype(np.float32), cv2.INTER_LINEAR)
    for profiles in (lightness(strips).astype(np.float32), yellowness(strips).astype(np.float32)):
        noise = 1 + np.median(np.abs(np.diff(profiles)), axis=1, keepdims=True)
        for width in widths:
            mean = cv2.blur(profiles, (width, 1))
            contrast = (mean - np.maximum(np.roll(mean, width, 1), np.roll(mean, -width, 1)))[:, margin:-margin]
            ratio = contrast * np.sqrt(width) / noise * (1 - 0.5 * (shifts / reach_px) ** 2)
            ratios.append(np.where((contrast < MIN_CONTRAST) | (np.abs(shifts) > reach_px), 0, ratio))
    best = np.max(ratios, axis=0)
    return np.where(best.max(axis=1) > MIN_RATIO, columns + shifts[best.argmax(axis=1)], np.nan)


def _smooth(rows: np.ndarray, u: np.ndarray, v: np.ndarray, errors_px: np.ndarray, height: int) -> np.ndarray:
    """Columns (R,) at evenly spaced `rows` (R,) of the most probable line, given points (u, v) with errors, (N,) each.

    The flat road in a row is FOCAL * CAMERA_M / depth ahead, with the row's `depth` below the horizon in image heights.
    Its curvature is thus proportional to the second derivative of the columns times the cube of `depth`.
    """
    step, depth = rows[1] - rows[0], (rows[1:-1] - rows[0]) / height + TO_HORIZON
    share = (1 - np.abs(v[:, None] - rows) / step).clip(0)  # of the rows next to each point
    second = np.diff(np.eye(len(rows)), 2, axis=0) * height / step**2
    curvature = second * depth[:, None] ** 3 / (FOCAL**2 * CAMERA_M)
    change = np.diff(curvature, axis=0) / np.sqrt(-np.diff(FOCAL * CAMERA_M / depth))[:, None]
    weights = 720 / height / errors_px
    equations = np.vstack([share * weights[:, None], change / CURVATURE_CHANGE, curvature[-1:] / CURVATURE])
    return np.linalg.lstsq(equations, np.pad(u * weights, (0, len(rows) - 2)), rcond=None)[0]


# A session: stills, and their labels on disk.


def pick_stills(video: Path, settings: DriveSettings, count: int) -> Iterator[Path]:
    """Yield the paths of frames spread over a part of a video, written as PNG; those of an earlier session stay."""
    part: dict[str, Any] = {"start_s": settings.start_s, "end_s": settings.end_s, "topic": settings.topic}
    for k, image in enumerate(sample_images([video], count, **part), 1):
        path = settings.output / f"{video.stem}_{k:02d}_of_{count}.png"
        if not path.exists():
            write_image(path, image)
        elif (other := read_image(path)).shape != image.shape or cv2.PSNR(other, image) < 30:  # of another decoder: 38
            raise LaneError(f"{path}: is no frame of this part of {video}; give another output folder (-o).")
        yield path


class Session:
    """Labels of `stills` in `folder`; labels of other images stay. Raises LaneError if a file cannot be used."""

    def __init__(self, folder: Path, stills: Sequence[Path]) -> None:
        self.stills = [path.resolve() for path in stills]
        if outside := [path for path in self.stills if not path.is_relative_to(folder.resolve())]:
            raise LaneError(f"{outside[0]}: lies outside of {folder}, the folder of the labels; give its folder (-o).")
        self._names = [path.relative_to(folder.resolve()).as_posix() for path in self.stills]
        self._files = _LabelFile(folder / "labels.jsonl"), _LabelFile(folder / "unsaved.jsonl")

    def saved(self) -> list[bool]:
        """Whether each still has a label without unsaved changes."""
        labels, unsaved = (file.labels for file in self._files)
        return [name in labels and name not in unsaved for name in self._names]

    def label(self, k: int) -> dict[str, Any]:
        """The label of still `k`, or what its unsaved marks would be as one; also `saved`."""
        labels, unsaved = (file.labels for file in self._files)
        label = (labels | unsaved).get(self._names[k]) or self._fit(k, [[], []])
        return {"points": [[], []]} | label | {"saved": self.saved()}

    def propose(self, k: int) -> dict[str, Any]:
        """The marks of the still before `k`, moved to the paint of still `k`, as a `label`; nothing is written.

        Raises LaneError if there are none, or if the stills differ in size.
        """
        points = self.label(k - 1)["points"] if k else [[], []]
        if points == [[], []]:
            raise LaneError("The still before this one has no points to copy.")
        if len({read_image(self.stills[number]).shape for number in (k - 1, k)}) > 1:
            raise LaneError("The still before this one has another size, so its points cannot be copied.")
        label = self._fit(k, points)
        rows, lines = np.array(label["h_samples"]), zip(points, label["lanes"], strict=True)
        return label | {"points": [_move(mark, rows, np.array(line)) for mark, line in lines]}

    def mark(self, k: int, points: Any, save: bool) -> dict[str, Any]:
        """Write the `points` of both lines (None: not visible), with `save` as a label; returns `label`.

        Raises LaneError for invalid marks, for a label that was compared, and if another program changed it.
        """
        name, label, (labels, unsaved) = self._names[k], self._fit(k, points), self._files
        if labels.labels.get(name, {}).get("compared"):
            raise LaneError("Our lines were shown, so this label stays as it is.")
        if not save:
            unsaved.change(name, label)
            return self.label(k)
        if any(mark is not None and max(line) < 0 for mark, line in zip(points, label["lanes"], strict=True)):
            raise LaneError("Mark each line with two or more points, or as not visible.")
        labels.change(name, label)
        unsaved.change(name, None)
        return self.label(k)

    def compare(self, k: int) -> None:
        """Note that the label of still `k` was compared with our lines; it cannot be changed from now on."""
        labels = self._files[0]
        label = labels.labels[self._names[k]]
        if not label.get("compared"):
            labels.change(self._names[k], label | {"compared": True})

    def _fit(self, k: int, points: Any) -> dict[str, Any]:
        image = read_image(self.stills[k])
        lines = _require_marks(points, image.shape[1::-1])
        left, right = (fit_line(image, line).tolist() for line in lines)
        rows = label_rows(len(image)).tolist()
        return {"raw_file": self._names[k], "h_samples": rows, "lanes": [left, right], "points": points}


class _LabelFile:
    """The labels in a file by the name of their image; lines that other programs add or change stay."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.labels = _read_labels(path)

    def change(self, name: str, label: dict[str, Any] | None) -> None:
        """Write a label, or remove it (None); memory and disk agree afterwards, also if writing fails."""
        there = _read_labels(self._path)
        known, self.labels = self.labels, there
        if there.get(name) != known.get(name):
            raise LaneError(f"{name}: another program changed its label in {self._path.name}; open this still again.")
        labels = there | {name: label} if label else {other: line for other, line in there.items() if other != name}
        if labels != there:
            write_json_lines(self._path, labels.values())
            self.labels = labels


def _require_marks(points: Any, size: tuple[int, int]) -> list[np.ndarray]:
    """The marks of both lines, (N, 2) each, if all are points in an image of `size` (width, height)."""
    try:
        if len(points) != 2 or max(map(len, filter(None, points)), default=0) > 1000:  # nobody clicks as many
            raise ValueError
        lines = [np.array(mark or np.empty((0, 2)), float) for mark in points]
        inside = [line.shape[1:] == (2,) and ((line >= -1) & (line <= size)).all() for line in lines]
    except (TypeError, ValueError):
        inside = [False]
    if not all(inside):
        raise LaneError(
            "Marks are two lists of points in the picture, [column, row]; null for one that is not visible."
        )
    return lines


def _move(mark: list | None, rows: np.ndarray, line: np.ndarray) -> list | None:
    """The points of a mark, moved along the rows to a line with columns (R,) at `rows`, as far as it goes."""
    seen = line >= 0
    if not mark or not seen.any():
        return mark
    at = np.clip(np.array(mark)[:, 1], *rows[seen][[0, -1]])
    return np.stack([np.interp(at, rows[seen], line[seen]), at], axis=1).round(1).tolist()


def _read_labels(path: Path) -> dict[str, dict[str, Any]]:
    try:
        lines = read_json_lines(path, "label") if path.exists() else ()
        return {label["raw_file"]: label for _, label in lines}
    except (ValueError, TypeError, LookupError) as error:
        raise LaneError(f"{path}: its labels cannot be used ({error}); repair it, or move it away.") from error


# The server of the page.


def label_stills(sources: Sources, settings: DriveSettings, count: int, *, browser: bool = True) -> str:
    """Label stills, and `count` frames of each video, in the settings' output folder; returns a summary in words."""
    labels = settings.output / "labels.jsonl"
    with ExitStack() as session_is_open:
        with translate_write_errors(labels):
            settings.output.mkdir(parents=True, exist_ok=True)
            session_is_open.enter_context(locked(settings.output / "labels.session.lock"))
        picked = [still for video in sources.videos for still in pick_stills(video, settings, count)]
        session = Session(settings.output, [*sources.stills, *picked])
        with suppress(KeyboardInterrupt):
            asyncio.run(_serve(session, settings, browser))
    return f"{sum(session.saved())} of {len(session.stills)} stills have a label in {labels}"


async def _serve(session: Session, settings: DriveSettings, browser: bool) -> None:
    root, ended, found = f"/{secrets.token_urlsafe()}", asyncio.Event(), dict[Path | None, Any]()
    search = Thread(target=_find_our_lines, args=(session.stills, settings, found), daemon=True)

    def ours(k: int) -> dict[str, Any]:
        if not session.saved()[k]:
            return {"error": "Save the label first: it must not depend on our lines."}
        if not search.ident:
            search.start()
        if session.stills[k] in found:
            session.compare(k)
        return found.get(session.stills[k]) or found.get(None) or {}

    get = {"still": session.label, "proposal": session.propose, "ours": ours}
    pages = Application(log_function=lambda _: None, get=get, session=session, ended=ended)
    page = rf"{root}/(label\.(?:html|css|js))", Page, {"path": Path(__file__).parent / "show" / "pages"}
    # No other host: another site could give its own name the address of this machine (DNS rebinding).
    pages.add_handlers(r"127\.0\.0\.1", [page, (rf"{root}/(still|picture|proposal|ours|end)/(\d+)", Answer)])
    (socket,) = bind_sockets(0, "127.0.0.1")
    HTTPServer(pages, max_body_size=1_000_000).add_socket(socket)  # a thousand points have 20 kB
    print(f"the page is at {(address := f'http://127.0.0.1:{socket.getsockname()[1]}{root}/label.html')}", flush=True)
    if browser:
        Thread(target=webbrowser.open, args=(address,), daemon=True).start()
    await ended.wait()


def _find_our_lines(stills: Sequence[Path], settings: DriveSettings, found: dict[Path | None, Any]) -> None:
    """Put the detection in each still into `found`, by path; in the end, as None, a sentence for stills without."""
    failures: list[Any] = []
    try:
        for still in detect_stills(stills, settings, failures):
            lane, camera, rows = still.detection.lane, still.detection.camera, label_rows(len(still.image))
            found[still.path] = as_detection(lane, camera, rows, still.run_time_ms)
    except Exception as error:  # labelling goes on without a comparison
        failures.append(error)
    found[None] = {"error": " ".join(map(str, ["Our lines cannot be shown.", *failures]))}


class Page(StaticFileHandler):
    """The files of the page."""

    def set_default_headers(self) -> None:
        self.set_header("X-Content-Type-Options", "nosniff")


class Answer(RequestHandler):
    """GET: label, picture, proposal or our lines of a still. POST: marks of a still, or the end."""

    def set_default_headers(self) -> None:
        # Whatever a file in the folder is, the browser must not run it as a page of this server.
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cache-Control", "no-store")

    def get(self, what: str, number: str) -> None:
        still = self._require_still(number)
        if what == "end":
            raise HTTPError(404)
        if what != "picture":
            self.write(self.settings["get"][what](still))
            return
        picture = self.settings["session"].stills[still]
        suffix = picture.suffix.lower().removeprefix(".")
        self.set_header("Content-Type", f"image/{'jpeg' if suffix.startswith('j') else suffix}")
        self.write(picture.read_bytes())

    def post(self, what: str, number: str) -> None:
        if what == "end":
            asyncio.get_running_loop().call_later(0.1, self.settings["ended"].set)  # after the answer
            return
        still = self._require_still(number)
        try:
            marks = json.loads(self.request.body)
        except (ValueError, RecursionError):
            marks = None
        if not isinstance(marks, dict) or marks.keys() != {"points", "save"}:
            raise LaneError("Marks are a JSON object with points and save.")
        self.write(self.settings["session"].mark(still, **marks))

    def _require_still(self, number: str) -> int:
        if len(number) > 9 or int(number) >= len(self.settings["session"].stills):
            raise HTTPError(404)
        return int(number)

    def write_error(self, status_code: int, **more: Any) -> None:
        """A sentence, which the page shows; 400 for marks or an image that cannot be used."""
        error = more["exc_info"][1]
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        if isinstance(error, LaneError | OSError):
            self.set_status(400 if isinstance(error, LaneError) else 500)
            text = str(error)
        else:
            text = "There is no such still." if status_code == 404 else "The server failed; start it again."
        self.finish(text)

    def log_exception(self, *_: Any) -> None: ...
