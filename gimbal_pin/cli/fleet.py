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
    json: opt.Json = None,
) -> None:
    """Compare many rigs' logs: units that deviate from the others, in which parameter, and since when.

    Args:
        logs: folder of the logs and their manifest
        rig: rig that all units are built as (default: the manifest's)
        reference: results of an earlier fleet to compare with (default: the units of these logs)
        quick: identify only, and look for no causes
    """
    origin = describe_origin(fleet, locals())
    from gimbal_pin.fleet import open_executor
    from gimbal_pin.fleet.fleet import compare_fleet
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.report.pages import describe_record

    with open_executor(workers, scheduler) as executor:
        compared = compare_fleet(
            logs, rig=rig, payload=payload, folder=output, reference=reference, quick=quick,
            executor=executor, quiet=False,
        )  # fmt: skip
    page = replace(describe_record(compared), origin=origin)
    atomic_write(output / "report.html", page.to_html())
    present(page.to_text(), compared.to_dict(), json)
