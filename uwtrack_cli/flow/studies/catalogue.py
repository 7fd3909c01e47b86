"""The studies by name: which function makes each, and what it repeats."""

STUDIES: dict[str, str] = {
    "lines": "uwtrack_cli.flow.studies.lines:study_lines",
    "tma": "uwtrack_cli.flow.studies.tma:study_tma",
    "optimisers": "uwtrack_cli.flow.studies.optimisers:study_optimisers",
    "proximity": "uwtrack_cli.flow.studies.proximity:study_proximity",
    "seatrial": "uwtrack_cli.flow.studies.seatrial:study_seatrial",
    "clutter": "uwtrack_cli.flow.studies.clutter:study_clutter",
    "line-association": (
        "uwtrack_cli.flow.studies.line_association:study_line_association"
    ),
    "discriminate": "uwtrack_cli.flow.studies.discriminate:study_discriminate",
}
"""Function of each study; it takes ``runs`` and ``seed`` and returns a `Study`."""
