"""``gimbal-pin fleet``."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from tyro.conf import Positional, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import describe_origin
from gimbal_pin.cli.present import present


def fleet(
    logs: Annotated[Positional[str], arg(metavar="DIR")],
    *,
    output: opt.Results,
    rig: opt.OtherRig = None,
    payload: opt.Payload = None,
    reference: Annotated[opt.Maybe[str], arg(metavar="DIR")] = None,
    quick: bool = False,
    workers: opt.Workers = 0,
    scheduler: opt.Scheduler = None,
    seed: opt.Seed = 0,
    json: opt.Json = None,
) -> None:
    """Compare many rigs' logs: which unit is not like its siblings, in what, and since when.

    Args:
        logs: folder or URL of the logs and their manifest
        rig: what all units are built as (default: what the manifest says)
        reference: results of an earlier fleet, which units are judged against (default: each other)
        quick: identify only, and look for no causes
    """
    origin = describe_origin(fleet, locals())
    from gimbal_pin.fleet import read_manifest
    from gimbal_pin.fleet.engine import open_executors, write_whole
    from gimbal_pin.fleet.fleet import compare_fleet
    from gimbal_pin.report.pages import describe_record

    manifest = read_manifest(logs)
    with open_executors(scheduler, workers) as (executor, several):
        found = compare_fleet(
            manifest, rig=rig, payload=payload, folder=output, reference=reference, quick=quick, seed=seed,
            executor=executor, workers=several, quiet=False,
        )  # fmt: skip
    page = replace(describe_record(found), origin=origin)
    write_whole(output, "report.html", page.to_html().encode())
    present(page.to_text(), found.to_dict(), json)
