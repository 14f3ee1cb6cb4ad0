"""`tools.perfect_evidence` puts stripes on the true lines and counts the frames that the fit gets right."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from simulator.scenes.suite import SUITE
from tools.perfect_evidence import main, perfect_errors, true_stripes

# Ten frames.
SECONDS = 0.4


def test_stripes_lie_on_the_true_lines():
    """At a moment without pitch motion, on a level road, the view shows the lines where they are."""
    drive = SUITE["motorway"].drive()
    time_s = min(np.arange(0.0, 3.0, 0.01), key=lambda time_s: abs(drive.motion.pitch(time_s)))
    view, truth = BirdsEyeView(drive.camera), drive.truth(float(time_s))
    stripes = true_stripes(drive, truth, view)
    off_m = np.min([np.abs(stripes.y_m - truth.line_y(side, stripes.x_m)) for side in (0, 1)], axis=0)
    assert len(stripes) > 100
    assert off_m[stripes.x_m < 30].max() < 0.01
    np.testing.assert_allclose(view.x_m[stripes.row], stripes.x_m)


def test_a_motorway_is_right_and_a_hairpin_is_not_always():
    assert perfect_errors(SUITE["motorway"].drive(), SECONDS).correct.all()
    hairpin = perfect_errors(SUITE["hairpin-right"].drive(), 2.0)
    assert 0.3 < hairpin.correct.mean() <= hairpin.correct_in_picture.mean() < 0.95


def test_a_scene_that_does_not_exist_is_named(capsys):
    with pytest.raises(SystemExit):
        main(["nowhere"])
    assert "no scene nowhere" in capsys.readouterr().err
