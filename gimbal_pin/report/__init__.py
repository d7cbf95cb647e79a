"""What a person sees: tables in the terminal, pages, scenes, and the pipeline that makes all of them."""

from __future__ import annotations

from collections.abc import Mapping

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

VIEWS: Mapping[str, tuple[float, float, float]] = {
    "three-quarter": (58.0, 17.0, 0.0),
    "front": (12.0, 8.0, 0.0),
    "side": (90.0, 8.0, 0.0),
    "behind": (160.0, 22.0, 0.0),
    "top": (90.0, 80.0, 0.0),
    "over-the-shoulder": (128.0, 17.0, 0.27),
}
"""Name of a camera's place → from the line of sight round to the viewer, degrees, the viewer's elevation, degrees, and
the share of the width that is left free at the right, where pictures stand beside the scene."""

PRESETS: Mapping[str, tuple[tuple[int, int], float | None, bool]] = {
    "social": ((1080, 1080), 30.0, True),
    "paper": ((1920, 1080), None, True),
    "thumbnail": ((320, 180), 10.0, False),
}
"""Name → width and height, pixels, frames per second (None: what suits the format), and whether the frames say what
they show: in the smallest ones nobody could read it."""
