"""Found Roads: labelled stills of other people's cameras, and who finds their lanes.

`python -m benchmark.real_roads` fetches the stills, scores the lines of any program,
and measures the engine. The manifest and the labels are files of this folder.
"""

from benchmark.real_roads.scored import ScoredLane, score_lane
from benchmark.real_roads.sets import (
    RoadSet,
    add_road_arguments,
    choose_road_sets,
    read_road_sets,
)
from benchmark.real_roads.tables import describe
from benchmark.real_roads.ways import CLIPS, OWN, SET, WAYS, score_set, score_sets

__all__ = [
    "CLIPS",
    "OWN",
    "SET",
    "WAYS",
    "RoadSet",
    "ScoredLane",
    "add_road_arguments",
    "choose_road_sets",
    "describe",
    "read_road_sets",
    "score_lane",
    "score_set",
    "score_sets",
]
