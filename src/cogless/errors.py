"""What a user did wrong, in one line."""


class StudyError(Exception):
    """A mistake in a study or on the command line, as `FILE: key: VALUE: expected ...`.

    The command line prints it as it stands and exits with 2.
    """
