"""The studies by name: which function makes each, and what it repeats."""

STUDIES: dict[str, str] = {
    "lines": "studies.lines_study:study_lines",
    "tma": "studies.tma_study:study_tma",
    "optimisers": "studies.optimisers:study_optimisers",
    "proximity": "studies.proximity:study_proximity",
    "seatrial": "studies.seatrial:study_seatrial",
    "clutter": "studies.clutter_study:study_clutter",
    "line-association": ("studies.line_association:study_line_association"),
    "demon": "studies.demon_study:study_demon",
    "discriminate": "studies.discrimination_study:study_discriminate",
}
"""Function of each study; it takes ``runs`` and ``seed`` and returns a `Study`."""
