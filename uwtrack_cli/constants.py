"""Conventions and physical constants, each with its unit and source."""

SOUND_SPEED_WATER_MPS = 1500.0
"""Nominal sound speed in sea water, m/s (Choi et al. 2014, section 4)."""

KNOT_MPS = 1852.0 / 3600.0
"""One international knot in m/s (1 nautical mile = 1852 m, BIPM)."""

SOURCE_DEPTH_M = 3.0
"""Nominal depth of a surface vessel's propeller, m (Choi et al. 2014)."""

SOURCE_DEPTH_STD_M = 2.0
"""Standard deviation of that depth among vessels, m: boats 1 m, large ships 7 m."""

NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second: epochs are int64 nanoseconds UTC."""

MAINS_HZ = (50.0, 60.0)
"""Frequencies of mains, Hz."""

MAINS_TOLERANCE = 1e-3
"""Relative deviation of mains from their nominal frequency."""

MAINS_REACH_HZ = 0.05
"""What a line of mains may be off beyond that, Hz."""
