"""ROS joint states, which name their joints in every message, in any order."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from gimbal_pin.errors import LogError
from gimbal_pin.log.io.csv import CsvTable
from gimbal_pin.log.io.recognise import COMMAND_WORDS
from gimbal_pin.log.io.tables import ColumnTable, Stream, make_table
from gimbal_pin.rig.reading import split_words

JOINT_STATE_FIELDS = {"position": "q", "velocity": "dq", "effort": "tau"}
"""Field of a JointState message → prefix of a joint's column."""
_FIELD = re.compile(r"(?:.*\.)?(name|position|velocity|effort)\[?(\d+)\]?")
_STAMPS = re.compile(r"(?:.*\.)?header\.stamp")


def list_joint_values(
    names: Sequence[str], fields: dict[str, Sequence[Any]]
) -> Iterator[tuple[str, Any]]:
    """Yield column and value of one message: its names, and field → a value per name, or fewer."""
    for field, prefix in JOINT_STATE_FIELDS.items():
        yield from ((f"{prefix}_{joint}", x) for joint, x in zip(names, fields.get(field, ())))


def is_command(topic: str) -> bool:
    """Whether a topic's name says that it holds what was asked for."""
    return not COMMAND_WORDS.isdisjoint(split_words(topic))


def drop_empty_columns(stream: Stream) -> Stream:
    """Return a stream without the columns that hold no number at all, as efforts that a drive does not report."""
    kept = {
        name: x
        for name, x in stream.columns.items()
        if name == stream.time or not np.isnan(x).all()
    }
    return Stream(stream.time, kept)


def choose_names(streams: Sequence[tuple[str, Sequence[str]]]) -> list[tuple[str, dict[str, str]]]:
    """Return, for each stream, its label and its columns' names in the file.

    A name that several streams have gets the topic in front, except in the one stream that holds no command and more
    of the joints' quantities than any other.

    Args:
        streams: Topic and columns of each.
    """
    counts = Counter(name for _, columns in streams for name in columns)
    ranks = [
        (not is_command(topic), len({name.split("_")[0] for name in columns}))
        for topic, columns in streams
    ]
    topics = Counter(topic for topic, _ in streams)
    chosen = list[tuple[str, dict[str, str]]]()
    for k, (topic, columns) in enumerate(streams):
        label = topic if topics[topic] == 1 else f"{topic}#{k}"
        names = {}
        for name in columns:
            rivals = [rank for j, rank in enumerate(ranks) if j != k and name in streams[j][1]]
            alone = counts[name] == 1 or (
                not name.startswith(topic) and all(ranks[k] > rank for rank in rivals)
            )
            own = label + name.removeprefix(topic) if name.startswith(topic) else f"{label}.{name}"
            names[name] = name if alone else own
        chosen.append((label, names))
    return chosen


def open_topic_echo(table: CsvTable) -> ColumnTable:
    """Return the joints' columns of what ``rostopic echo -p`` or ``ros2 topic echo --csv`` printed of joint states.

    A table of other columns is returned as it is.

    Raises:
        LogError: A name is empty, a value no number, or no time is written.
    """
    import pandas

    places: dict[str, list[int]] = {}
    for place, column in enumerate(table.columns):
        if match := _FIELD.fullmatch(column):
            places.setdefault(match[1], []).append(place)
    names = places.get("name", [])
    if not names or len(places.get("position", [])) != len(names):
        return table
    stamps = [k for k, column in enumerate(table.columns) if _STAMPS.match(column)] or [0]
    try:
        texts = table.parse(
            {0, *stamps, *(place for group in places.values() for place in group)}, texts=True
        )
        t = _to_seconds(texts[stamps].to_numpy(dtype=np.float64))
        if not t.any():  # nobody stamped the messages: the first column is when they came
            t = _to_seconds(texts[[0]].to_numpy(dtype=np.float64))
        values = {
            field: texts[group].replace("", "nan").to_numpy(dtype=np.float64)
            for field, group in places.items()
            if field != "name" and len(group) == len(names)
        }
    except ValueError as error:
        raise LogError(
            table.name, f"holds a value that is no number ({error})", "record the topic again"
        ) from error
    orders = list(map(tuple, texts[names].to_numpy(dtype=str).tolist()))
    messages = list[dict[str, float]]()
    for row, order in enumerate(orders):
        if "" in order or len(set(order)) < len(order):
            where = f"{table.name}:{table.first + row}"
            raise LogError(
                where, f"names the joints {', '.join(order)}", "give each joint a name of its own"
            )
        messages.append(
            dict(list_joint_values(order, {field: x[row] for field, x in values.items()}))
        )
    sets = [",".join(sorted(order)) for order in orders]
    streams = list[Stream]()
    for k, (_, rows) in enumerate(pandas.DataFrame(messages).groupby(np.array(sets), sort=False)):
        time = "t" if len(set(sets)) == 1 else f"t#{k}"
        columns = {str(column): rows[column].to_numpy() for column in rows}
        streams.append(drop_empty_columns(Stream(time, {time: t[rows.index], **columns})))
    return make_table(table.name, streams, [])


def _to_seconds(
    stamps: np.ndarray[Any, np.dtype[np.float64]],
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return times, s, of stamps in ns, (N, 1), or in s and ns, (N, 2)."""
    return stamps[:, 0] * 1e-9 if stamps.shape[1] == 1 else stamps[:, 0] + stamps[:, 1] * 1e-9
