"""The arrows of the chain: one plain function per stage."""
