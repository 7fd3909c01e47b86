"""What a scan measures of a target's state.

**Method.** Mostly the first of each pair of a component and its rate: ranges and bearings
have become places before. A range rate beside them, and the bearing of a target whose
place is sought from own ship under way, are expected from the state to first order.

**Conventions.** States interleave components and rates; own ship is her east, north and
their rates, in m and m/s, ``(..., 4)``. Bearings are degrees from north.

**References.** Bar-Shalom, Li and Kirubarajan (2001), section 10.3.
"""

from typing import Literal, NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, TextArray
from uwtrack_cli.estimation.imm import Belief
from uwtrack_cli.estimation.probabilistic_association import Expected

DEGREES = ("deg", "degree", "degrees", "°")
"""Units of an angle."""

SensedKind = Literal["components", "places", "places and rates", "bearings"]
"""Components as they are; east and north of ranges and bearings, also with range rates;
bearings of a target that is followed in east and north."""


class Sensing(NamedTuple):
    """What is measured, and what is tracked by it."""

    kind: SensedKind
    """How the two belong together."""
    component: TextArray
    """Names of the components that are tracked."""
    component_unit: TextArray
    """Their units."""
    period: FloatArray | None
    """Period of each measured component, infinite for none; None where none has one."""


def sensing_of(names: TextArray, units: TextArray, *, is_under_way: bool) -> Sensing:
    """Return what is tracked by measured components of some names and units.

    ``is_under_way``: whether own ship's navigation is told.
    """
    is_angle = np.isin(units, DEGREES)
    rest = sorted(units[~is_angle].tolist())
    plane = np.array(["east", "north"]), np.array(["m", "m"])
    if is_angle.sum() == 1 and rest in (["m"], ["m", "m/s"]):
        kind: SensedKind = "places" if len(rest) == 1 else "places and rates"
        return Sensing(kind, *plane, None)
    period = np.where(is_angle, 360.0, np.inf) if is_angle.any() else None
    if is_under_way and units.size == 1 and is_angle.all():
        return Sensing("bearings", *plane, period)
    return Sensing("components", names, units, period)


def expect(mean: FloatArray, kind: SensedKind, own: FloatArray | None) -> Expected | None:
    """Return what is expected of states, ``(..., n)``; None for the components."""
    if kind in {"components", "places"}:
        return None
    if own is None:
        own = np.zeros(4)
    place, rate = mean[..., ::2] - own[..., :2], mean[..., 1::2] - own[..., 2:]
    east, north = place[..., 0], place[..., 1]
    distance = np.hypot(east, north)
    if kind == "bearings":
        slope = np.zeros((*mean.shape[:-1], 1, 4))
        slope[..., 0, 0] = np.degrees(north / distance**2)
        slope[..., 0, 2] = -np.degrees(east / distance**2)
        return Expected(np.degrees(np.arctan2(east, north))[..., None], slope)
    along = place / distance[..., None]
    opening = (along * rate).sum(axis=-1, keepdims=True)
    slope = np.zeros((*mean.shape[:-1], 3, 4))
    slope[..., 0, 0] = slope[..., 1, 2] = 1.0
    slope[..., 2, ::2] = (rate - opening * along) / distance[..., None]
    slope[..., 2, 1::2] = along
    return Expected(np.concatenate([mean[..., ::2], opening], axis=-1), slope)


def expect_with_spread(
    belief: Belief, kind: SensedKind, own: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return the measurement that is expected and the state's part of its variance."""
    found = expect(belief.mean, kind, own)
    if found is None:
        variance = np.diagonal(belief.covariance, axis1=-2, axis2=-1)
        return belief.mean[..., ::2], variance[..., ::2]
    spread = found.slope @ belief.covariance
    return found.measured, (spread * found.slope).sum(axis=-1)
