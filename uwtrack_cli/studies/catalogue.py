"""The studies by name: which function makes each, and what it repeats."""

STUDIES: dict[str, str] = {
    "lines": "uwtrack_cli.studies.lines_study:study_lines",
    "tma": "uwtrack_cli.studies.tma_study:study_tma",
    "optimisers": "uwtrack_cli.studies.optimisers:study_optimisers",
    "proximity": "uwtrack_cli.studies.proximity:study_proximity",
    "seatrial": "uwtrack_cli.studies.seatrial:study_seatrial",
    "clutter": "uwtrack_cli.studies.clutter_study:study_clutter",
    "line-association": ("uwtrack_cli.studies.line_association:study_line_association"),
    "demon": "uwtrack_cli.studies.demon_study:study_demon",
    "discriminate": "uwtrack_cli.studies.discrimination_study:study_discriminate",
}
"""Function of each study; it takes ``runs`` and ``seed`` and returns a `Study`."""
