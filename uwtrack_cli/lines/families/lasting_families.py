"""Lasting families: the combs of single instants, followed over their life.

**Method.** Each comb found among the lines is the continuation of the family that
most of its lines belong to, if the spacing is the same, and otherwise a new family. At
the end the expected number by chance is corrected for the number of times that
was looked (Bonferroni), and families that chance explains are forgotten.

**Conventions.** Lines and families are identified by number; families from 1.

**References.** Desolneux, Moisan & Morel (2008) for the number of false alarms.
"""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.peaks import Families
from uwtrack_cli.lines.families.harmonics import Comb, CombFit, comb_fit

_SAME_SPACING = 0.02
"""Relative difference of spacings within one family."""

_LEAST_SUPPORT = 0.25
"""Share of a family's sightings in which a line must be to be a member."""


@dataclass
class _Family:
    """The combs of one family."""

    first_frame: int
    """Frame in which it was found first."""
    fit: CombFit
    """Spacing and offset of its least likely comb by chance."""
    log10_chance: float
    """Logarithm of the expected number of that comb by chance."""
    harmonic_votes: int = 0
    """Combs whose teeth are multiples of the spacing, less the others."""
    sightings: int = 0
    """Combs found."""
    lines: Counter[int] = field(default_factory=Counter)
    """Combs in which each line was a member."""


class FamilyRegister:
    """Gathers the combs of a recording into families with one number each."""

    def __init__(self) -> None:
        self.families: dict[int, _Family] = {}
        self.looks = 0
        self._family_of: dict[int, int] = {}

    def note(
        self,
        frame: int,
        combs: list[Comb],
        lines: IntArray,
        frequency_hz: FloatArray,
        sigma_hz: float,
    ) -> None:
        """Enter what one look at the lines has found."""
        self.looks += 1
        for comb in combs:
            names = [int(name) for name in lines[comb.members]]
            fit = comb_fit(frequency_hz[comb.members], comb.teeth, sigma_hz)
            number = self._continued(names, fit.spacing_hz)
            if number is None:
                number = len(self.families) + 1
                self.families[number] = _Family(frame, fit, comb.log10_chance)
            family = self.families[number]
            if comb.log10_chance <= family.log10_chance:
                family.log10_chance, family.fit = comb.log10_chance, fit
            family.harmonic_votes += 1 if fit.is_harmonic else -1
            family.sightings += 1
            family.lines.update(names)
            self._family_of.update(dict.fromkeys(names, number))

    def rename(self, line: int, number: int) -> None:
        """Enter what is known of a line under the number of one that it continues."""
        for family in self.families.values():
            if line in family.lines:
                family.lines[number] += family.lines.pop(line)
        if line in self._family_of:
            self._family_of[number] = self._family_of.pop(line)

    def _continued(self, names: list[int], spacing_hz: float) -> int | None:
        known = Counter(self._family_of[name] for name in names if name in self._family_of)
        for number, count in known.most_common():
            ratio = self.families[number].fit.spacing_hz / spacing_hz
            # every second tooth of a family is that family, too
            order = max(ratio, 1.0 / ratio)
            if count >= 2 and abs(order / round(order) - 1.0) < _SAME_SPACING:
                return number
        return None

    def lasting(self, lines: IntArray, greatest_chance: float) -> tuple[Families, IntArray]:
        """Return the families that chance does not explain, and each line's one."""
        limit = np.log10(greatest_chance) - np.log10(max(self.looks, 1))
        chosen = {
            number: [
                name
                for name, count in family.lines.items()
                if count >= _LEAST_SUPPORT * family.sightings
            ]
            for number, family in self.families.items()
            if family.log10_chance < limit
        }
        chosen = {number: names for number, names in chosen.items() if len(names) >= 3}
        best = self._best_family(chosen)
        size = Counter(best.values())
        # a family whose lines belong to another one for most of the time is that one
        best = {name: number for name, number in best.items() if size[number] >= 3}
        rows = [number for number in chosen if size[number] >= 3]
        table = [self.families[number] for number in rows]
        count = np.log10(max(self.looks, 1))
        families = Families(
            family=np.array(rows, dtype=np.int64),
            frame=np.array([f.first_frame for f in table]),
            spacing_hz=np.array([f.fit.spacing_hz for f in table]),
            spacing_std_hz=np.array([f.fit.spacing_std_hz for f in table]),
            offset_hz=np.array([f.fit.offset_hz for f in table]),
            is_harmonic=np.array([f.harmonic_votes > 0 for f in table]),
            n_members=np.array([size[number] for number in rows], dtype=np.int64),
            log10_chance=np.array([f.log10_chance + count for f in table]),
            peak_family=np.zeros(0, dtype=np.int64),
        )
        return families, np.array([best.get(int(n), -1) for n in lines], dtype=np.int64)

    def _best_family(self, chosen: dict[int, list[int]]) -> dict[int, int]:
        """Give each line the family that saw it most often."""
        best: dict[int, int] = {}
        for number, names in chosen.items():
            for name in names:
                rival = best.get(name)
                seen = self.families[number].lines[name]
                if rival is None or seen > self.families[rival].lines[name]:
                    best[name] = number
        return best


def no_families() -> Families:
    """Return a table of families without rows."""
    none, nothing = np.zeros(0), np.zeros(0, dtype=np.int64)
    return Families(
        family=nothing, frame=nothing, spacing_hz=none, spacing_std_hz=none,
        offset_hz=none, is_harmonic=nothing.astype(bool), n_members=nothing,
        log10_chance=none, peak_family=nothing,
    )  # fmt: skip
