"""How long the tests with random examples search: in `make fuzz` longer than in `make test`, and each time anew."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

# How many times as many examples as in `make test`.
TIMES = int(os.environ.get("LANES_FUZZ", "1"))


def examples(count: int) -> settings:
    """Search `count` examples, the same ones in every run; in `make fuzz` `TIMES` as many, others each time."""
    return settings(
        max_examples=count * TIMES,
        derandomize=TIMES == 1,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
