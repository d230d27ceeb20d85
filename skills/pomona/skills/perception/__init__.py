"""From pictures to fruit: models, detection, refinement. No py_trees, no devices.

The names below are public, and loaded on first use.
"""

from typing import TYPE_CHECKING

from pomona.executive.values.public_names import on_first_use

if TYPE_CHECKING:
    from pomona.skills.perception.detection.compact_detector import (
        CompactDetector as CompactDetector,
    )
    from pomona.skills.perception.detection.detection import (
        AllDetections as AllDetections,
        Detection as Detection,
        DetectorOptions as DetectorOptions,
    )
    from pomona.skills.perception.detection.errors import (
        BadFrame as BadFrame,
        BadWeights as BadWeights,
        DetectError as DetectError,
    )
    from pomona.skills.perception.detection.instances import FoundFruit as FoundFruit
    from pomona.skills.perception.detection.places import (
        LARGEST_SIDE as LARGEST_SIDE,
        search_sides as search_sides,
        shared_part as shared_part,
    )
    from pomona.skills.perception.frame_check import (
        MISMATCHES as MISMATCHES,
        depth_elsewhere as depth_elsewhere,
    )
    from pomona.skills.perception.fruit import (
        FruitModel as FruitModel,
        find_weights as find_weights,
        load_fruit as load_fruit,
    )
    from pomona.skills.perception.fruit.catalogue import FruitError as FruitError
    from pomona.skills.perception.fruit.sizes import (
        KindSizes as KindSizes,
        TooFewFruit as TooFewFruit,
        held_out as held_out,
        learn_sizes as learn_sizes,
    )
    from pomona.skills.perception.measured_fruit import MeasuredFruit as MeasuredFruit
    from pomona.skills.perception.refinement.cloud import horizontal_plane as horizontal_plane
    from pomona.skills.perception.refinement.errors import RefineError as RefineError
    from pomona.skills.perception.refinement.measure import (
        measure as measure,
        size_deviation as size_deviation,
    )
    from pomona.skills.perception.refinement.render import DepthLook as DepthLook
    from pomona.skills.perception.refinement.scale_fit import (
        PlaceFit as PlaceFit,
        fit_place as fit_place,
    )

PUBLIC = {
    "detection.compact_detector": "CompactDetector",
    "detection.detection": "AllDetections Detection DetectorOptions",
    "detection.errors": "BadFrame BadWeights DetectError",
    "detection.instances": "FoundFruit",
    "detection.places": "LARGEST_SIDE search_sides shared_part",
    "frame_check": "MISMATCHES depth_elsewhere",
    "fruit": "FruitModel find_weights load_fruit",
    "fruit.catalogue": "FruitError",
    "fruit.sizes": "KindSizes TooFewFruit held_out learn_sizes",
    "measured_fruit": "MeasuredFruit",
    "refinement.cloud": "horizontal_plane",
    "refinement.errors": "RefineError",
    "refinement.measure": "measure size_deviation",
    "refinement.render": "DepthLook",
    "refinement.scale_fit": "PlaceFit fit_place",
}
"""Public names by the module that defines them."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = on_first_use(__name__, PUBLIC)
