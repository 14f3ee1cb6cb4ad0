"""Settings of all tests."""

from hypothesis import settings

# The same examples in every run, and no time limit for one of them: a busy machine is no defect.
settings.register_profile("course", derandomize=True, deadline=None)
settings.load_profile("course")
