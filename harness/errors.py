"""The harness' errors."""


class InputError(ValueError):
    """Arguments or input that cannot be used; the message is one sentence."""


class StoppedError(Exception):
    """Long work was interrupted; the message says what is kept and how to go on."""
