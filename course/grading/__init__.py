"""Grading for teachers: notebooks of students in, a table of passed exercises out.

`python -m course.grading`; docs/teaching.md says what it runs, and how to isolate that.
"""
