"""One converter decides what an option accepts, for every way in."""

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
import pytest

from uwtrack_cli.data.options import (
    Above,
    AtLeast,
    AtMost,
    Below,
    Increasing,
    Key,
    OptionGroup,
    Unit,
    checked,
    convert,
    from_table,
    plain_type,
    range_of,
    unit_of,
)
from uwtrack_cli.errors import OptionError

Window = Annotated[float, Unit("s"), Above(0), AtMost(60)]
Band = Annotated[tuple[float, float], Unit("Hz"), AtLeast(0), Increasing()]


@dataclass(frozen=True)
class Line:
    """A line of a scenario."""

    frequency_hz: Annotated[float, Unit("Hz"), Above(0)]
    files: Annotated[tuple[str, ...], Key("patterns")] = ()


@dataclass(frozen=True)
class Vessel:
    """A vessel with lines."""

    name: str
    line: tuple[Line, ...] = field(default_factory=tuple)


@dataclass(frozen=True)
class Gates(OptionGroup):
    """A group of options."""

    sigmas: Annotated[float, Above(0)] = 4.0
    frames: Annotated[int, AtLeast(1)] = 5


@pytest.mark.parametrize(
    ("hint", "value", "expected"),
    [
        (Window, 2, 2.0),
        (Window, np.float32(0.5), 0.5),
        (Window | None, None, None),
        (Annotated[float | None, Above(0)], None, None),
        (Annotated[float | None, Above(0)], 3, 3.0),
        (Band, [20, 1500], (20.0, 1500.0)),
        (int, np.int64(7), 7),
        (Literal["a", "b"], "b", "b"),
        (list[Window], [1, 2], [1.0, 2.0]),
        (bool, True, True),
    ],
)
def test_what_is_accepted_comes_back_in_its_type(hint, value, expected):
    found = convert("option", hint, value)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    ("hint", "value", "word"),
    [
        (Window, 0.0, "above 0"),
        (Window, 61.0, "at most 60"),
        (Window, True, "a number"),
        (Window, "1", "a number"),
        (Window, math.nan, "a finite number"),
        (Window, 10**400, "beyond 64 bits"),
        (Annotated[float, Below(1)], 1.0, "below 1"),
        (int, 2**63, "beyond 64 bits"),
        (int, 1.0, "a whole number"),
        (Band, [1500, 20], "increasing"),
        (Band, [-1, 20], "at least 0"),
        (Band, [1, 2, 3], "takes 2 values"),
        (Band, 5, "a list"),
        (Literal["a"], "b", "one of 'a'"),
        (Literal[1], True, "one of 1"),
        (str, 3, "a text"),
        (bool, 1, "true or false"),
    ],
)
def test_what_is_not_accepted_is_named_with_its_place(hint, value, word):
    with pytest.raises(OptionError, match=r"^option ") as caught:
        convert("option", hint, value)
    assert word in str(caught.value)


def test_tables_become_dataclasses():
    table = {"name": "ferry", "line": [{"frequency_hz": 60, "patterns": ["a*"]}]}
    vessel = from_table(Vessel, table, "vessel")
    assert vessel == Vessel("ferry", (Line(60.0, ("a*",)),))


@pytest.mark.parametrize(
    ("table", "word"),
    [
        ({"nmae": "ferry"}, "Did you mean 'name'"),
        ({}, "needs the key 'name'"),
        ({"name": "f", "line": [{"frequency_hz": -1}]}, "vessel.line[1].frequency_hz"),
        ({"name": "f", "line": [{"files": ["a"]}]}, "'files'"),
        ("ferry", "a table of keys"),
    ],
)
def test_tables_are_refused_with_the_place(table, word):
    with pytest.raises(OptionError) as caught:
        from_table(Vessel, table, "vessel")
    assert word in str(caught.value)


def test_groups_and_functions_check_what_python_gives_them():
    @checked
    def stage(block: int, *, window_s: Window = 1.0):
        """Yield a window, to see when it is checked."""
        yield block, window_s

    assert list(stage(1, window_s=2)) == [(1, 2.0)]
    with pytest.raises(OptionError, match="window_s must be"):
        stage(1, window_s=-1)  # at the call, before the first block
    assert Gates(sigmas=3).sigmas == 3.0
    with pytest.raises(OptionError, match="frames must be"):
        Gates(frames=0)


def test_help_reads_unit_and_range_from_the_annotation():
    assert unit_of(Window | None) == "s"
    assert range_of(Window) == "above 0, at most 60"
    assert plain_type(Annotated[Window | None, AtLeast(1)]) == float | None
    assert plain_type(list[Window]) == list[float]
