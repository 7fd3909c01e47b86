"""Containers written as text: tables for people, CSV, JSON.

**Conventions.** Text comes as an iterator of lines without their ends. A value that
is not known is an empty cell in a table or CSV, null in JSON. Matrices become
columns ``name_0_1`` in CSV, lists in JSON; a series has the columns that its own
reader takes, ``frequency_hz``, ``frequency_hz_2`` and so on.
"""

import itertools
import json
import re
from collections.abc import Iterable, Iterator
from typing import Any

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.renamed import KEYS, with_old_keys
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import OptionError
from uwtrack_cli.files.tables.json_rows import (
    OBJECTS,
    Row,
    axes_of,
    axis_rows,
    facts,
    json_rows,
    object_keys,
)
from uwtrack_cli.files.text_escaping import csv_line, plain_text

FORMATS = ("table", "csv", "json", "jsonl")
SERIES_LINE = re.compile(r"(frequency(?:_std)?_hz)_(\d+)")
WIDTH_ROWS = 500
"""Rows that decide how wide the columns of a table are."""
WIDEST_VALUES = 40
"""Values of a row beyond which a table for people tells their range."""


def write_table(
    container: Container, form: str = "table", *, axis: str | None = None
) -> Iterator[str]:
    """Return a container as lines of text.

    Parameters
    ----------
    form
        ``table`` for people, ``csv``, ``json`` (encounters, fixes, motions and
        presence: an array of rows; others: an object with the rows of every axis), or ``jsonl``.
        The object has the single values of the container by their names and one array
        per axis: a target has ``scan`` (one row per scan: state, covariance, threshold,
        score ...), ``association`` (measurements that took part, with their
        probabilities) and ``dimension`` (names and units of the components); a
        decision has ``pair`` (verdict, probability, odds, consistency, reasons as a
        JSON text) and ``scan`` (log odds and log likelihoods after each scan of a
        pair). The keys of a row are the names of the columns.
    axis
        Axis whose rows are written (csv, table, jsonl); the main one by default.

    Raises
    ------
    OptionError
        There is no such format or axis.
    """
    if form not in FORMATS:
        raise OptionError(f"unknown format {form!r}; accepted are {', '.join(FORMATS)}.")
    axis = None if axis is None else KEYS.get(axis, axis)
    if axis is not None and axis not in axes_of(container):
        raise OptionError(
            f"{container.NAME} has no axis {axis!r}; "
            f"it has {', '.join(axes_of(container)) or 'none'}."
        )
    if form == "json" and axis is None and container.NAME not in OBJECTS:
        return _json_object(container)
    rows = _rows(container, axis)
    if form in {"json", "jsonl"}:
        rows = map(with_old_keys, rows)
        return _json_array(rows) if form == "json" else map(_json, rows)
    if form != "csv":
        return _table(container, rows)
    if isinstance(container, Series) and container.contact_numbers != "own" and axis is None:
        # without this the numbers would be read as each sensor's own
        rows = ({**row, "contact_numbers": container.contact_numbers} for row in rows)
    return _csv(container, rows, axis)


def _rows(container: Container, axis: str | None) -> Iterable[Row]:
    is_special = container.NAME in OBJECTS and axis in {None, container.ROW}
    if is_special or not container.columns():
        return json_rows(container)
    return axis_rows(container, axis or container.ROW)


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _json_array(rows: Iterable[Row], before: str = "", after: str = "") -> Iterator[str]:
    """Yield an array, one row per line, without ever holding it as a whole."""
    last: str | None = None
    for row in rows:
        yield f"{before}[" if last is None else f"{last},"
        last = _json(row)
    if last is None:
        yield f"{before}[]{after}"
    else:
        yield last
        yield f"]{after}"


def _json_object(container: Container) -> Iterator[str]:
    yield "{"
    axes = [axis for axis in axes_of(container) if axis != "reason"]  # within rows
    values = with_old_keys({"table": container.NAME, **facts(container)})
    for i, (name, value) in enumerate(values.items(), 1):
        comma = "," if axes or i < len(values) else ""
        yield f"{_json(name)}: {_json(value)}{comma}"
    keys = [(f"{axis}_rows" if axis in values else axis, axis) for axis in axes]
    keys += [(before, now) for before, now in KEYS.items() if now in axes]
    for i, (key, axis) in enumerate(keys, 1):
        rows = axis_rows(container, axis)
        yield from _json_array(rows, f"{_json(key)}: ", "," if i < len(keys) else "")
    yield "}"


def _flat(row: Row) -> Iterator[tuple[str, Any]]:
    """Yield the cells of a row; matrices spread over numbered columns."""
    for name, value in row.items():
        yield from _spread(name, value)


def _spread(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    is_vector = isinstance(value, list) and not any(isinstance(v, dict) for v in value)
    if is_vector and name not in VARYING:
        for i, item in enumerate(value):
            yield from _spread(f"{name}_{i}", item)
    elif isinstance(value, list | dict):
        yield name, _json(value)
    else:
        yield name, "" if value is None else value


VARYING = frozenset({"rest_frequencies_hz", "rest_frequencies_std_hz", "sensors",
                     "ambiguities", "reasons", "frequencies_hz", "rates_hz"})  # fmt: skip
"""Lists whose length differs from row to row: one cell, as JSON."""


def _csv(container: Container, rows: Iterable[Row], axis: str | None) -> Iterator[str]:
    first, rows = _peek(rows)
    names = [name for name, _ in _flat(first)] if first else _names(container, axis)
    yield csv_line([_column_name(container, name) for name in names])
    for row in rows:
        yield csv_line([value for _, value in _flat(row)])


def _column_name(container: Container, name: str) -> str:
    """Return the name that the reader of the container's own table knows."""
    line = SERIES_LINE.fullmatch(name) if isinstance(container, Series) else None
    if line is None:
        return name
    number = int(line[2]) + 1
    return line[1] if number == 1 else f"{line[1]}_{number}"


def _names(container: Container, axis: str | None) -> list[str]:
    """Return the names of the columns where there is no row to take them from."""
    columns, sizes = container.columns(), container.sizes()
    axis = axis or container.ROW
    keys = [name for name, spec in columns.items() if spec.axes[0] == axis]
    if container.NAME in OBJECTS and axis == container.ROW:
        keys = object_keys(type(container))
    names: list[str] = []
    for key in keys:
        others = columns[key].axes[1:] if key in columns else ()
        indices = itertools.product(*(range(sizes[other]) for other in others))
        names += ["_".join([key, *map(str, index)]) for index in indices]
    return names


def _table(container: Container, rows: Iterable[Row]) -> Iterator[str]:
    first, rows = _peek(map(_with_ranges, rows))
    if first is None:
        yield f"no {container.NAME}"
        return
    if not container.columns():
        width = max(map(len, first))
        for name, value in _flat(first):
            yield f"{name:<{width}}  {_cell(value)}".rstrip()
        return
    names = [name for name, _ in _flat(first)]
    cells = ([_cell(value) for _, value in _flat(row)] for row in rows)
    head = list(itertools.islice(cells, WIDTH_ROWS))
    widths = [max(map(len, column)) for column in zip(names, *head, strict=True)]
    for line in itertools.chain([names], head, cells):
        yield "  ".join(c.rjust(w) for c, w in zip(line, widths, strict=True)).rstrip()


def _with_ranges(row: Row) -> Row:
    """Return a row for people: the range of what is too much to look at."""
    return {name: _range(value) for name, value in row.items()}


def _range(value: Any) -> Any:
    if not isinstance(value, list) or len(value) <= WIDEST_VALUES:
        return value
    known = [v for v in value if isinstance(v, int | float)]
    if len(known) < len(value) - value.count(None):  # no list of numbers
        return value
    span = f"{_cell(min(known))} to {_cell(max(known))}" if known else "unknown"
    return f"{span} ({len(value)} values)"


def _cell(value: Any) -> str:
    return f"{value:.7g}" if isinstance(value, float) else plain_text(str(value))


def _peek(rows: Iterable[Row]) -> tuple[Row | None, Iterator[Row]]:
    iterator = iter(rows)
    first = next(iterator, None)
    if first is None:
        return None, iterator
    return first, itertools.chain([first], iterator)
