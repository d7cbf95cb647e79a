"""What all windows of one studio share: what was given, chosen, prepared and saved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from gimbal_pin.control.laws.uncertainty import home
from gimbal_pin.control.tuning import Tuning, TuningBasis
from gimbal_pin.log.io.files import write_run
from gimbal_pin.log.log import Log
from gimbal_pin.report.view import record
from gimbal_pin.rig.files import bundled_payloads
from gimbal_pin.studio.figures import ResidualFigure, compute_residual
from gimbal_pin.studio.saving import Writer, keep_earlier_files
from gimbal_pin.studio.state import History, StudioState
from gimbal_pin.studio.subject import (
    StudioSource,
    Subject,
    build_model,
    mount_payload,
    prepare_subject,
    tune_state,
)


@dataclass
class Desk:
    """What all windows of one studio share.

    Attributes:
        source: What was given on the command line.
        folder: Where files are saved.
        about: What `run.json` says beside them.
        history: What was chosen.
        subjects: Payload and judged part → what was prepared for them.
        gimbal: The state that was tuned last without its wishes, and what is known of its model, see `tune_loops`.
        kept: Name → what writes each file that was saved.
    """

    source: StudioSource
    folder: Path
    about: Mapping[str, Any]
    history: History = field(default_factory=History)
    subjects: dict[tuple[str | None, tuple[float, float] | None], Subject] = field(
        default_factory=dict
    )
    gimbal: tuple[StudioState, TuningBasis, ResidualFigure | None] | None = None
    kept: dict[str, Writer] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Keep what an earlier session has saved in the folder."""
        self.kept = {**keep_earlier_files(self.folder), **self.kept}

    def find_subject(self, state: StudioState) -> Subject:
        """Return what is prepared for a state; the first time it takes as long as identifying does."""
        wanted = state.payload, state.judged
        if wanted not in self.subjects:
            self.subjects[wanted] = prepare_subject(self.source, *wanted)
        return self.subjects[wanted]

    def tune_loops(self, state: StudioState) -> tuple[Subject, Tuning, ResidualFigure | None]:
        """Return what is shown first: the loops, and what the controller's model leaves of the torque.

        What depends on the model alone is worked out once for all wishes; the residual is then the same object.
        """
        subject = self.find_subject(state)
        gimbal = self.gimbal
        unwished = replace(state, bandwidth_hz=None, disk_margin=None, delay=None)
        if gimbal is None or gimbal[0] != unwished:
            basis = TuningBasis(build_model(subject, state))
            self.gimbal = gimbal = unwished, basis, compute_residual(subject, basis.model)
        tuning = tune_state(subject, state, gimbal[1])
        assert tuning.loop_curves
        return subject, tuning, gimbal[2]

    def draw_scene(self, payload: str | None = None) -> str:
        """Return the page of the rig with a payload, small: it plays the first log, or stands at home."""
        rig = mount_payload(self.source.rig, payload)
        log = (
            self.source.logs[0]
            if self.source.logs
            else Log("home", rig.joints, np.zeros(1), home(rig)[None])
        )
        look = files("gimbal_pin.studio").joinpath("scene.css").read_text(encoding="utf-8")
        return record(rig, log).replace("</head>", f"<style>{look}</style></head>")

    def list_cameras(self) -> list[str]:
        """Return the payloads to choose from: those that were mounted, the latest first, then the bundled ones."""
        mounted = [payload or self.source.rig.payload for payload, _ in reversed(self.subjects)]
        return list(dict.fromkeys([*filter(None, mounted), *bundled_payloads()]))

    def save_file(self, name: str, writer: Writer) -> Path:
        """Write a file and all that were saved before into the folder."""
        kept = {**self.kept, name: writer}
        write_run(self.folder, kept, self.about)
        self.kept = kept
        return self.folder / name
