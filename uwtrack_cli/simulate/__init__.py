"""Truth to measurements, seeded; shares no formula with the estimators."""
