"""How two contacts are compared, and when a verdict is due."""
