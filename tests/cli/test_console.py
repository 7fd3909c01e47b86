"""What is written can always be written."""

from uwtrack_cli.cli.console import put, say


def test_a_name_that_is_no_text_is_written_out(capsys):
    put(["lines of \udcff"])
    say("damaged: \udcff", -1)
    written = capsys.readouterr()
    assert written.out == "lines of \\udcff\n"
    assert written.err == "damaged: \\udcff\n"
