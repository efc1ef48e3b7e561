"""The one error a user can mend."""


class InputError(ValueError):
    """A mistake in what the user gave: a file, a record, a setting.

    The message is one clear line: what is wrong, where (file, column, row), in which unit, what to do.
    The command line prints it and leaves with exit status 2; every other exception is a fault of the program.
    """
