"""The checks of the exercises, one file for each chapter of project.ipynb."""
