"""``gimbal-pin fleet``."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from gimbal_pin.cli.options import HERE, Json, Payload, Seed, Workers, optional
from gimbal_pin.cli.paths import Reads, rigs
from gimbal_pin.cli.present import present
from gimbal_pin.cli.work import affordable


def fleet(
    logs: Annotated[Positional[str], arg(metavar="DIR", help="folder or URL of the logs and their manifest")],
    *,
    output: Annotated[
        str, arg(aliases=["-o"], metavar="DIR", help="folder or URL for the results; what is there goes on")
    ],
    rig: Annotated[
        str | None, Reads(rigs), optional("RIG", "what all units are built as", "what the manifest says")
    ] = None,
    payload: Payload = None,
    reference: Annotated[
        str | None, optional("DIR", "results of an earlier fleet, which units are judged against", "each other")
    ] = None,
    quick: Annotated[bool, arg(help="identify only, and look for no causes")] = False,
    workers: Annotated[Workers, OmitArgPrefixes] = HERE,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Compare many rigs' logs: which unit is not like its siblings, in what, and since when."""
    from gimbal_pin.fleet import read_manifest
    from gimbal_pin.fleet.engine import write_whole
    from gimbal_pin.fleet.fleet import compare_fleet
    from gimbal_pin.fleet.page import describe_fleet

    manifest = read_manifest(logs)
    if workers.scheduler is None:
        kind = "identified_log" if quick else "diagnosed_log"
        affordable(workers.yes, workers.workers or 4096, **{kind: len(manifest.logs)})
    with workers.running() as (executor, several):
        found = compare_fleet(
            manifest,
            rig=rig,
            payload=payload,
            folder=output,
            reference=reference,
            quick=quick,
            seed=seed,
            executor=executor,
            workers=several,
            quiet=False,
        )
    page = describe_fleet(found)
    write_whole(output, "report.html", page.to_html().encode())
    present(page.to_text(), found.to_dict(), json)
