"""`passages`: one table over many results."""

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from uwtrack_cli.cli.command_factory import Ais, Output, Overwrite, WithinM
from uwtrack_cli.cli.console import put, say, show_table
from uwtrack_cli.cli.targets import PIPE
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.tables.summaries import Head, passage_columns, utc_text

if TYPE_CHECKING:
    from uwtrack_cli.flow.passages import PassageRow, PassageTable

Form = Literal["table", "csv", "json", "jsonl", "parquet", "geojson"]

LEVELS = (
    Head("band Hz", "centre_hz", 1),
    Head("radiated dB re 1 uPa m", "radiated_noise_level_db", 1, "radiated_noise_level_std_db"),
    Head("received dB", "received_level_db", 1),
    Head("background dB", "background_level_db", 1),
)
SPARE_OF_LEVELS = ("received dB", "sensor", "vessel")
SPARE = ("level dB", "status", "course deg", "sensor", "contact", "recording")
"""Columns that a narrow table does without."""


def passages(  # noqa: PLR0913 - three views of one table
    sources: list[Path],
    *,
    per: Literal["day", "month", "vessel", "sensor"] | None = None,
    sql: str | None = None,
    bands: bool = False,
    ais: Ais = None,
    within_m: WithinM = 2000.0,
    form: Annotated[Form, typer.Option("--to")] = "table",
    output: Output = None,
    overwrite: Overwrite = False,
    fresh: bool = False,
) -> None:
    """List every passage of results and folders in one table.

    If a recording has several result files, the newest is used. Result files that were
    read before are remembered, so that only new ones are read.

    Parameters
    ----------
    sources
        Result files, or folders with them.
    per
        Count passages and hours of sound instead of listing them.
    sql
        SELECT over the tables `passages` and `levels`, by DuckDB.
    bands
        List radiated noise levels in decidecade bands, of calibrated recordings;
        not ISO 17208.
    form
        Format to write.
    output
        Output file; standard output if not given.
    fresh
        Read every file again.
    """
    from uwtrack_cli.files.atomic import check_target
    from uwtrack_cli.flow.exports.passage_tables import load_duckdb
    from uwtrack_cli.flow.passages import collect_passages, count_passages, usual_cache

    output = None if output == PIPE else output
    _check(per, sql, bands, form, output)
    if sql is not None or form == "parquet":
        load_duckdb()
    if output is not None:
        check_target(output, overwrite=overwrite)
    table = collect_passages(
        sources, ais=ais, within_m=within_m, cache=None if fresh else usual_cache()
    )
    if not table.n_results and table.problems:
        raise DataError(table.problems[0].removeprefix("left out: "))
    if sql is not None:
        from uwtrack_cli.flow.exports.passage_tables import query_passages

        _write_rows(query_passages(table, sql), form, output, overwrite)
    elif per is not None:
        _write_rows(count_passages(table, per), form, output, overwrite)
    elif bands:
        _write_levels(table, form, output, overwrite)
    else:
        _write_passages(table, form, output, overwrite)
    _tell(table)
    if output is not None:
        say(f"wrote {output}")


def _check(per: str | None, sql: str | None, bands: bool, form: str, output: Path | None) -> None:
    if (per is not None) + (sql is not None) + bands > 1:
        raise OptionError("--per, --sql and --bands each make a table of their own: give one.")
    if form in {"parquet", "geojson"} and (per is not None or sql is not None):
        raise OptionError(
            f"--to {form} holds passages; counts and queries go to table, csv or jsonl."
        )
    if form == "geojson" and bands:
        raise OptionError("--to geojson holds passages; levels go to table, csv, jsonl or parquet.")
    if form == "parquet" and output is None:
        raise OptionError("Parquet is binary: name its file with --output.")


def _tell(table: "PassageTable") -> None:
    for problem in table.problems:
        say(f"warning: {problem}")
    say(
        f"{len(table.passages)} passages in {table.n_results} results, "
        f"{table.n_read} of them read now",
        1,
    )
    if not table.passages:
        say("no passage was found")


def _write_levels(table: "PassageTable", form: str, output: Path | None, overwrite: bool) -> None:
    from uwtrack_cli.flow.exports.passage_tables import LEVEL_COLUMNS

    if form == "parquet" and output is not None:
        _write_parquet(table, "levels", output, overwrite)
    elif form == "table" and output is None:
        show_table(
            ("time UTC", "sensor", "contact", "vessel", *(h.title for h in LEVELS)),
            [
                (
                    utc_text(row.time_utc) if row.time_utc else "-", row.sensor,
                    str(row.contact), row.vessel or "-",
                    *(head.text(asdict(row)) for head in LEVELS),
                )
                for row in table.levels
            ],
            is_data=True, spare=SPARE_OF_LEVELS,
        )  # fmt: skip
    else:
        _write_rows(list(map(asdict, table.levels)), form, output, overwrite, LEVEL_COLUMNS)
    if table.levels:
        say("levels at 1 m of single passages, surface image included: not ISO 17208")
    elif table.passages:
        say("no passage has levels: they need a calibrated sensor and a step 'radiated'")


def _write_parquet(
    table: "PassageTable", name: Literal["passages", "levels"], output: Path, overwrite: bool
) -> None:
    from uwtrack_cli.files.atomic import atomic_target
    from uwtrack_cli.flow.exports.passage_tables import parquet_bytes

    content = parquet_bytes(table, name)
    with atomic_target(output, overwrite=overwrite) as temporary:
        temporary.write_bytes(content)


def _write_passages(table: "PassageTable", form: str, output: Path | None, overwrite: bool) -> None:
    from uwtrack_cli.flow.exports.passage_tables import COLUMNS, passages_geojson

    rows = table.passages
    if form == "table" and output is None:
        if rows:
            _show_passages(rows)
    elif form == "geojson":
        placed = sum(row.latitude is not None for row in rows)
        if placed < len(rows):
            say(f"warning: {len(rows) - placed} of {len(rows)} passages have no position")
        _place(passages_geojson(rows).splitlines(), output, overwrite)
    elif form == "parquet" and output is not None:
        _write_parquet(table, "passages", output, overwrite)
    else:
        _write_rows([asdict(row) for row in rows], form, output, overwrite, COLUMNS)


def _write_rows(
    rows: Sequence[dict[str, Any]],
    form: str,
    output: Path | None,
    overwrite: bool,
    heads: Sequence[str] = (),
) -> None:
    from uwtrack_cli.flow.exports.passage_tables import csv_lines, json_lines

    names = list(heads or (rows[0] if rows else ()))
    if form == "table" and output is None:
        cells = [["-" if row[n] is None else str(row[n]) for n in names] for row in rows]
        # a query may ask for more than a screen holds; a file takes it whole
        is_narrow = sys.stdout.isatty() or "COLUMNS" in os.environ
        spare = names[:0:-1] if is_narrow else ()
        left_out = show_table(names, cells, is_data=True, spare=spare)
        if left_out:
            say(f"no room for {', '.join(left_out)}; --to csv has all columns")
    elif form == "json":
        _place([json.dumps(list(rows), ensure_ascii=False)], output, overwrite)
    elif form == "jsonl":
        _place(json_lines(rows), output, overwrite)
    else:
        _place(csv_lines(rows, names), output, overwrite)


def _place(lines: Any, output: Path | None, overwrite: bool) -> None:
    from uwtrack_cli.files.atomic import write_text

    if output is None:
        put(lines)
        return
    write_text(output, "".join(f"{line}\n" for line in lines), overwrite=overwrite)


def _show_passages(rows: "Sequence[PassageRow]") -> None:
    """Print the table for people; columns in which nothing is known are left out."""
    known = passage_columns([asdict(row) for row in rows])
    shown = list(zip(*known.values(), strict=True))
    show_table(list(known), shown, is_data=True, spare=SPARE)
