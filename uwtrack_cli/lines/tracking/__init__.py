"""The line tracker: association, filters, track management."""
