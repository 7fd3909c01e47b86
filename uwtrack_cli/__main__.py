"""`python -m uwtrack_cli`: the program where its script is not on the search path."""

from uwtrack_cli.cli import main

if __name__ == "__main__":
    main()
