"""The tables of tests/baselines, written from what is frozen."""

from pathlib import Path

from tests.acceptance.parts import PARTS
from tests.acceptance.rates import RATES, span, words_of
from tests.acceptance.running import FROZEN, load

BASELINES = Path(__file__).parents[1] / "baselines"


def write_tables() -> None:
    """Write the tables of rates, of drawn and real recordings, of lines and of costs."""
    stored = {part: load(FROZEN, part) for part in PARTS}
    results = {part: one["cases"] for part, one in stored.items()}
    commits = ", ".join(f"{part} {one['commit']}" for part, one in stored.items() if one["commit"])
    head = (f"Made by `python -m tests.acceptance freeze`; seeds in tests/acceptance/parts.py; "
            f"commits: {commits}.\n\n")  # fmt: skip
    lines = ["| rate | today | limit | band | source |", "|---|---|---|---|---|"]
    lines += [
        f"| {rate.name} | {words_of(rate, rate.count(results))} | {span(rate.limit)} "
        f"| {span(rate.band)} | {rate.source} |"
        for rate in RATES
    ]
    _write("rates", "Rates with their limits and bands", head, lines)
    lines = ["| part | case | vessels | false rows |", "|---|---|---|---|"]
    for part, cases in results.items():
        for name, one in cases.items():
            if "hours" in one or part in ("samples", "vehicles"):
                lines.append(f"| {part} | {name} | {_vessels(one)} | {_false(one)} |")
    _write("recordings", "Drawn recordings and samples, by the default recipe", head
           + "For each vessel status, side and its errors in standard deviations (in brackets "
           "standard deviation over the Cramer-Rao bound).\n\n", lines)  # fmt: skip
    lines = ["| recording | rows | else |", "|---|---|---|"]
    lines += [
        f"| {name} | {_rows(one)} | {', '.join(one.get('codes', []))} |"
        for name, one in results["real"].items()
    ]
    _write("real_sound", "Real recordings by the default recipe", head, lines)
    lines = ["| case | figures |", "|---|---|"]
    for part in ("lines", "arrays", "tables", "targets"):
        for name, one in results[part].items():
            told = [f"{k} {v['value']:.3f}" for k, v in one.get("scores", {}).items()]
            told += [f"{k} {a:g} of {b:g}" for k, (a, b) in one.get("counts", {}).items()]
            lines.append(f"| {name} | {', '.join(told)} |")
    _write("figures", "Lines, arrays and tables", head, lines)
    lines = ["| part | case | CPU in references | peak memory, MB |", "|---|---|---|---|"]
    for part, cases in results.items():
        lines += [
            f"| {part} | {name} | {one['cost']['cpu']:g} | {one['cost']['memory_mb']} |"
            for name, one in cases.items()
        ]
        total = sum(one["cost"]["cpu"] for one in cases.values())
        lines.append(f"| {part} | all | {total:.0f} | |")
    _write("costs", "Cost of the cases", head
           + "A reference is a fixed piece of numpy work in the same process "
           "(tests/acceptance/costs.py), some 0.1 s on a quiet core; nothing is compared.\n\n",
           lines)  # fmt: skip


def _write(name: str, title: str, head: str, lines: list[str]) -> None:
    text = f"# {title}\n\n{head}" + "\n".join(lines) + "\n"
    (BASELINES / f"{name}.md").write_text(text, encoding="utf-8")


def _vessels(one: dict) -> str:
    told = []
    for vessel in one.get("vessels", []):
        if not vessel["found"]:
            told.append("missed" if vessel["due"] else "not due, not found")
            continue
        parts = []
        for name, q in vessel["quantities"].items():
            bound = f" ({q['std'] / q['bound']:.1f})" if q.get("bound") else ""
            parts.append(f"{name.rsplit('_', 1)[0]} {q['error'] / q['std']:+.1f}{bound}")
        told.append(f"{vessel['status']}, side {vessel['side']}: {', '.join(parts)}")
    return "; ".join(told)


def _false(one: dict) -> str:
    return "; ".join(
        f"{r['status']} at {r['time_s']:.0f} s, {r['why']}" for r in one.get("false", [])
    )


def _rows(one: dict) -> str:
    told = []
    for row in one.get("rows", []):
        values = [
            f"{k} {v['value']:.2f} ± {v['std']:.2f}" for k, v in row.items() if isinstance(v, dict)
        ]
        told.append(f"{row['verdict']}: {row['status']}, {', '.join(values)}")
    return "; ".join(told) or "none"
