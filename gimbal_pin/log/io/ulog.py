"""PX4's ULog: every topic's fields as ``topic.field``, its timestamps in seconds; needs pyulog."""

from __future__ import annotations

from pathlib import Path

from gimbal_pin.log.io.isolated import open_isolated
from gimbal_pin.log.io.tables import Stream, Table

MAGIC = b"ULog\x01\x12\x35"


def open_ulog(path: Path) -> Table:
    """Read a ULog; the second instance of a topic is ``topic_1``, and a log of one topic has the time t, too."""
    return open_isolated(path, "ulog", "a PX4 ULog", "pyulog", "px4")


def streams(path: Path) -> tuple[list[Stream], list[str]]:
    """Return one stream per topic and instance; pyulog's own errors where the file is damaged."""
    from pyulog import ULog

    log = ULog(str(path))
    found = []
    for topic in log.data_list:
        name = f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name
        columns = {f"{name}.{field}": values for field, values in topic.data.items()}
        columns[f"{name}.timestamp"] = topic.data["timestamp"] / 1e6
        found.append(Stream(f"{name}.timestamp", columns))
    notes = ["is damaged: what could be read of it is used"] if log.file_corruption else []
    if log.dropouts:
        notes.append(f"{len(log.dropouts)} dropouts of {sum(dropout.duration for dropout in log.dropouts)} ms in all")
    return found, notes
