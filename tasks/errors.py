"""How the errors of other people's code are told."""


def one_line(error: BaseException) -> str:
    """An exception's kind and message in one line, such as "KeyError: 'slide'"."""
    return " ".join(f"{type(error).__name__}: {error}".split())
