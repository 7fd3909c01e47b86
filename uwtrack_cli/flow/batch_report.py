"""The report of a batch: CSV and JSON Lines beside the products.

**Conventions.** One row per job, in the order of the jobs, and one per recording that
could not be joined whole, after the product that misses it; paths are relative to the
folder of the report where they lie in it. The file appears whole, after every run. A
report that would lose the rows of another batch is not replaced without being asked.
"""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from uwtrack_cli.errors import OutputError
from uwtrack_cli.files.atomic import write_text
from uwtrack_cli.files.input_ledger import refuse_input
from uwtrack_cli.files.text_escaping import csv_cell, plain_text
from uwtrack_cli.flow.batch import Outcome, not_ours
from uwtrack_cli.flow.batch_sources import FoundRecording, other_source

NAMES = ("batch.csv", "batch.jsonl")
HEADS = (
    "source", "target", "status", "n_sources", "duration_s", "cpu_s", "n_encounters",
    "message",
)  # fmt: skip


def report_rows(outcomes: Sequence[Outcome], folder: Path) -> list[dict[str, Any]]:
    """Return the rows of a report as plain values."""
    rows = []
    for outcome in outcomes:
        row = asdict(outcome)
        row["encounters"] = list(outcome.encounters)
        row["n_encounters"] = len(outcome.encounters)
        target = Path(outcome.target)
        if target.is_relative_to(folder.absolute()):
            row["target"] = str(target.relative_to(folder.absolute()))
        row["faults"] = list(outcome.faults)
        rows.append(row)
        rows += [
            {**row, **fault, "n_sources": 1, "duration_s": None, "cpu_s": None,
             "encounters": [], "n_encounters": 0, "faults": []}
            for fault in outcome.faults
            if not any(fault.items() <= known.items() for known in rows)
        ]  # fmt: skip
    return rows


def check_report(folder: Path, found: Sequence[FoundRecording], *, overwrite: bool) -> None:
    """Refuse a folder where the report would replace what must stay.

    ``found``: the recordings of this batch. ``overwrite``: whether the report of another
    batch may be replaced.

    Raises
    ------
    OutputError
        The report would replace an input, a file that is none, or that of another batch.
    """
    table, lines = (folder / name for name in NAMES)
    for path in (table, lines):
        refuse_input(path)
    head = table.read_bytes() if table.exists() else b""
    if head and not head.startswith(",".join(HEADS[:3]).encode()):
        raise OutputError(not_ours(table))
    sources = read_sources(lines) if lines.exists() else []
    other = other_source(sources, found, {item.root for item in found})
    if other and not overwrite:
        raise OutputError(
            f"{lines} is the report of another batch, of {other}: name another folder "
            f"with --output, or give --overwrite to replace it."
        )


def read_sources(path: Path) -> list[str]:
    """Return which recordings a report is of.

    Raises
    ------
    OutputError
        The file is no report.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        rows = [json.loads(line) for line in lines]
        return [f"{row['source']}" for row in rows if row["target"]]
    except (ValueError, KeyError, TypeError) as error:
        raise OutputError(not_ours(path)) from error


def write_report(outcomes: Sequence[Outcome], folder: Path) -> tuple[Path, Path]:
    """Write the report into the folder of the products.

    ``folder``: folder of the products; made if it does not exist.

    Raises
    ------
    OutputError
        The folder cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows = report_rows(outcomes, folder)
    text = io.StringIO()
    writer = csv.DictWriter(text, HEADS, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: csv_cell(v) for k, v in row.items()} for row in rows)
    lines = "".join(plain_text(json.dumps(row, ensure_ascii=False)) + "\n" for row in rows)
    written = folder / NAMES[0], folder / NAMES[1]
    for path, content in zip(written, (text.getvalue(), lines), strict=True):
        write_text(path, content, overwrite=True)
    return written
