"""The error that tells a user about his mistakes."""


class StudyError(Exception):
    """A mistake in a study or on the command line, as `FILE: key: VALUE: expected ...`; one line per mistake.

    The command line prints the text unchanged and exits with code 2.
    """
