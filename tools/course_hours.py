"""How long the course takes: a table for docs/teaching.md, from what is in its
chapters.

    python -m tools.course_hours [NOTEBOOK]

The hours are an estimate: counted words, lines, cells, questions and exercises times
the minutes below. They are for a reader who runs and understands every cell.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from benchmark.tables import markdown_row
from tools.sizes import cell_sources

ROOT = Path(__file__).parents[1]

# Adults read 238 words of English non-fiction a minute (Brysbaert 2019). Half of that
# for text with formulas, and for readers of English as a second language.
WORDS_A_MINUTE = 120
# The rest is set from experience with courses of this kind, and not measured.
MINUTES_A_CODE_LINE = 0.15
MINUTES_A_CELL = 1.0  # run it, look at the result
MINUTES_A_QUESTION = 2.0
MINUTES_AN_EXERCISE = 20.0

HEADINGS = (
    *("chapter", "words", "code cells", "lines of code"),
    *("questions", "exercises", "hours"),
)


@dataclass(frozen=True)
class Chapter:
    """What there is to do in a chapter."""

    title: str
    words: int
    code_cells: int
    code_lines: int
    questions: int
    exercises: int

    @property
    def hours(self) -> float:
        """The estimated time for all of it."""
        minutes = self.words / WORDS_A_MINUTE
        minutes += self.code_lines * MINUTES_A_CODE_LINE
        minutes += self.code_cells * MINUTES_A_CELL
        minutes += self.questions * MINUTES_A_QUESTION
        minutes += self.exercises * MINUTES_AN_EXERCISE
        return minutes / 60


def measure_chapters(notebook: dict) -> list[Chapter]:
    """The chapters of the course, by the names of its cells, ch00-01 and so on."""
    cells: dict[str, list[dict]] = {}
    for cell in notebook["cells"]:
        cells.setdefault(cell["id"][:4], []).append(cell)
    return [_measure_chapter(of_chapter) for of_chapter in cells.values()]


def _measure_chapter(cells: list[dict]) -> Chapter:
    texts = cell_sources(cells, "markdown")
    prose = "\n".join(texts)
    codes = cell_sources(cells, "code")
    heading = re.search(r"^#+ (.*)", prose, re.M)
    lines = [line for code in codes for line in code.splitlines() if line.strip()]
    return Chapter(
        title=heading.group(1) if heading else "",
        words=len(prose.split()),
        code_cells=len(codes),
        code_lines=len(lines),
        questions=prose.count("**Question"),
        exercises=sum("check_exercise(" in code for code in codes),
    )


def hours_table(chapters: Iterable[Chapter]) -> str:
    """A Markdown table with a row for each chapter, and the sum."""
    chapters = list(chapters)
    total = Chapter(
        title="**all**",
        words=sum(chapter.words for chapter in chapters),
        code_cells=sum(chapter.code_cells for chapter in chapters),
        code_lines=sum(chapter.code_lines for chapter in chapters),
        questions=sum(chapter.questions for chapter in chapters),
        exercises=sum(chapter.exercises for chapter in chapters),
    )
    rows = [_row(HEADINGS), _row(["---"] * len(HEADINGS))]
    for chapter in (*chapters, total):
        counts = (chapter.words, chapter.code_cells, chapter.code_lines)
        tasks = (chapter.questions, chapter.exercises)
        rows.append(_row([chapter.title, *counts, *tasks, f"{chapter.hours:.1f}"]))
    return "\n".join(rows)


def _row(fields: Iterable[object]) -> str:
    return markdown_row(map(str, fields))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default = ROOT / "project.ipynb"
    parser.add_argument("notebook", nargs="?", type=Path, default=default)
    path = parser.parse_args().notebook
    notebook = json.loads(path.read_text(encoding="utf-8"))
    print(hours_table(measure_chapters(notebook)))


if __name__ == "__main__":
    main()
