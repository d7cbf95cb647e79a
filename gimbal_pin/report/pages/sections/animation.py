"""The recorded animation, inside the report."""

from __future__ import annotations

from markupsafe import Markup

from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.html import join, paragraph


def animation(page: str, lead: str) -> Section:
    """Return a section that plays a recording in a frame of its own; the recording lies in the report's file."""
    frame = Markup('<iframe class="scene" title="Animation" srcdoc="{}" allow="fullscreen"></iframe>').format(page)
    how = "Drag to turn, scroll to zoom; the bar plays, pauses and seeks."
    button = Markup('<button type="button" class="wide" onclick="{}">Full screen</button>').format(
        "this.closest('.animation').querySelector('iframe').requestFullscreen()"
    )
    below = Markup('<div class="below">{}{}</div>').format(paragraph(how), button)
    return Section("Animation", Markup('<div class="animation">{}</div>').format(join([frame, below])), lead)
