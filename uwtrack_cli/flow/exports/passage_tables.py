"""The table of passages for other programs: CSV, JSON Lines, GeoJSON, Parquet, SQL.

**Conventions.** Every format has the same columns, those of `flow.passages.PassageRow`.
What is not known is an empty cell in CSV, null elsewhere. Parquet and SQL need DuckDB
(``pip install 'uwtrack[catalogue]'``); in SQL the tables are ``passages`` and ``levels``.

**References.** RFC 7946 (2016), The GeoJSON Format.
"""

import json
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Literal, get_args, get_type_hints

from uwtrack_cli.errors import OptionError, needing
from uwtrack_cli.files.text_escaping import csv_line
from uwtrack_cli.flow.exports.geojson import collection_text
from uwtrack_cli.flow.passages import PassageLevel, PassageRow, PassageTable

Row = dict[str, Any]

COLUMNS = tuple(f.name for f in fields(PassageRow))
"""Columns of the table, in order."""

LEVEL_COLUMNS = tuple(f.name for f in fields(PassageLevel))
"""Columns of the table of radiated noise levels, in order."""

_SQL_TYPES = {str: "VARCHAR", int: "BIGINT", float: "DOUBLE"}


def csv_lines(rows: Iterable[Row], heads: Sequence[str]) -> Iterator[str]:
    """Yield the lines of a CSV table for people, its heads first.

    Numbers have six significant digits and deviations four; places and times as many
    as a tenth of a metre and a millisecond need.
    """
    yield csv_line(heads)
    for row in rows:
        yield csv_line([_rounded(name, row[name]) for name in heads])


def _rounded(name: str, value: Any) -> Any:
    """Return a value with the digits that a person needs.

    Examples
    --------
    >>> _rounded("speed_mps", 5.998984426), _rounded("speed_std_mps", 0.00985050367)
    ('5.99898', '0.009851')
    >>> _rounded("latitude", 34.997776612), _rounded("time_s", 36148.070598)
    ('34.997777', '36148.071')
    """
    if not isinstance(value, float):
        return value
    if name in {"latitude", "longitude"}:
        return f"{value:.6f}"
    if name == "time_s":
        return f"{value:.3f}"
    return f"{value:.4g}" if "_std" in name else f"{value:.6g}"


def json_lines(rows: Iterable[Row]) -> Iterator[str]:
    """Yield one JSON object per row."""
    return (json.dumps(row, ensure_ascii=False, allow_nan=False) for row in rows)


def passages_geojson(passages: Sequence[PassageRow]) -> str:
    """Return the passages with a position as a GeoJSON feature collection.

    ``passages``: the passages; those without a position are left out.
    """
    return collection_text(
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [row.longitude, row.latitude]},
            "properties": asdict(row),
        }
        for row in passages
        if row.latitude is not None and row.longitude is not None
    )


def parquet_bytes(table: PassageTable, name: Literal["passages", "levels"]) -> bytes:
    """Return one of the tables as the bytes of a Parquet file, times as timestamps.

    Raises
    ------
    DataError
        DuckDB is not installed.
    """
    connection = _database(table)
    with tempfile.TemporaryDirectory(prefix="uwtrack-") as folder:
        path = Path(folder) / "passages.parquet"
        connection.table(name).write_parquet(str(path))
        connection.close()
        return path.read_bytes()


def query_passages(table: PassageTable, query: str) -> list[Row]:
    """Return the rows of an SQL query over the tables ``passages`` and ``levels``.

    The query sees those tables alone: files and networks are closed to it.

    ``query``: one SELECT statement.

    Raises
    ------
    OptionError
        The query is not understood.
    DataError
        DuckDB is not installed.
    """
    duckdb = load_duckdb()
    connection = _database(table)
    connection.execute("SET enable_external_access = false")
    connection.execute("SET lock_configuration = true")
    try:
        kinds = [statement.type for statement in connection.extract_statements(query)]
        if kinds != [duckdb.StatementType.SELECT]:
            raise OptionError(f"--sql takes one SELECT over passages and levels, got {query!r}.")
        result = connection.execute(query)
        heads = [column[0] for column in result.description or ()]
        found = [dict(zip(heads, map(_plain, row), strict=True)) for row in result.fetchall()]
    except duckdb.Error as error:
        first = str(error).split("\n", 1)[0].rstrip("!.")
        raise OptionError(
            f"--sql is not understood: {first}. Columns of passages: "
            f"{', '.join(COLUMNS)}; of levels: {', '.join(LEVEL_COLUMNS)}."
        ) from error
    finally:
        connection.close()
    return found


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, str | int | float | bool):
        return value
    return str(value)


def load_duckdb() -> Any:
    """Return DuckDB; a command asks for it before it reads ten thousand results.

    Raises
    ------
    DataError
        It is not installed.
    """
    with needing("Parquet and SQL need DuckDB", "catalogue"):
        import duckdb
    return duckdb


def _database(table: PassageTable) -> Any:
    """Return a database in memory that holds the tables of passages and levels."""
    connection = load_duckdb().connect()
    for name, kind, rows in (
        ("passages", PassageRow, table.passages),
        ("levels", PassageLevel, table.levels),
    ):
        hints = get_type_hints(kind)
        columns = ", ".join(
            f"{f.name}: '{next(_SQL_TYPES[t] for t in _types(hints[f.name]))}'"
            for f in fields(kind)
        )
        with tempfile.TemporaryDirectory(prefix="uwtrack-") as folder:
            path = Path(folder) / "rows.jsonl"
            path.write_text("\n".join(json_lines(map(asdict, rows))), encoding="utf-8")
            times = "* REPLACE (CAST(time_utc AS TIMESTAMP) AS time_utc)"
            connection.execute(
                f"CREATE TABLE {name} AS SELECT {times} FROM read_json(?, "  # noqa: S608
                f"format = 'newline_delimited', columns = {{{columns}}})",
                [str(path)],
            )
    return connection


def _types(hint: Any) -> Iterator[type]:
    """Yield the types of an annotation that a database knows."""
    return (kind for kind in (hint, *get_args(hint)) if kind in _SQL_TYPES)
