"""Number of random examples: fixed ones in `make test`, more and different ones in each
`make fuzz`.
"""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

# Factor on the number of examples in `make test`.
TIMES = int(os.environ.get("LANES_FUZZ", "1"))


def examples(count: int) -> settings:
    """Try `count` examples, the same in every run; `make fuzz` tries `TIMES` as many,
    different in each run.
    """
    return settings(
        max_examples=count * TIMES,
        derandomize=TIMES == 1,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
