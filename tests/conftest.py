"""Settings of all tests."""

from hypothesis import settings

# The same examples in every run, without a time limit for each, because the machine may be busy.
settings.register_profile("course", derandomize=True, deadline=None)
settings.load_profile("course")
