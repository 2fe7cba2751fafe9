"""Mistakes of a user, a line each."""


class StudyError(Exception):
    """A mistake in a study or on the command line, as `FILE: key: VALUE: expected ...`; several, a line each.

    The command line prints it as it stands and exits with 2.
    """
