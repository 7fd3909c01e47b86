"""Encounters made of a few known values, the rest unknown."""

import numpy as np

from uwtrack_cli.data.encounters import Encounters


def encounters_of(*rows: dict[str, object], **scalars: object) -> Encounters:
    """One encounter per row; numbers default to nan, texts to empty ones."""
    columns: dict[str, np.ndarray] = {}
    for name, spec in Encounters.columns().items():
        if spec.axes[0] != "encounter":
            columns[name] = np.zeros(0, spec.dtype)
        elif len(spec.axes) == 3:
            columns[name] = np.full((len(rows), 4, 4), np.nan)
        else:
            unknown = {"f": np.nan, "i": -1, "b": False, "U": ""}[spec.dtype.kind]
            columns[name] = np.array([row.get(name, unknown) for row in rows])
    filled = {"contact": np.arange(len(rows)) + 1}
    for name, default in {"sensor": "h1", "status": "ok"}.items():
        filled[name] = np.array([row.get(name, default) for row in rows], np.str_)
    return Encounters(**{**columns, **filled, "reference": "1 uPa", **scalars})
