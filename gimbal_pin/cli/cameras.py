"""``gimbal-pin identify LOG@PAYLOAD …``: several cameras on one gimbal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from gimbal_pin.cli.inputs import load_logs, load_rig, mounted
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from gimbal_pin.identification.payloads import Several
    from gimbal_pin.regression import Estimator, Filtering


@dataclass(frozen=True)
class Fit:
    """How logs are fitted, whatever is identified from them.

    Attributes:
        estimator: Blocks → `Estimate`.
        holdout: As for `identify`.
        filtering: Cutoff and alignment.
    """

    estimator: Estimator
    holdout: str | None
    filtering: Filtering | None


def tags_of(logs: Sequence[str]) -> list[str | None]:
    """Return the payloads that the logs are tagged with, each once, None for those without a tag."""
    from gimbal_pin.log.io import split_payload

    return list(dict.fromkeys(split_payload(log)[1] for log in logs))


def cameras(
    rig: str,
    payload: str | None,
    logs: Sequence[str],
    mapping: Sequence[str],
    known: str | None,
    extended: str | None,
    fit: Fit,
    refit: bool = False,
) -> Several:
    """Identify one gimbal with the several payloads that the logs are tagged with, or a new one on a known gimbal.

    The causes of an `extended` model stand in the equations.
    With `refit` from all data, once the held-out error is known.
    """
    from gimbal_pin.identification import refittable_effects
    from gimbal_pin.identification.model_file import read_known, read_model
    from gimbal_pin.identification.payloads import identify_new, identify_several

    def judged(run: Callable[..., Several]) -> Several:
        if not refit:
            return run(**vars(fit))
        tested = replace(fit, holdout=fit.holdout or "last-third")
        return run(**vars(tested)).refitted(run(**vars(replace(fit, holdout="none"))))

    if known is not None:
        loaded, read = load_logs(rig, payload, logs, mapping)
        return judged(partial(identify_new, loaded, read, read_known(known, load_rig(rig, mounted(known)))))
    tags = [tag for tag in tags_of(logs) if tag is not None]
    if payload is not None or None in tags_of(logs):
        raise UsageError("logs", "are only partly tagged with a payload", "tag each of them: LOG@PAYLOAD, no --payload")
    each = {tag: [log for log in logs if log.endswith(f"@{tag}")] for tag in tags}
    pairs = {tag: load_logs(rig, None, mine, mapping) for tag, mine in each.items()}
    rigs, read_by = ({tag: pair[k] for tag, pair in pairs.items()} for k in (0, 1))
    causes = () if extended is None else refittable_effects(read_model(extended, load_rig(rig, mounted(extended))))
    return judged(partial(identify_several, rigs, read_by, causes))  # type: ignore[arg-type]
