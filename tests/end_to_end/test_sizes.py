"""How sizes and hours of the project are counted."""

from __future__ import annotations

import json

import pytest

from tools.course_hours import (
    MINUTES_A_CELL,
    MINUTES_A_CODE_LINE,
    MINUTES_A_QUESTION,
    MINUTES_AN_EXERCISE,
    WORDS_A_MINUTE,
    Chapter,
    hours_table,
    measure_chapters,
)
from tools.sizes import (
    CodeLine,
    Density,
    code_lines,
    count_words,
    describe_sizes,
    measure_densities,
)

SOURCE = '''"""Module."""

import os  # a comment


class A:
    """Docstring
    of two lines."""

    text = f"{os.name} and {1 + 2}"
'''


def test_tokens_of_code_are_counted_without_docstrings_and_comments():
    """2 of the import, 3 of the class, 3 of the assignment: a text with fields is one
    token in every Python.
    """
    assert [line.tokens for line in code_lines(SOURCE)] == [2, 3, 3]


def test_wide_lines_and_the_line_that_nine_of_ten_do_not_exceed():
    narrow = CodeLine(tokens=2, columns=88)
    wide = CodeLine(tokens=12, columns=89)
    density = Density.of([narrow] * 9 + [wide])
    assert density == Density(
        lines=10, tokens=30, mean=3.0, nine_of_ten=12, wide_share=0.1
    )
    assert Density.of([narrow] * 10 + [wide]).nine_of_ten == 2


def test_packages_and_the_cells_of_the_notebook_are_counted():
    cells = [
        {"cell_type": "markdown", "source": ["two ", "words"]},
        {"cell_type": "code", "source": "%magic\na = b"},
    ]
    files = {
        "lanes/a.py": "a = 1\n",
        "lanes/b/c.py": "b\n",
        "tools/t.py": "import os\n",
        "setup.py": "c\n",
        "docs/a.md": "# One\ntwo three",
        "project.ipynb": json.dumps({"cells": cells}),
    }
    densities = measure_densities(files, ["lanes", "tools"])
    tokens = {name: density.tokens for name, density in densities.items()}
    assert tokens == {"lanes": 4, "tools": 2, "project.ipynb": 3, "everything": 7}
    assert count_words(files) == {
        "files of lanes": 2,
        "words of pages": 4,
        "words of project.ipynb": 2,
    }


def test_what_is_above_its_ceiling_is_named():
    densities = {
        "lanes": Density.of([CodeLine(7, 20)]),
        "tools": Density.of([CodeLine(7, 20)]),
    }
    table, above = describe_sizes(
        densities, {"words of pages": 5}, {"lanes": 6, "tools": 7, "words of pages": 4}
    )
    assert above == ["lanes", "words of pages"]
    assert [row.endswith("ABOVE") for row in table[1:]] == [True, False, True]


def test_the_hours_of_a_chapter_count_what_there_is_to_do():
    text = "## 3. Warp\n\n" + "word " * 117 + "**Question.** Why? **Question.** How?"
    cells = [
        {"id": "ch03-01", "cell_type": "markdown", "source": [text]},
        {"id": "ch03-02", "cell_type": "code", "source": ["a = 1\n", "\n", "b = 2"]},
        {
            "id": "ch03-03",
            "cell_type": "code",
            "source": 'course.check_exercise("3.1", a)',
        },
    ]
    (chapter,) = measure_chapters({"cells": cells})
    assert chapter == Chapter(
        "3. Warp", words=124, code_cells=2, code_lines=3, questions=2, exercises=1
    )
    minutes = (
        124 / WORDS_A_MINUTE
        + 3 * MINUTES_A_CODE_LINE
        + 2 * MINUTES_A_CELL
        + 2 * MINUTES_A_QUESTION
    )
    assert 60 * chapter.hours == pytest.approx(minutes + MINUTES_AN_EXERCISE)
    assert (
        hours_table([chapter, chapter]).splitlines()[-1]
        == f"| **all** | 248 | 4 | 6 | 4 | 2 | {2 * chapter.hours:.1f} |"
    )
