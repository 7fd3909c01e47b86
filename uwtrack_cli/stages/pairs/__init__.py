"""Parts of the stage that tells two contacts apart."""
