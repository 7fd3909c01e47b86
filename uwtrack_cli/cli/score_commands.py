"""`diff` and `score`: is it the same, and is it right."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uwtrack_cli.cli.command_factory import AsJson, Branch, ProductFile
from uwtrack_cli.cli.console import OUTSIDE, put, say, show_table, unread_too
from uwtrack_cli.cli.targets import open_product
from uwtrack_cli.data.options import AtLeast
from uwtrack_cli.data.renamed import with_old_keys
from uwtrack_cli.files.tables.json_rows import plain

if TYPE_CHECKING:
    from uwtrack_cli.flow.comparison import Difference
    from uwtrack_cli.flow.scoring.encounter_scores import Identity
    from uwtrack_cli.flow.scoring.score_product import ProductScore

STRAIGHT = "straight"
"""The motion model that goes without saying."""

Tolerance = Annotated[
    Path | None, typer.Option("--tolerance", help="TOML file with limits per quantity.")
]


def diff(
    first: ProductFile,
    second: ProductFile,
    *,
    rtol: Annotated[float, AtLeast(0)] = 0.0,
    atol: Annotated[float, AtLeast(0)] = 0.0,
    tolerance: Tolerance = None,
    json_output: AsJson = False,
) -> None:
    """Compare two result files by their numbers; exit code 4 when they differ.

    What made them, and when, does not count. A tolerance file overrides --rtol and
    --atol per quantity: [encounters] speed_mps = { rtol = 1e-3, atol = 0.01 }.

    Parameters
    ----------
    rtol
        Allowed difference relative to the larger value.
    atol
        Allowed difference in the unit of the quantity.
    """
    from uwtrack_cli.flow.comparison import compare_products
    from uwtrack_cli.flow.scoring.tolerances import read_closeness

    tolerances = read_closeness(tolerance) if tolerance else {}
    with open_product(first) as one, open_product(second) as other:
        found = compare_products(one, other, rtol=rtol, atol=atol, tolerances=tolerances)
    with unread_too():
        if json_output:
            put([json.dumps([with_old_keys(plain(asdict(item))) for item in found])])
        else:
            put(map(_difference_line, found))
    if found:
        raise typer.Exit(OUTSIDE)
    say("the numbers are the same", 0 if rtol == atol == 0.0 else 1)


def _difference_line(item: "Difference") -> str:
    of = f" of {item.sensor}" if item.sensor else ""
    of += f" by {item.step}" if item.step else ""
    name = f"{item.table}.{item.quantity}" if item.quantity else item.table
    line = f"{name}{of} {item.reason}"
    if item.n_different:
        line += f": {item.n_different} of {item.n_values} values"
    if math.isfinite(item.largest):
        line += f", by {item.largest:.4g} ({item.largest_relative:.2g} relative)"
    return line


def score(
    file: ProductFile,
    *,
    truth: Path,
    tolerance: Tolerance = None,
    within_m: float = 2000.0,
    cutoff_m: float = 500.0,
    step: Branch = None,
    json_output: AsJson = False,
) -> None:
    """Compare a result with the truth: errors in units, percent, standard deviations.

    Tells which vessel each encounter was, with probabilities. With a tolerance file,
    exit code 4 when an error is outside its limit, such as
    [encounters] speed_mps = { percent = 2.0, sigmas = 4.0 }.

    Parameters
    ----------
    truth
        Truth: NAME.truth.json, or an AIS table.
    within_m
        Range in m within which AIS vessels are compared.
    cutoff_m
        Cut-off of GOSPA and OSPA in m.
    """
    from uwtrack_cli.flow.scoring.score_product import read_any_truth, score_product
    from uwtrack_cli.flow.scoring.tolerances import read_requirements

    wanted = read_requirements(tolerance) if tolerance else None
    known = read_any_truth(truth)
    with open_product(file) as product:
        found = score_product(
            product, known, wanted, step=step, within_m=within_m, cutoff_m=cutoff_m
        )
    with unread_too():
        if json_output:
            facts = plain(asdict(found))
            facts["identities"] = list(map(with_old_keys, facts["identities"]))
            put([json.dumps(facts, ensure_ascii=False)])
        else:
            _show(found)
    for problem in found.problems:
        say(f"outside: {problem}", -1)
    if found.problems:
        raise typer.Exit(OUTSIDE)


HEADS = ("contact", "sensor", "vessel", "quantity", "estimate", "truth", "error", "%",
         "std", "sigmas", "")  # fmt: skip


def _show(found: "ProductScore") -> None:
    if found.scores:
        rows = [_cells(item) for item in found.scores]
        show_table(HEADS, rows, spare=("std", "contact", "sensor", "truth"))
    for who in found.identities:
        chances = ", ".join(f"{name} {p:.3f}" for name, p in who.candidates)
        say(
            f"contact {who.contact} of {who.sensor}: {chances or 'no vessel known'}, "
            f"unlisted {who.unlisted:.3f}{_model(who)}"
        )
    for text in found.missed:
        say(f"missed: {text}")
    for text in found.false:
        say(f"not in the truth: {text}")
    for text in found.ambiguous:
        say(text)
    if found.gospa_m is not None:
        say(
            f"GOSPA {found.gospa_m:.1f} m, OSPA {found.ospa_m:.1f} m (mean of "
            f"{found.n_times} times)"
        )


def _model(who: "Identity") -> str:
    """Say the motion model where it is not a straight passage for certain."""
    model, other = who.motion_model, who.alternative_motion_model
    if model in ("", STRAIGHT) and not other:
        return ""
    alternative = f", alternative {other}" if other else ""
    return f"; motion model {model} {who.motion_model_probability:.2f}{alternative}"


def _cells(item: Any) -> Sequence[str]:
    numbers = (item.error, item.percent, item.std, item.sigmas)
    return (
        str(item.contact), item.sensor, item.vessel, item.quantity,
        _number(item.estimate), _number(item.truth), *map(_number, numbers),
        item.outside,
    )  # fmt: skip


def _number(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return "-" if math.isnan(value) else f"{value:.4g}"
