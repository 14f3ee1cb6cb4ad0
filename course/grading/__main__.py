"""Grade notebooks of students: run each with nbval, and print which exercises are
passed.

The notebooks are code of strangers, which is executed: docs/teaching.md says how to
isolate it. A notebook is run in a temporary copy of the course. Exit status 0 if every
exercise is passed and all other cells are those of the course, else 1.
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import nbformat

from benchmark.evaluation import PROJECT_ROOT
from course.grading.grade import PASSED, Verdict, grade_notebook
from course.grading.submission import (
    Course,
    read_course,
    read_notebook,
    without_solutions,
)
from lanes.console import bounded, run_command, run_program
from lanes.files import write_atomically

EXAMPLES = """\
  {program} anna.ipynb ben.ipynb
  {program} --csv grades.csv handed_in/
  {program} --hand-out for_students.ipynb"""

NAME_WIDTH, RESULT_WIDTH, TABLE_WIDTH = 13, 18, 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this command."""
    notebooks = "notebook of a student, or folder: all notebooks in it and below"
    parser.add_argument(
        "notebooks", nargs="*", type=Path, metavar="NOTEBOOK", help=notebooks
    )
    hand_out = "write the course without its folded solutions to this file and exit"
    parser.add_argument("--hand-out", type=Path, metavar="FILE", help=hand_out)
    table = "also write the table to this file"
    parser.add_argument("--csv", type=Path, metavar="FILE", help=table)
    timeout = (
        "a cell that runs longer than this is interrupted and is wrong "
        "(default: %(default)g s)"
    )
    parser.add_argument(
        "--cell-timeout",
        type=bounded(float, 1),
        default=300.0,
        metavar="S",
        help=timeout,
    )


def run(options: argparse.Namespace) -> int:
    """Grade, print the table and write the file; or write the notebook to hand out."""
    notebook = PROJECT_ROOT / "project.ipynb"
    if options.hand_out:
        for_students = without_solutions(read_notebook(notebook))
        write_atomically(options.hand_out, nbformat.writes(for_students).encode())
        return 0
    paths = list(find_notebooks(options.notebooks))
    if not paths:
        raise ValueError("no notebook is named; name notebooks, or a folder of them.")

    course = read_course(notebook)
    graded: dict[Path, list[Verdict]] = {}
    for path in paths:
        graded[path] = grade_notebook(path, course, cell_timeout_s=options.cell_timeout)
        print(describe_verdicts(path, graded[path]), flush=True)
        # after each notebook, because some take minutes
        if options.csv:
            write_csv(options.csv, graded)

    print()
    for path, verdicts in graded.items():
        print(summarize(path, verdicts, course))
    every_verdict_is_good = all(
        verdict.good for verdicts in graded.values() for verdict in verdicts
    )
    return 0 if every_verdict_is_good else 1


def find_notebooks(given: list[Path]) -> Iterator[Path]:
    """The notebooks named, and those in the folders named. Raises FileNotFoundError for
    a folder without any.
    """
    for path in given:
        if not path.is_dir():
            yield path
            continue
        inside = sorted(path.rglob("*.ipynb"))
        inside = [found for found in inside if ".ipynb_checkpoints" not in found.parts]
        if not inside:
            remedy = "name the folder of those handed in"
            raise FileNotFoundError(f"{path}: has no notebooks (.ipynb); {remedy}.")
        yield from inside


def describe_verdicts(path: Path, verdicts: list[Verdict]) -> str:
    """The rows of a notebook: exercise, result and message, wrapped to the width of a
    terminal.
    """
    lines = [str(path)]
    indent = " " * (2 + NAME_WIDTH + RESULT_WIDTH)
    for verdict in verdicts:
        begin = f"  {verdict.exercise:{NAME_WIDTH}}{verdict.result:{RESULT_WIDTH}}"
        message = " ".join(verdict.message.split())
        row = textwrap.fill(
            message, TABLE_WIDTH, initial_indent=begin, subsequent_indent=indent
        )
        lines.append(row or begin)
    return "\n".join(lines)


def summarize(path: Path, verdicts: list[Verdict], course: Course) -> str:
    """One line for a notebook."""
    passed = sum(verdict.result == PASSED for verdict in verdicts)
    other_cells = verdicts[-1]
    count = len(course.exercises)
    return f"{path}: {passed} of {count} passed; other cells {other_cells.result}"


def write_csv(path: Path, graded: dict[Path, list[Verdict]]) -> None:
    """Write a row for each notebook and exercise."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["notebook", "exercise", "result", "message"])
    for notebook, verdicts in graded.items():
        for verdict in verdicts:
            writer.writerow(
                [notebook, verdict.exercise, verdict.result, verdict.message]
            )
    write_atomically(path, table.getvalue().encode(errors="replace"))


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    words = sys.argv[1:] if arguments is None else arguments
    return run_command(sys.modules[__name__], "python -m course.grading", words)


if __name__ == "__main__":
    run_program(main)
