"""The command line: the only floor that knows typer, rich and exit codes."""


def main() -> None:
    """Run the program; the console script's entry."""
    from uwtrack_cli.cli.app import app

    app()
