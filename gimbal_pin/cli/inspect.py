"""``gimbal-pin inspect``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import describe_origin, load_rig
from gimbal_pin.cli.paths import Writes, list_plot_suffixes
from gimbal_pin.cli.present import present, tell, write_figure
from gimbal_pin.errors import GimbalPinError, UsageError

if TYPE_CHECKING:
    from gimbal_pin.checks import Alteration
    from gimbal_pin.log.io.inspection import Inspected
    from gimbal_pin.rig.rig import Rig


def inspect(
    files: opt.Logs,
    *,
    rig: opt.OtherRig = None,
    output: Annotated[
        opt.File, Writes(lambda: (".html", *list_plot_suffixes())), arg(aliases=["-o"])
    ] = None,
    yaml: Annotated[opt.File, Writes((".yaml", ".yml"))] = None,
    json: opt.Json = None,
) -> None:
    """What a log's file holds, what each column is and why, and a mapping of columns for a rig.

    Args:
        rig: propose a mapping for this rig
        output: draw every channel: .html, .png, .svg or .pdf
        yaml: write the mapping that is proposed for the first file, to look through and edit
    """
    origin = describe_origin(inspect, locals())
    from gimbal_pin.log.io import split_payload
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.log.io.inspection import inspect as run
    from gimbal_pin.report.elements import Document
    from gimbal_pin.report.sections.data import show_file

    if not files:
        raise UsageError("LOG", "none was given", "name at least one file")
    if yaml is not None and rig is None:
        raise UsageError(
            "--yaml", "is given without a rig", "say with --rig whose joints the columns are of"
        )
    loaded = None if rig is None else load_rig(rig, None)
    found = [run(split_payload(file)[0], loaded) for file in files]
    if yaml is not None:
        atomic_write(yaml, found[0].yaml)
    altered = [() if loaded is None else find_alterations(loaded, one) for one in found]
    page = Document("What the logs hold", "", [*map(show_file, found, altered)], origin)
    if output is not None and output.suffix.lower() == ".html":
        page.write(output)
    else:
        write_figure(found[0].plot, output)
    described = [
        {**one.to_dict(), "altered": [change.to_dict() for change in each]}
        for one, each in zip(found, altered)
    ]
    result = {"schema": 1, "rig": None if loaded is None else loaded.name, "files": described}
    present(page.to_text(), result, json)


def find_alterations(rig: Rig, found: Inspected) -> tuple[Alteration, ...]:
    """Return what the verbs would alter in a file that they read with the proposed mapping; none where they cannot."""
    from gimbal_pin.checks import check_log
    from gimbal_pin.log.io import read_log
    from gimbal_pin.log.mapping import format_expression

    if found.missing:
        return ()  # the mapping lists what has to be filled in
    entries = [
        f"{target}={format_expression(*source[:2])}" for target, source in found.mapping.items()
    ]
    try:
        return check_log(rig, read_log(found.name, rig, entries), repairs_only=True).alterations
    except GimbalPinError as error:
        tell([f"not checked: {error}"])
        return ()
